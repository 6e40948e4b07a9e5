"""The text of a YAML file as plain data, with the lines of its keys, within bounds.

YAML 1.1, which PyYAML reads, and YAML 1.2 differ in what some plain words are. Here `yes`, `no`, `on` and
`off` are text, as in YAML 1.2, which a key that is true or false takes as well; numbers that only one of them
has (``1:30`` is 90, ``010`` is 8) are refused.
"""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from armgpi.base import files
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


#: Numbers of YAML 1.1 that are others, or text, in YAML 1.2: base 60, and base 8 by a leading zero.
_BASE_60 = re.compile(r"[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?")
_BASE_8 = re.compile(r"[-+]?0[0-7_]+")


class Parsed(NamedTuple):
    """A text as plain data, and the line of each key by its path."""

    data: Any
    lines: dict[tuple[str | int, ...], int]


class _Loader(yaml.SafeLoader):
    """Reads YAML with `true` and `false` as its only words for that, and counts what it reads."""

    yaml_implicit_resolvers = {  # noqa: RUF012 (as PyYAML has it)
        first: [(tag, pattern) for tag, pattern in each if tag != "tag:yaml.org,2002:bool"]
        for first, each in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    count = 0
    source = ""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Read a key or value, of which there may not be too many: a large file takes long."""
        self.count += 1
        if self.count > _MAX_NODES:
            raise ConfigError(self.source, "", f"has more than {_MAX_NODES} keys and values", self.line + 1)
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"true|True|TRUE|false|False|FALSE"), list("tTfF")
)


def read_yaml(path: Path, most: int) -> Any:
    """Return a YAML or JSON file of at most so many bytes as plain data; errors as :func:`parse`.

    Raises:
        ConfigError: when it cannot be read, too.
    """
    try:
        return parse(files.read_text(path, most), str(path)).data
    except UnicodeDecodeError:
        raise ConfigError(path, "", "cannot be read: it is not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise ConfigError(path, "", f"cannot be read: {files.reason(error)}") from None


def parse(text: str, source: str) -> Parsed:
    """Return the text of a file as plain data, and the line of each key by its path.

    Raises:
        ConfigError: when it is no YAML, or too large.
    """
    try:
        loader = _Loader(text)
        loader.source = source
        tree = loader.get_single_node()
        lines: dict[tuple[str | int, ...], int] = {}
        if tree is None:
            return Parsed(None, lines)
        _check_size(tree, {}, source)
        _note_lines(tree, (), lines, source)
        return Parsed(loader.construct_document(tree), lines)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        way = next((way for what, way in _WAYS.items() if what in str(error.problem)), "correct that line")
        raise ConfigError(source, "", f"is not valid YAML: {error.problem}; {way}", line) from None
    except RecursionError:
        raise ConfigError(source, "", "is not valid YAML: nested too deeply") from None
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        # PyYAML lets errors of Python through, for a date such as 2020-13-45.
        raise ConfigError(source, "", f"is not valid YAML: {files.reason(error)}") from None


def parse_text(text: str, source: str) -> tuple[dict[str, Any], dict[tuple[str | int, ...], int]]:
    """Return the text of an experiment, or another mapping, as :func:`parse` does.

    Raises:
        ConfigError: when it is no YAML mapping, or too large.
    """
    data, lines = parse(text, source)
    if not isinstance(data, dict):
        what = "is empty" if data is None else f"is a {type(data).__name__}"
        said = f"{what}; expected a mapping with the keys robot, plant, ...: `armgpi new ROBOT` writes one"
        raise ConfigError(source, "", said)
    return data, lines


def _check_number(node: Any, source: str) -> None:
    """Refuse a number that YAML 1.1 and 1.2 read differently."""
    if node.style is not None or not node.tag.endswith((":int", ":float")):
        return
    sixty = _BASE_60.fullmatch(node.value)
    if sixty or _BASE_8.fullmatch(node.value):
        base = 60 if sixty else 8
        raise ConfigError(
            source,
            "",
            f"{node.value} is a number of base {base} in YAML 1.1, and is none in YAML 1.2; write a plain "
            "decimal number, or text in quotes",
            node.start_mark.line + 1,
        )


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
        _check_number(node, source)
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
