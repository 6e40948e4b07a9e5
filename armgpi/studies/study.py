"""A study: what was asked, which code runs it, and a folder whose parts are each run once.

What was asked is plain data and the bytes of every file that it names. The code is the package with its
sources, what it computes with, and the compiler. Both have a short name (digest). A part is an array of
numbers in a file of its own (a chunk): of rollouts, of a level of rare ones, of a generation of candidates.
It carries both names and its own hash, so that numbers of two arms, or of two versions, are never taken for
those of one.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from armgpi import registry
from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.version import other_format
from armgpi.codegen import build
from armgpi.config.experiment import portable
from armgpi.config.schema import ExperimentConfig
from armgpi.errors import BackendError, RolloutError
from armgpi.loop.provenance import versions
from armgpi.robot import robots

#: The file of a folder that says what study it holds, and its format.
IDENTITY, FORMAT = "study.json", 1
#: Packages whose sources no number of a study depends on.
_SHOWS = {"cli", "viewing", "hardware", "validation", "paper"}
#: Largest file of identity [bytes].
_MOST = 10_000_000
#: Longest first line of a chunk [bytes].
_HEAD = 4096
#: Size of a number of a chunk [bytes].
_BYTES = 8
#: Differences that are told.
_TOLD = 3
#: Whatever else marks a folder as that of a run or of a study of an earlier version.
_OTHERS = ("rollout.nc", "experiment.yaml", "study.yaml", "contest.json")


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
    code: Mapping[str, str] = field(default_factory=lambda: code())
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

    full, copies = portable(config)
    text, _ = portable(config, full=False)  # in which a rule chooses again what nobody set
    contents = dict(copies)
    for arm in (config.robot.name, *(law.nominal for law in config.controllers)):
        if arm in robots.names():
            contents[arm] = robots.locate(arm)[0].read_bytes()
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    what = {"experiment": yaml.safe_load(full), "files": hashes, **settings}
    return Identity(json.loads(json.dumps(what)), code(), copies, text)


@lru_cache(maxsize=1)
def _sources() -> str:
    """Return a hash of the sources that compute: of the package without what shows, and of plugins."""
    digest = hashlib.sha256()
    packages = {plugin.partition(".")[0] for plugin in registry.plugins()}
    for package in sorted({"armgpi", *packages}):
        spec: Any = find_spec(package)
        for root in map(Path, spec.submodule_search_locations or [spec.origin]):
            for path in sorted([root, *root.rglob("*")]):
                parts = path.relative_to(root.parent).parts
                only_shows = package == "armgpi" and not _SHOWS.isdisjoint(parts[1:2])
                if path.suffix in (".py", ".h", ".c", ".yaml") and not only_shows:
                    name = "/".join(parts).encode()
                    digest.update(name + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def code() -> dict[str, str]:
    """Return which code runs here: versions of what computes, a hash of its sources, and the compiler."""
    try:
        compiler = build.compiler().version.partition("\n")[0].strip()
    except BackendError:
        compiler = "none"
    return {**versions("scipy", "casadi"), "sources": _sources(), "compiler": compiler}


#: Shape of a part; None for any size, of a part that is small.
Shape = tuple[int | None, ...]


class BadPart(RolloutError):
    """A part that is there is damaged, or not of this study."""


class NoRoom(RolloutError):
    """A part cannot be written, and so none can."""


class Part(Protocol):
    """What gives the numbers of a part of a study: those that are kept, or those that `run` gives."""

    def __call__(self, name: str, shape: Shape, run: Callable[[], Array]) -> Array:
        """Return the numbers of a part by its name, of a shape."""


def unkept(name: str, shape: Shape, run: Callable[[], Array]) -> Array:
    """Run a part of a study that has no folder; a :class:`Part`."""
    return run()


_Row = TypeVar("_Row")


def rows(part: Part, name: str, kind: Callable[..., _Row], run: Callable[[], Sequence[_Row]]) -> list[_Row]:
    """Return rows of plain data that are a part of a study: the codes of their text in JSON.

    Args:
        part: keeps it.
        name: of the part.
        kind: a named tuple, or what makes a row of the values of one.
        run: gives the rows where they are not there.

    Raises:
        RolloutError: when the part cannot be read or written.
        ArmgpiError: as `run`.
    """

    def run_as_codes() -> Array:
        text = json.dumps(run()).encode()
        return np.array([*text], dtype=float)

    codes = part(name, (None,), run_as_codes)
    try:
        text = bytes(map(int, codes))
        return [kind(*row) for row in json.loads(text)]
    except (ValueError, OverflowError, TypeError, RecursionError):
        raise BadPart(f"{name}: holds no rows; remove it, and run again") from None


def part_name(arm: str, *parts: object) -> str:
    """Return the name of a part of an arm, which the bytes of its URDF are in."""
    urdf, _ = robots.locate(arm)
    content = hashlib.sha256(urdf.read_bytes()).hexdigest()[:8]
    name = "/".join([f"{Path(arm).stem}-{content}", *map(str, parts)])
    return name.replace(" ", "_").replace(",", "").replace("+", "plus")


@dataclass(frozen=True)
class Study:
    """A folder with an identity, and its parts.

    Attributes:
        folder: where.
        identity: what it is, and the code that runs here.
        codes: codes that may have run its parts, by their digests.
        there: whether it was there before it was entered.
    """

    folder: Path
    identity: Identity
    codes: Mapping[str, Any]
    there: bool = True

    @classmethod
    def enter(cls, folder: Path, identity: Identity, name: str = "", accept_code: bool = False) -> Study:
        """Make a folder that of a study, or find that it is: with its experiment and copies of all files.

        Args:
            folder: which.
            identity: of the study.
            name: of the experiment file.
            accept_code: go on with what other code has begun; the folder keeps which.

        Raises:
            RolloutError: when the folder holds another study, one of other code, or something else; it says
                what differs.
        """
        there = (folder / IDENTITY).exists()
        if there and not _is_begun(folder) and not _is_same(folder, identity):
            for left in (IDENTITY, name):  # of a start that failed: nothing was run
                (folder / left).unlink(missing_ok=True)
            there = False
        codes: Mapping[str, Any] = {identity.code_digest: dict(identity.code)}
        if there:
            codes = _known_codes(folder, identity, accept_code)
        else:
            _check_free(folder, identity, name)
        files.make_folder(folder)
        contents = dict(identity.copies)
        if identity.text:
            contents[name] = identity.text.encode()
        for copy, content in contents.items():
            if not (there and (folder / copy).exists()):
                files.write(folder / copy, content)
        if not there:
            facts = {"digest": identity.digest, "what": identity.what, "codes": codes}
            _write(folder, {"format": FORMAT, **facts})
        return cls(folder, identity, codes, there)

    @property
    def begun(self) -> bool:
        """Whether a part is there: a folder without any is no study that could be lost."""
        return _is_begun(self.folder)

    def place(self, name: str) -> Path:
        """Return the file of a part."""
        return self.folder / f"{name}.chunk"

    def has(self, name: str) -> bool:
        """Tell whether a part is there."""
        return self.place(name).is_file()

    def part(self, name: str, shape: Shape, run: Callable[[], Array]) -> Array:
        """Return the numbers of a part; where it is not there, run it and write it whole. A :class:`Part`.

        Raises:
            BadPart: when it is damaged, or of another study or other code.
            NoRoom: when it cannot be written.
        """
        if self.has(name):
            return self.read(name, shape)
        return self.write(name, run())

    def write(self, name: str, array: Array) -> Array:
        """Write the numbers of a part and return them.

        Raises:
            NoRoom: when it cannot be written.
        """
        content = np.ascontiguousarray(array, dtype="<f8").tobytes()
        head: dict[str, Any] = {
            "study": self.identity.digest,
            "code": self.identity.code_digest,
            "name": name,
            "shape": array.shape,
        }
        head["sha256"] = _hash(head, content)
        place = self.place(name)
        try:
            files.make_folder(place.parent)
            files.write(place, json.dumps(head).encode() + b"\n" + content)
        except RolloutError as error:
            raise NoRoom(str(error)) from None
        return array

    def read(self, name: str, shape: Shape) -> Array:
        """Return the numbers of a part that is there.

        Raises:
            BadPart: when it is damaged, or of another study or other code.
        """
        place = self.place(name)
        remedy = "remove it, and run again"
        most = _MOST if None in shape else _BYTES * math.prod(filter(None, shape))
        try:
            with files.open_regular(place, most + _HEAD) as file:
                head = json.loads(file.readline(_HEAD))
                content = file.read(most + 1)
            is_as_written = head.pop("sha256") == _hash(head, content)
            is_whole = is_as_written and len(content) == _BYTES * math.prod(head["shape"])
            fits = _fits(shape, head["shape"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            is_whole = False
        if not is_whole:
            raise BadPart(f"{place}: is damaged; {remedy}")
        is_of_this_study = head["study"] == self.identity.digest and head["name"] == name
        if not is_of_this_study or not fits:
            raise BadPart(f"{place}: is part of another study; {remedy}")
        if head["code"] not in self.codes:
            raise BadPart(f"{place}: was run by other code; {remedy}")
        return np.frombuffer(content, dtype="<f8").reshape(head["shape"])


def _fits(shape: Shape, there: Sequence[int]) -> bool:
    """Tell whether what is there has a shape."""
    if len(there) != len(shape):
        return False
    return all(size in (None, size_there) for size, size_there in zip(shape, there, strict=True))


def _is_begun(folder: Path) -> bool:
    """Tell whether a study in a folder has a part."""
    return any(folder.rglob("*.chunk"))


def _is_same(folder: Path, identity: Identity) -> bool:
    """Tell whether a folder holds a study of the same digest, or one that is damaged: that is said later."""
    try:
        return bool(read_identity(folder)["digest"] == identity.digest)
    except RolloutError:
        return True


def _check_free(folder: Path, identity: Identity, name: str) -> None:
    """Refuse a folder that holds files which a study would have, others than its own experiment."""
    for other in _OTHERS:
        path = folder / other
        if not path.exists():
            continue
        with suppress(OSError, ValueError):
            if path.name == name and files.read_text(path, _MOST) == identity.text:
                continue  # of a study that was killed before its last file
        raise RolloutError(
            f"{folder}: holds something else ({path.name}); choose another folder: --out FOLDER"
        )


def _known_codes(folder: Path, identity: Identity, accept_code: bool) -> Mapping[str, Any]:
    """Return the codes that may have run the parts of a folder, which is that of a study.

    Raises:
        RolloutError: when it is another study, or other code ran it; it says what differs.
    """
    known = read_identity(folder)
    if known["digest"] != identity.digest:
        differences = ", ".join(_differences(known["what"], identity.what)) or "its files"
        raise RolloutError(
            f"{folder}: holds another study ({differences}); choose another folder: --out FOLDER"
        )
    codes: dict[str, Any] = known["codes"]
    if identity.code_digest not in codes:
        last_code = list(codes.values())[-1]
        differences = ", ".join(_differences(last_code, identity.code))
        if not accept_code:
            remedy = "choose another folder (--out FOLDER), or go on all the same with --accept-code"
            raise RolloutError(f"{folder}: was run by other code ({differences}); {remedy}")
        codes = {**codes, identity.code_digest: dict(identity.code)}
        _write(folder, {**known, "codes": codes})
    return codes


def read_identity(folder: Path) -> dict[str, Any]:
    """Return what a folder says of its study: `digest`, `what`, and `codes` by their digests.

    Raises:
        RolloutError: when there is none, it is damaged, or it has another format.
    """
    place = folder / IDENTITY
    try:
        if not place.is_file():
            raise RolloutError(f"{folder}: holds no study")
        known = json.loads(files.read_bytes(place, _MOST))
        version = known.get("format")
        if version != FORMAT:
            raise RolloutError(f"{place}: {other_format(version, FORMAT)}; choose another folder")
        if known["digest"] != _digest(dict(known["what"])) or not known["codes"]:
            raise ValueError
        for digest, ran in known["codes"].items():
            if digest != _digest(ran):
                raise ValueError
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RolloutError(f"{place}: is damaged; choose another folder") from None
    return dict(known)


def _hash(head: Mapping[str, Any], content: bytes) -> str:
    """Return the hash of a chunk."""
    text = json.dumps(head, sort_keys=True).encode()
    return hashlib.sha256(text + content).hexdigest()


def _digest(data: Any) -> str:
    """Return a short name of plain data."""
    text = json.dumps(data, sort_keys=True).encode()
    return hashlib.sha256(text).hexdigest()[:16]


def _write(folder: Path, data: Mapping[str, Any]) -> None:
    files.write(folder / IDENTITY, json.dumps(data, indent=1) + "\n")


def _differences(there: Any, here: Any) -> list[str]:
    """Return in words what differs between two sets of plain data, the first ones."""
    values_there, values_here = dict(_flat(there)), dict(_flat(here))
    words = []
    for name in {**values_there, **values_here}:
        value_there, value_here = values_there.get(name), values_here.get(name)
        if value_there == value_here:
            continue
        if not name.startswith("files."):
            key = name.removeprefix("experiment.")
            words.append(f"{key}: {_short(value_there)} there, {_short(value_here)} here")
        elif name in values_here:  # a file's content is in its name: what is here tells it
            words.append(name.replace("files.", "the bytes of "))
    if len(words) > _TOLD:
        return [*words[:_TOLD], "..."]
    return words


def _flat(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of plain data with its path of keys."""
    if not isinstance(data, Mapping | list):
        yield path, data
    elif not data:
        yield path, None
    else:
        items = data.items() if isinstance(data, Mapping) else enumerate(data)
        for key, value in items:
            yield from _flat(value, f"{path}.{key}" if path else str(key))


def _short(value: Any) -> str:
    """Return a value, cut where it is long."""
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
