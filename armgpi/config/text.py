"""The text of an experiment file as plain data, with the lines of its keys: YAML, within bounds."""

from __future__ import annotations

import re
from itertools import chain
from typing import Any

import yaml

from armgpi.errors import ConfigError

#: Most keys and values of a file, aliases written out, and the longest of them [characters].
_MAX_NODES = 100_000
_MAX_TEXT = 10_000
#: Characters that no text has: zero, and halves of UTF-16's pairs.
_NO_TEXT = re.compile("[\0\ud800-\udfff]")
#: What PyYAML says is wrong -> what to do.
_WAYS = {
    "'\\t'": "indent with spaces",
    "mapping values": "put each key on a line of its own, a text with ':' in quotes",
    "constructor": "leave the tag out",
    "undefined alias": "write its value out",
}


def parse_text(text: str, source: str) -> tuple[dict[str, Any], dict[tuple[str | int, ...], int]]:
    """Return the text of a file as plain data, and the line of each key by its path.

    Raises:
        ConfigError: when it is no YAML mapping, or too large.
    """
    try:
        loader = yaml.SafeLoader(text)
        tree = loader.get_single_node()
        lines: dict[tuple[str | int, ...], int] = {}
        data = None
        if tree is not None:
            _check_size(tree, {}, source)
            _note_lines(tree, (), lines, source)
            data = loader.construct_document(tree)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        way = next((way for what, way in _WAYS.items() if what in str(error.problem)), "correct that line")
        raise ConfigError(source, "", f"is not valid YAML: {error.problem}; {way}", line) from None
    except RecursionError:
        raise ConfigError(source, "", "is not valid YAML: nested too deeply") from None
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        # PyYAML lets errors of Python through, for a date such as 2020-13-45.
        reason = " ".join(str(error).split())
        raise ConfigError(source, "", f"is not valid YAML: {reason}") from None
    if not isinstance(data, dict):
        what = "is empty" if data is None else f"is a {type(data).__name__}"
        said = f"{what}; expected a mapping with the keys robot, plant, ...: `armgpi new ROBOT` writes one"
        raise ConfigError(source, "", said)
    return data, lines


def _check_size(node: Any, sizes: dict[int, int], source: str) -> int:
    """Return how many keys and values a YAML node has, aliases and merged mappings written out.

    Aliases of aliases make a small file explode, so that is counted before anything is written out, visiting
    each node once.

    Raises:
        ConfigError: when they are too many, one is too long or contains itself, or is no text.
    """
    line = node.start_mark.line + 1
    known = sizes.get(id(node))
    if known == 0:
        raise ConfigError(source, "", "is an alias of something that it is in; write it out", line)
    if known is not None:
        return known
    if isinstance(node, yaml.ScalarNode):
        if len(node.value) > _MAX_TEXT:
            raise ConfigError(source, "", f"is a value of more than {_MAX_TEXT} characters", line)
        if _NO_TEXT.search(node.value):
            raise ConfigError(source, "", f"{node.value!r} has a character that no text has", line)
        return 1
    inside: list[Any] = (
        [*chain.from_iterable(node.value)] if isinstance(node, yaml.MappingNode) else node.value
    )
    sizes[id(node)] = 0  # being counted
    size = 1 + sum(_check_size(child, sizes, source) for child in inside)
    if size > _MAX_NODES:
        raise ConfigError(source, "", f"has more than {_MAX_NODES} keys and values", line)
    sizes[id(node)] = size
    return size


def _note_lines(
    node: Any, path: tuple[str | int, ...], lines: dict[tuple[str | int, ...], int], source: str
) -> None:
    """Note the line of every key of a YAML tree, refusing duplicate keys."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*path, str(key.value))
            line = key.start_mark.line + 1
            if here in lines and key.tag != "tag:yaml.org,2002:merge":
                raise ConfigError(source, ".".join(map(str, here)), "is a duplicate key; leave one", line)
            lines[here] = line
            _note_lines(value, here, lines, source)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            here = (*path, index)
            lines[here] = value.start_mark.line + 1
            _note_lines(value, here, lines, source)
