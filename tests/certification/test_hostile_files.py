"""Files that are no certificate, or claim what they do not show: one line, exit code 2, in bounded time."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from commands import Answer

import armgpi
from armgpi.certification import check_certificate
from armgpi.certification.certificate import seal
from armgpi.certification.refute import refute

checker: Any = check_certificate


@pytest.fixture(scope="module")
def robot() -> armgpi.Robot:
    return armgpi.Robot.load("anthropomorphic3").with_armature(0.1)


@pytest.fixture(scope="module")
def data(robot: armgpi.Robot) -> Any:
    return armgpi.certify(robot, payload=(0.0, 0.1), speed=0.2, start="held", torque=0.001).data


def put(*path: Any) -> Callable[[Any], None]:
    """Return what puts the last of a path at the rest of it."""

    def change(data: Any) -> None:
        *way, key, value = path
        for step in way:
            data = data[step]
        data[key] = value

    return change


def drop(*path: Any) -> Callable[[Any], None]:
    """Return what leaves out a part."""

    def change(data: Any) -> None:
        *way, key = path
        for step in way:
            data = data[step]
        del data[key]

    return change


GAIN = ("solutions", "gain")
HOSTILE = {
    "no solutions": put("solutions", {}),
    "solutions that are a list": put("solutions", []),
    "a claim of another kind": lambda data: data["solutions"].update(other=data["solutions"]["gain"]),
    "inputs without a solution": drop("solutions", "stated"),
    "a solution without inputs": drop("inputs", "stated"),
    "no claims": put(*GAIN, "claims", {}),
    "a claim left out": drop(*GAIN, "claims", "torques"),
    "a surplus claim": put(*GAIN, "claims", "jerk", ["1"]),
    "empty errors": put(*GAIN, "claims", "errors", []),
    "a seventh joint": lambda data: data["solutions"]["gain"]["claims"]["errors"].append("1"),
    "NaN": put(*GAIN, "claims", "errors", 0, "nan"),
    "infinity": put(*GAIN, "claims", "errors", 0, "inf"),
    "a float": put(*GAIN, "P", 0, 0, 1.0),
    "an integer": put(*GAIN, "alpha", 1),
    "a huge exponent": put(*GAIN, "alpha", "1e9999999999"),
    "a long number": put(*GAIN, "alpha", "1" * 5000),
    "a fraction by zero": put(*GAIN, "alpha", "1/0"),
    "other digits": put(*GAIN, "alpha", "\u0661"),
    "a number missing": drop("numbers", "kappa_v"),
    "a number too many": put("numbers", "kappa_x", "0"),
    "a negative number": put("numbers", "kappa_v", "-1"),
    "delta's ends the wrong way round": put("numbers", "delta_low", "9"),
    "no joints": put("robot", "joints", []),
    "another number of joints": put("limits", "effort", ["1"]),
    "lower ends above": put("limits", "lower", ["9", "9", "9"]),
    "another format": put("format", "armgpi certificate 1"),
    "no format": drop("format"),
    "no seal": drop("seal"),
    "a law with coefficients": put("law", "coefficients", [["1"]]),
    "four integrators": put("law", "integrators", 4),
    "true integrators": put("law", "integrators", True),
    "a long delay": put("law", "delay", 10**9),
    "bandwidths that fall": put("law", "omega", ["30", "20"]),
    "a million bandwidths": put("law", "omega", [str(x) for x in range(1, 20_000)]),
    "a section that is a list": put("law", []),
    "a robot that is none": put("robot", None),
    "a moving reference that adds nothing": put("limits", "velocity", ["1", "1", "1"]),
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("sealed", [False, True])
def test_what_claims_nothing_or_too_much_is_refused(
    data: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, sealed: bool
) -> None:
    """As it is, and under a new seal, which anybody can make."""
    other = copy.deepcopy(data)
    HOSTILE[name](other)
    if sealed and "seal" in other:
        other["seal"] = seal(other)
    path = tmp_path / "other.json"
    path.write_text(json.dumps(other), encoding="utf-8")
    assert checker.main([str(path)]) == 2
    assert len(capsys.readouterr().out.splitlines()) == 1
    assert checker.check(other)


#: What anything in a file is replaced by; beside that, it is left out.
ODD: tuple[Any, ...] = (
    None,
    True,
    -1,
    1.5,
    "nan",
    "-inf",
    "1e9999999999",
    "1" * 5000,
    "\u0661",
    "",
    [],
    [[]],
    {},
    {"x": []},
)
#: Parts that the checker does not read: who makes a file says what is in them.
UNREAD = "robot", "assumptions", "status", "shares"
#: Parts that what refutes reads whole.
READ = "law", "numbers", "limits"


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Give the path of everything in a file."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*path, key)
        yield from places(data[key], (*path, key))


def alterations(data: Any) -> list[tuple[tuple[Any, ...], Callable[[Any], None]]]:
    """Return where a file is altered, and how."""
    return [(at, change) for at in places(data) for change in (drop(*at), *(put(*at, x) for x in ODD))]


def survive(data: Any, robot: armgpi.Robot, some: slice) -> dict[str, int]:
    """Alter a file under a new seal, and return how often the checker and what refutes ended how."""
    ends = {"refused by the checker": 0, "refused by --refute": 0, "holds": 0}
    for at, change in alterations(data)[some]:
        other = copy.deepcopy(data)
        change(other)
        if at != ("seal",):
            other["seal"] = seal(other)
        try:
            wrong = checker.verify(other)
            said = checker.describe(other)
        except checker.ERRORS:
            ends["refused by the checker"] += 1
            assert at[0] not in READ or not refuted(other, robot), at
            continue
        assert said, at
        assert not wrong, at
        assert at[0] in UNREAD, at
        ends["holds" if refuted(other, robot) else "refused by --refute"] += 1
    return ends


def refuted(data: Any, robot: armgpi.Robot) -> bool:
    """Tell whether what refutes takes a file; it ends in one of our errors, of one line, if not."""
    try:
        refute(armgpi.Certificate(data), robot, count=1)
    except armgpi.errors.ArmgpiError as error:
        return "\n" in str(error)
    return True


def test_there_are_more_than_1400_alterations_and_some_are_tried(data: Any, robot: armgpi.Robot) -> None:
    assert len(alterations(data)) >= 1400
    ends = survive(data, robot, slice(None, None, 29))
    assert sum(ends.values()) >= 50, ends


@pytest.mark.search
@pytest.mark.parametrize("part", range(16))
def test_all_alterations_end_in_one_line(data: Any, robot: armgpi.Robot, part: int) -> None:
    """With -s, it prints how many there were, and how they ended."""
    ends = survive(data, robot, slice(part, None, 16))
    print(f"{sum(ends.values())} of {len(alterations(data))} alterations: {ends}")


TEXTS = {
    "nothing": b"",
    "no JSON": b"{",
    "a list": b"[]",
    "a number": b"1",
    "NaN": b"NaN",
    "deep": b"[" * 200_000,
    "a long integer": b"1" * 100_000,
    "bytes": b"\xff\xfe\x00",
    "a key twice": b'{"format": 1, "format": 1}',
    "too large": b" " * (checker.BYTES + 1),
}


@pytest.mark.parametrize("name", TEXTS)
def test_what_is_no_certificate_ends_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    path = tmp_path / "other.json"
    path.write_bytes(TEXTS[name])
    assert checker.main([str(path)]) == 2
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("name", [*TEXTS, *HOSTILE])
def test_what_refutes_refuses_it_likewise(
    data: Any, tmp_path: Path, cli: Callable[..., Answer], name: str
) -> None:
    path = tmp_path / "other.json"
    if name in TEXTS:
        path.write_bytes(TEXTS[name])
    else:
        other = copy.deepcopy(data)
        HOSTILE[name](other)
        if "seal" in other:
            other["seal"] = seal(other)
        path.write_text(json.dumps(other), encoding="utf-8")
    answer = cli("certify", "anthropomorphic3", "--rotor-inertia", "0.1", "--refute", path)
    assert answer.code == 2
    assert not answer.out
    assert len(answer.err.splitlines()) == 1


def test_a_pipe_a_folder_and_nothing_are_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for paths in ([pipe], [tmp_path], [tmp_path / "none"], []):
        program = [sys.executable, "-I", "-S", checker.__file__, *map(str, paths)]
        run = subprocess.run(program, capture_output=True, text=True, timeout=200)
        assert run.returncode == 2, run.stderr
        assert not run.stderr


def test_all_that_does_not_hold_is_said(
    data: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    monkeypatch.setattr(checker, "verify", lambda _: ["this", "and that"])
    assert checker.main([str(path)]) == 1
    assert capsys.readouterr().out == f"{path} DOES NOT HOLD: this; and that\n"


def test_what_holds_is_said(data: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert checker.main([str(path)]) == 0
    said = capsys.readouterr().out
    for part in (
        "anthropomorphic3",
        data["robot"]["sha256"],
        "at rest",
        "held",
        "rigid",
        "box",
        "omega",
        "'gain'",
    ):
        assert part in said
    assert all(x in said for x in data["solutions"]["stated"]["claims"]["errors"])
    verified, _, taken = said.partition("TAKEN FROM THE FILE, not verified:")
    assert "VERIFIED here:" in verified
    # What is verified are the claims; the arm and its numbers are what the file says.
    assert "claim 'stated'" in verified
    assert "claim" not in taken
    assert "the numbers of the arm" in taken
    assert "kappa_v" in taken


def test_a_certificate_is_as_large_as_is_said_and_no_larger(
    data: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    facts = checker.facts(data)
    rows = 12 + sum(data["law"][key] for key in checker.WHOLE)
    bounds = {"JOINTS": len(facts["hold"]), "WORK": len(facts["omega"]) * rows**3}
    for name, most in bounds.items():
        with monkeypatch.context() as patch:
            patch.setattr(checker, name, most)
            assert checker.facts(data) == facts
            patch.setattr(checker, name, most - 1)
            with pytest.raises(checker.Refused):
                checker.facts(data)
    monkeypatch.setattr(checker, "BYTES", path.stat().st_size)
    assert checker.read(path) == data
    monkeypatch.setattr(checker, "BYTES", path.stat().st_size - 1)
    with pytest.raises(checker.Refused, match="no regular file of at most"):
        checker.read(path)


def test_what_is_missing_or_unknown_in_a_file_is_named(
    data: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], cli: Callable[..., Answer]
) -> None:
    without = {key: part for key, part in data.items() if key != "seal"}
    shorter = copy.deepcopy(data)
    del shorter["numbers"]["sigma"], shorter["numbers"]["jump"]
    shorter["seal"] = seal(shorter)
    cases = (
        (without, "a certificate has no seal"),
        ({**data, "more": 1}, "a certificate has more, which no certificate has there"),
        (shorter, "numbers has no jump, sigma"),
        ({**data, "law": 1}, "law has to be a mapping with"),
    )
    path = tmp_path / "other.json"
    for other, said in cases:
        if "seal" in other:
            other = {**other, "seal": seal(other)}
        path.write_text(json.dumps(other), encoding="utf-8")
        assert checker.main([str(path)]) == 2
        assert said in capsys.readouterr().out
    path.write_text(json.dumps(without), encoding="utf-8")
    answer = cli("certify", "anthropomorphic3", "--rotor-inertia", "0.1", "--refute", path)
    assert (answer.code, "has no seal" in answer.err) == (2, True)


def test_numbers_that_were_verified_are_listed_as_they_are_in_the_file(data: Any, tmp_path: Path) -> None:
    lines = checker.describe(data)
    count = len(data["law"]["omega"])
    assert f"at {count} bandwidth{'s' if count > 1 else ''} and both ends" in lines[1]
    errors = ", ".join(data["solutions"]["gain"]["claims"]["errors"])
    assert any(f"claim 'gain': {errors} rad or m at most" in line for line in lines)
    one = copy.deepcopy(data)
    one["law"]["omega"] = ["30.0"]
    assert "at 1 bandwidth and both ends" in checker.describe(one)[1]
    one["law"]["omega"] = ["30.0", "31.0"]
    assert "at 2 bandwidths and both ends" in checker.describe(one)[1]
