"""What a study is and which code runs it: in its folder, in each of its chunks, and refused where it differs.

A study is what was asked and the bytes of every file that it names. The code is the package with its sources,
what it computes with, and the compiler. Both have a short name (digest); a chunk carries both and its own
hash, so that numbers of two arms, or of two versions, are never taken for those of one.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from armgpi import files
from armgpi.arrays import Array
from armgpi.codegen import build
from armgpi.config.experiment import portable
from armgpi.config.schema import ExperimentConfig
from armgpi.errors import BackendError, RolloutError
from armgpi.loop.provenance import versions
from armgpi.robot import robots

#: The file of a folder that says what study it holds.
IDENTITY = "study.json"
#: Packages whose sources no number of a study depends on.
_SHOWS = {"cli", "viz", "play", "export", "realtime", "validation", "paper", "health", "certification"}
#: Largest file of identity, and longest first line of a chunk [bytes].
_MOST, _HEAD = 10_000_000, 4096
#: Differences that are told.
_TOLD = 3


@dataclass(frozen=True)
class Identity:
    """What a study is, and which code runs it.

    Attributes:
        what: everything that was asked, with the hashes of the files that it names; plain data.
        code: versions, and a hash of the sources that compute.
        copies: files that belong beside the experiment, name -> bytes.
        text: the experiment as YAML, which finds these beside it.
    """

    what: Mapping[str, Any]
    code: Mapping[str, str]
    copies: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    text: str = field(default="", repr=False)

    @property
    def digest(self) -> str:
        """Short name of what the study is."""
        return _digest(self.what)

    @property
    def code_digest(self) -> str:
        """Short name of the code."""
        return _digest(self.code)


def identify(config: ExperimentConfig, settings: Mapping[str, Any]) -> Identity:
    """Return the identity of a study of an experiment.

    Args:
        config: of the experiment.
        settings: what was asked besides, plain data.

    Raises:
        RolloutError: when a file that the experiment names cannot be read.
    """
    import yaml

    text, copies = portable(config)
    contents = dict(copies)
    if config.robot.name in robots.names():
        contents[config.robot.name] = robots.locate(config.robot.name)[0].read_bytes()
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    what = {"experiment": yaml.safe_load(text), "files": hashes, **settings}
    return Identity(json.loads(json.dumps(what)), code(), copies, text)


@lru_cache(maxsize=1)
def _sources() -> str:
    """Return a hash of the sources of the package that compute."""
    root = Path(__file__).parent.parent
    found = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        parts = path.relative_to(root).parts
        if path.suffix in (".py", ".h", ".c") and parts[0] not in _SHOWS:
            found.update("/".join(parts).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


def code() -> dict[str, str]:
    """Return which code runs here: versions of what computes, a hash of its sources, and the compiler."""
    try:
        compiler = build.compiler().version.partition("\n")[0].strip()
    except BackendError:
        compiler = "none"
    return {**versions(), "sources": _sources(), "compiler": compiler}


def claim(folder: Path, identity: Identity, name: str, accept_code: bool = False) -> bool:
    """Make a folder that of a study, or find that it is: with its experiment and copies of all files.

    Args:
        folder: which.
        identity: of the study.
        name: of the experiment file.
        accept_code: go on with what other code has begun; the folder keeps which.

    Returns:
        Whether it was there already.

    Raises:
        RolloutError: when the folder holds another study, one of other code, or something else; it says what
            differs.
    """
    place = folder / IDENTITY
    if place.exists():
        known = kept(folder)
        if known["digest"] != identity.digest:
            said = ", ".join(_differences(known["what"], identity.what)) or "its files"
            raise RolloutError(f"{folder}: holds another study ({said}); choose another folder")
        if identity.code_digest not in known["codes"]:
            said = ", ".join(_differences(list(known["codes"].values())[-1], identity.code))
            if not accept_code:
                remedy = "choose another folder, or go on all the same with --accept-code"
                raise RolloutError(f"{folder}: was run by other code ({said}); {remedy}")
            _write(folder, {**known, "codes": {**known["codes"], identity.code_digest: dict(identity.code)}})
        return True
    others = ("rollout.nc", "experiment.yaml", "study.yaml", "contest.json")
    for other in others:
        if (folder / other).exists() and not _same(folder / other, identity.text if other == name else None):
            raise RolloutError(f"{folder}: holds something else ({other}); choose another folder")
    files.make_folder(folder)
    for copy, content in identity.copies.items():
        files.write(folder / copy, content)
    if identity.text:
        files.write(folder / name, identity.text)
    codes = {identity.code_digest: dict(identity.code)}
    _write(folder, {"digest": identity.digest, "what": identity.what, "codes": codes})
    return False


def kept(folder: Path) -> dict[str, Any]:
    """Return what a folder says of its study: `digest`, `what`, and `codes` by their digests.

    Raises:
        RolloutError: when there is none, or it is damaged.
    """
    place = folder / IDENTITY
    try:
        if not place.is_file() or place.stat().st_size > _MOST:
            raise RolloutError(f"{folder}: holds no study")
        known = json.loads(place.read_text(encoding="utf-8"))
        if known["digest"] != _digest(dict(known["what"])) or not known["codes"]:
            raise ValueError
        if any(name != _digest(each) for name, each in known["codes"].items()):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RolloutError(f"{place}: is damaged, or of another version; choose another folder") from None
    return dict(known)


def write_chunk(place: Path, array: Array, identity: Identity, name: str) -> Path:
    """Write numbers with what they are part of, and their hash.

    Args:
        place: the file.
        array: of numbers, any shape.
        identity: of the study.
        name: of this part of it: a file in the place of another is refused.

    Raises:
        RolloutError: when it cannot be written.
    """
    content = np.ascontiguousarray(array, dtype="<f8").tobytes()
    head = {"study": identity.digest, "code": identity.code_digest, "name": name, "shape": array.shape}
    head["sha256"] = _hash(head, content)
    line = json.dumps(head).encode() + b"\n"
    out = io.BytesIO()
    out.write(line)
    out.write(content)
    return files.write(place, out.getvalue())


def read_chunk(place: Path, shape: tuple[int, ...], study: str, codes: Mapping[str, Any], name: str) -> Array:
    """Return numbers that :func:`write_chunk` wrote.

    Args:
        place: the file.
        shape: that they must have.
        study: digest of the study that they must be part of.
        codes: the codes that may have run it, by their digests.
        name: of this part.

    Raises:
        RolloutError: when they are damaged, or of something else.
    """
    remedy = "remove it, and run the sweep again"
    size = math.prod(shape) * 8
    try:
        if not size < place.stat().st_size <= size + _HEAD:
            raise ValueError
        with place.open("rb") as file:
            head = json.loads(file.readline(_HEAD))
            content = file.read(size + 1)
        whole = len(content) == size and head.pop("sha256") == _hash(head, content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        whole = False
    if not whole:
        raise RolloutError(f"{place}: is damaged; {remedy}")
    if (head["study"], head["name"], tuple(head["shape"])) != (study, name, shape):
        raise RolloutError(f"{place}: is part of another study; {remedy}")
    if head["code"] not in codes:
        raise RolloutError(f"{place}: was run by other code; {remedy}")
    return np.frombuffer(content, dtype="<f8").reshape(shape)


def seal(data: Mapping[str, Any], key: str) -> str:
    """Return plain data as JSON with a hash of it and of what it is part of."""
    return json.dumps({**data, "sha256": _sealed(data, key)}, indent=1) + "\n"


def unseal(path: Path, key: str) -> dict[str, Any]:
    """Return plain data that :func:`seal` wrote.

    Raises:
        RolloutError: when it is damaged, or part of something else.
    """
    try:
        if path.stat().st_size > _MOST:
            raise ValueError
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if data.pop("sha256") != _sealed(data, key):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RolloutError(f"{path}: is damaged, or part of something else; remove it") from None
    return data


def _sealed(data: Mapping[str, Any], key: str) -> str:
    return hashlib.sha256(f"{key} {json.dumps(data, sort_keys=True)}".encode()).hexdigest()


def _hash(head: Mapping[str, Any], content: bytes) -> str:
    """Return the hash of a chunk."""
    return hashlib.sha256(json.dumps(head, sort_keys=True).encode() + content).hexdigest()


def _digest(data: Any) -> str:
    """Return a short name of plain data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _write(folder: Path, data: Mapping[str, Any]) -> None:
    files.write(folder / IDENTITY, json.dumps(data, indent=1) + "\n")


def _same(path: Path, text: str | None) -> bool:
    """Tell whether a file has a text: that of a study which was killed before its last file."""
    try:
        return text is not None and path.read_text(encoding="utf-8") == text
    except (OSError, ValueError):
        return False


def _differences(there: Any, here: Any) -> list[str]:
    """Return in words what differs between two sets of plain data, the first ones."""
    a, b = dict(_flat(there)), dict(_flat(here))
    names = [name for name in {**a, **b} if a.get(name) != b.get(name)]
    # The experiment says it already where a file has another name.
    words = [
        name.replace("files.", "the bytes of ")
        if name.startswith("files.")
        else f"{name.removeprefix('experiment.')}: {_short(a.get(name))} there, {_short(b.get(name))} here"
        for name in names
    ]
    return words[:_TOLD] + (["..."] if len(words) > _TOLD else [])


def _flat(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of plain data with its path of keys."""
    if isinstance(data, Mapping | list) and data:
        for key, value in data.items() if isinstance(data, Mapping) else enumerate(data):
            yield from _flat(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, data


def _short(value: Any) -> str:
    """Return a value, cut where it is long."""
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
