"""Columns of numbers in files of strangers: CSV under names, and messages of MCAP, both within bounds.

Neither takes more memory than a stated multiple of the file: lines are read one by one, and what is
compressed is decompressed up to a limit.
"""

from __future__ import annotations

import csv
import io
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.errors import import_extra

#: Longest line of a CSV file [characters], and most columns.
_LONGEST, _MOST_COLUMNS = 1 << 18, 10_000
#: Most memory that a decompressor may keep of what it has given [bytes]; MCAP's writers use 8 MiB and less.
_WINDOW = 32 * 2**20


class Table(NamedTuple):
    """A CSV file: the names above its columns, and its numbers, (rows, columns)."""

    head: list[str]
    values: Array


def read_table(path: Path, most: int) -> Table:
    """Return the names and the numbers of a CSV file of at most so many bytes.

    Raises:
        OSError: when it cannot be read, or is no regular file.
        ValueError: when a line is no list of numbers, as many as there are names.
    """
    with files.open_regular(path, most) as stream, io.TextIOWrapper(stream, "utf-8-sig") as text:
        lines = _lines(text)
        names = next(csv.reader([next(lines, "")]), [])
        head = [name.strip() for name in names]
        if len(head) == 1:
            raise ValueError("there is no comma in its first line; separate columns by commas")
        if len(head) > _MOST_COLUMNS:
            raise ValueError(f"it has {len(head)} columns, more than {_MOST_COLUMNS}")
        with warnings.catch_warnings():  # of no rows, which who asks says
            warnings.simplefilter("ignore", UserWarning)
            try:
                values = np.loadtxt(_same_width(lines, len(head)), delimiter=",", ndmin=2, quotechar='"')
            except ValueError as error:
                raise ValueError(_in_words(str(error))) from None
    return Table(head, values if values.size else values.reshape(0, len(head)))


def _in_words(error: str) -> str:
    """Return what NumPy says of a table, without the remedy that only who calls NumPy has."""
    changed = re.match(r"the number of columns changed from (\d+) to (\d+) at row (\d+)", error)
    if changed is None:
        return error
    usual, here, row = changed.groups()
    return f"its row {row} of numbers has {here} columns, where those above have {usual}; cut it there"


def _lines(text: io.TextIOBase) -> Iterator[str]:
    """Give the lines of a text that are not empty, refusing one that is no line of a table."""
    number = 0
    while line := text.readline(_LONGEST + 1):
        number += 1
        if len(line) > _LONGEST:
            raise ValueError(f"line {number} has more than {_LONGEST} characters")
        if line.strip():
            yield line


def _same_width(lines: Iterator[str], width: int) -> Iterator[str]:
    """Give lines, refusing one with more columns than there are names before it is taken apart."""
    for line in lines:
        if line.count(",") >= max(width, 1) and not line.lstrip().startswith("#"):
            raise ValueError(f"a line has {line.count(',') + 1} columns under {width} names")
        yield line


class Message(NamedTuple):
    """A message of an MCAP file: when it was written down [s], and its fields."""

    time: float
    fields: dict[str, Any]


def read_messages(path: Path, topic: str, fields: Sequence[str], most: int) -> list[Message]:
    """Return the messages on a topic of an MCAP file of at most so many bytes, JSON or ROS 2's CDR, by time.

    The file is read from its beginning to its end: an index might name the same chunk often.

    Raises:
        OSError: when it cannot be read, or is no regular file.
        MissingPackage: when a package that reads it is not installed.
        Exception: whatever the packages raise for a damaged file.
    """
    content = files.read_bytes(path, most)
    ros = import_extra("mcap_ros2.decoder", "mcap", "mcap-ros2-support").DecoderFactory()
    records = import_extra("mcap.records", "mcap")
    schemas: dict[int, Any] = {0: None}
    channels: dict[int, Any] = {}
    found: list[Message] = []
    for record in _records(content):
        if isinstance(record, records.Schema):
            schemas[record.id] = record
        elif isinstance(record, records.Channel):
            channels[record.id] = record
        elif isinstance(record, records.Message) and channels[record.channel_id].topic == topic:
            channel = channels[record.channel_id]
            values = _decoded(record, channel, schemas[channel.schema_id], fields, ros)
            found.append(Message(record.log_time * 1e-9, values))
    return sorted(found, key=lambda message: message.time)


def _decoded(record: Any, channel: Any, schema: Any, fields: Sequence[str], ros: Any) -> dict[str, Any]:
    """Return the fields of a message."""
    if channel.message_encoding == "json":
        values: dict[str, Any] = json.loads(record.data)
        return {field: values[field] for field in fields}
    decode = ros.decoder_for(channel.message_encoding, schema)
    if decode is None:
        raise ValueError(f"messages are {channel.message_encoding!r}, not JSON or ROS 2's CDR")
    decoded = decode(record.data)
    return {field: getattr(decoded, field) for field in fields}


def _records(content: bytes) -> Iterator[Any]:
    """Give the records of an MCAP file, those in chunks too, within what such a file may hold."""
    reader = import_extra("mcap.stream_reader", "mcap")
    chunk_type = import_extra("mcap.records", "mcap").Chunk
    room = files.allowance(len(content))
    outer = reader.StreamReader(io.BytesIO(content), emit_chunks=True, record_size_limit=len(content))
    for record in outer.records:
        if not isinstance(record, chunk_type):
            yield record
            continue
        if record.uncompressed_size > room:
            raise ValueError(f"it holds more than {files.RATIO} times its size, and more than 64 MiB")
        plain = _decompressed(record.data, record.compression, record.uncompressed_size)
        room -= len(plain)
        yield from reader.breakup_chunk(chunk_type("", plain, 0, 0, 0, len(plain)))


def _decompressed(data: bytes, compression: str, size: int) -> bytes:
    """Return what a chunk holds, which says to have so many bytes.

    Raises:
        ValueError: when it has more, or is compressed in another way.
    """
    if compression == "":
        return data
    if compression == "zstd":
        zstandard = import_extra("zstandard", "mcap")
        reader = zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(data)
        plain = bytes(reader.read(size + 1))
    elif compression == "lz4":
        plain = import_extra("lz4.frame", "mcap", "lz4").LZ4FrameDecompressor().decompress(data, size + 1)
    else:
        raise ValueError(f"its chunks are compressed by {compression[:20]!r}; expected zstd or lz4")
    if len(plain) > size:
        raise ValueError(f"a chunk holds more than the {size} bytes that it declares")
    return plain
