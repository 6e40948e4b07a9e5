"""A wrong number is named at its line, whatever holds it, also where another number is as large."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import textbooks

from armgpi import Robot, validate
from armgpi.errors import ModelError
from armgpi.validation import samples
from armgpi.validation.course import seconds_used
from armgpi.validation.diagnose import Cause
from armgpi.validation.witnesses import unread_names
from armgpi.validation.worker import Worker

EQUATIONS = """

def mass_matrix(q{arguments}):{unpacked}
    k = m2 * l1 * c2 * np.cos(q[1])
    d = I2 + m2 * c2**2
    return np.array([[I1 + m1 * c1**2 + m2 * l1**2 + d + 2 * k, d + k], [d + k, d]])


def gravity(q{arguments}):{unpacked}
    b = m2 * g * c2 * np.cos(q[0] + q[1])
    return np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + b, b])
"""
NAMES = "m1, m2, l1, c1, c2, I1, I2, g"
RIGHT = {"m1": 1.5, "m2": 1.0, "l1": 0.4, "c1": 0.2, "c2": 0.15, "I1": 0.02, "I2": 0.05, "g": 9.81}


def arm(centre: float = 0.15) -> Robot:
    """Return the robot that has these numbers; its second centre of mass may be elsewhere [m]."""
    turn, ball = textbooks._turn, textbooks._round
    joints = [
        turn("0 -1 0", (0, 0, 0), 1.5, (0.2, 0, 0), ball(0.02)),
        turn("0 -1 0", (0.4, 0, 0), 1.0, (centre, 0, 0), ball(0.05)),
    ]
    return Robot.from_xml(textbooks.written("arm", joints))


def written(style: str, numbers: dict[str, float]) -> str:
    """Return a model that holds its numbers in some way."""
    values = ", ".join(map(repr, numbers.values()))
    head, arguments, unpacked = "import numpy as np\n", "", ""
    if style == "names":
        head += f"{NAMES} = {values}\n"
    elif style == "defaults":
        arguments = ", " + ", ".join(f"{name}={x!r}" for name, x in numbers.items())
    elif style == "array":
        head += f"p = np.array([{values}])\n"
        unpacked = f"\n    {NAMES} = p"
    elif style == "json":
        rows = ", ".join(f'"{name}": {x!r}' for name, x in numbers.items())
        head += f"import json\n\np = json.loads('{{{rows}}}')\n"
        unpacked = f"\n    {NAMES} = p.values()"
    elif style == "dataclass":
        fields = "\n".join(f"    {name}: float = {x!r}" for name, x in numbers.items())
        head += f"from dataclasses import astuple, dataclass\n\n\n@dataclass\nclass Arm:\n{fields}\n"
        unpacked = f"\n    {NAMES} = astuple(Arm())"
    return head + EQUATIONS.format(arguments=arguments, unpacked=unpacked)


@pytest.mark.parametrize(
    ("style", "name", "wrong"),
    [
        ("names", "I2", 0.02),  # which is I1
        ("defaults", "c2", 0.2),  # which is c1
        ("array", "I2", 0.005),
        ("json", "m2", 1.5),  # which is m1
        ("dataclass", "I2", 0.02),
    ],
)
def test_a_wrong_number_is_named_and_repaired(style: str, name: str, wrong: float, tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text(written(style, {**RIGHT, name: wrong}))
    report = validate(path, arm())
    assert report.repaired is not None
    assert validate(_saved(path, report.repaired, "repaired"), arm()).agrees
    changed = [
        (float(old), float(new))
        for old, new in zip(_numbers(path.read_text()), _numbers(report.repaired), strict=True)
        if float(old) != float(new)
    ]
    assert set(changed) == {(wrong, RIGHT[name])}
    # What a text holds is not varied.
    assert report.causes[0].confirmed == (style != "json")


def _numbers(source: str) -> list[str]:
    return re.findall(r"\d+\.?\d*", source)


def _saved(path: Path, source: str, name: str) -> Path:
    other = path.with_name(f"{name}.py")
    other.write_text(source)
    return other


def test_where_two_numbers_would_do_none_is_named(tmp_path: Path) -> None:
    """Gravity alone: another length l1 of the first link, or another mass, or centre, of it."""
    path = tmp_path / "model.py"
    path.write_text(
        "import numpy as np\n"
        "m1, m2, l1, c1, c2, g = 1.5, 1.0, 0.5, 0.2, 0.15, 9.81\n\n\n"
        "def gravity(q):\n"
        "    b = m2 * g * c2 * np.cos(q[0] + q[1])\n"
        "    return np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + b, b])\n"
    )
    report = validate(path, arm())
    assert not report.agrees
    assert not any(cause.confirmed for cause in report.causes)


def test_of_several_numbers_the_one_that_becomes_the_robots_is_named(tmp_path: Path) -> None:
    """Gravity alone, of the attributes of a class: another mass would agree, but is none of the robot's."""
    path = tmp_path / "model.py"
    path.write_text(
        "import numpy as np\n\n\n"
        "class P:\n"
        "    m1 = 1.5\n"
        "    c1 = 0.32\n\n\n"
        "def gravity(q):\n"
        "    b = 1.0 * 9.81 * 0.15 * np.cos(q[0] + q[1])\n"
        "    return np.array([(P.m1 * P.c1 + 1.0 * 0.4) * 9.81 * np.cos(q[0]) + b, b])\n"
    )
    (cause,) = validate(path, arm()).causes
    assert cause.line == 6
    assert "0.2" in cause.text
    assert not any("read nowhere" in line for line in cause.evidence)
    assert unread_names(path.read_text()) == []


LISTS = """import numpy as np
p = {{"m": [1.5, 1.0], "l": {lengths}, "c": {centres}, "I": [0.02, 0.05], "g": 9.81}}


def mass_matrix(q):
    m, c, I = p["m"], p["c"], p["I"]
    k = m[1] * p["l"][{read}] * c[1] * np.cos(q[1])
    d = I[1] + m[1] * c[1] ** 2
    a = I[0] + m[0] * c[0] ** 2 + m[1] * p["l"][{read}] ** 2
    return np.array([[a + d + 2 * k, d + k], [d + k, d]])


def gravity(q):
    m, c, g = p["m"], p["c"], p["g"]
    b = m[1] * g * c[1] * np.cos(q[0] + q[1])
    return np.array([(m[0] * c[0] + m[1] * p["l"][{read}]) * g * np.cos(q[0]) + b, b])
"""


def _cause_of(source: str, path: Path, robot: Robot | None = None) -> Cause:
    path.write_text(source)
    (cause,) = validate(path, robot or arm()).causes
    return cause


def test_a_wrong_index_is_no_confirmed_wrong_number(tmp_path: Path) -> None:
    """The second length is read where the first belongs, which nothing reads."""
    source = LISTS.format(lengths=[0.4, 0.3], centres=[0.2, 0.15], read=1)
    cause = _cause_of(source, tmp_path / "model.py")
    assert not cause.confirmed
    assert "l[1]" in cause.text
    assert "l[0] in line 2 has that value, and nothing depends on it" in cause.text


def test_a_wrong_name_is_no_confirmed_wrong_number(tmp_path: Path) -> None:
    """The same where the two lengths are keys, or names."""
    lists = LISTS.format(lengths=[0.4, 0.3], centres=[0.2, 0.15], read=1)
    keys = lists.replace('"l": [0.4, 0.3]', '"l1": 0.4, "l2": 0.3').replace('p["l"][1]', 'p["l2"]')
    names = lists.replace("\n\n\n", "\nl1 = 0.4\nl2 = 0.3\n\n\n", 1).replace('p["l"][1]', "l2")
    names = names.replace('"l": [0.4, 0.3], ', "")
    for style, source in (("keys", keys), ("names", names)):
        cause = _cause_of(source, tmp_path / f"{style}.py")
        assert not cause.confirmed, style
        assert "l1 in line" in cause.text, style
        assert "nothing depends on it" in cause.text, style


def test_a_wrong_link_is_no_confirmed_wrong_number(tmp_path: Path) -> None:
    """The same in a list of dictionaries."""
    source = LISTS.format(lengths=[0.4, 0.3], centres=[0.2, 0.15], read=1)
    links = "\nlinks = [dict(l=0.4), dict(l=0.3)]\n\n\n"
    source = source.replace("\n\n\n", links, 1).replace('p["l"][1]', 'links[1]["l"]')
    cause = _cause_of(source.replace('"l": [0.4, 0.3], ', ""), tmp_path / "model.py")
    assert not cause.confirmed
    assert "another l in line 3 has that value, and nothing depends on it" in cause.text


def test_a_value_of_the_same_list_is_suggested(tmp_path: Path) -> None:
    """Both entries are read, so that another index may be wrong as well as the number."""
    source = LISTS.format(lengths=[0.4, 0.3], centres=[0.2, 0.25], read=0)
    cause = _cause_of(source, tmp_path / "model.py", arm(0.2))
    assert not cause.confirmed
    assert "the model's c[1] is 0.25; with 0.2 it agrees; c[0] in line 2 has that value: it" in cause.text


def test_a_wrong_entry_of_a_list_is_named_with_its_index(tmp_path: Path) -> None:
    """Of a dictionary, a name, and an attribute."""
    source = LISTS.format(lengths=[0.4, 0.3], centres=[0.2, 0.18], read=0)
    cause = _cause_of(source, tmp_path / "key.py")
    assert cause.confirmed
    assert "the model's c[1] is 0.18; with 0.15 it agrees" in cause.text
    named = source.replace("\n\n\n", "\nr = np.array([0.2, 0.18])\n\n\n", 1).replace('p["c"]', "r")
    cause = _cause_of(named.replace('"c": [0.2, 0.18], ', ""), tmp_path / "name.py")
    assert cause.confirmed
    assert "the model's r[1] is 0.18; with 0.15 it agrees" in cause.text
    record = "class Arm:\n    def __init__(self):\n        self.c = [0.2, 0.18]\n\n\narm = Arm()"
    held = source.replace("\n\n\n", f"\n\n\n{record}\n\n\n", 1).replace('p["c"]', "arm.c")
    cause = _cause_of(held.replace('"c": [0.2, 0.18], ', ""), tmp_path / "attribute.py")
    assert cause.confirmed
    assert "the model's self.c[1] is 0.18; with 0.15 it agrees" in cause.text


def test_a_slow_model_is_varied_at_fewer_configurations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model whose calls take long is sampled at few of them."""
    path = tmp_path / "model.py"
    path.write_text(written("names", {**RIGHT, "I2": 0.02}))
    monkeypatch.setattr(samples, "COMPUTING", 1e-9)
    monkeypatch.setattr(samples, "FEW", 6)
    (cause,) = validate(path, arm()).causes
    assert cause.line == 2
    assert cause.expected == pytest.approx(0.05)


def test_all_numbers_are_varied_in_one_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two dozen numbers, three values of each: a fork of a large program takes a tenth of a second."""
    read, texts = Worker.reread, []

    def reread(worker: Worker, source: str) -> None:
        texts.append(source)
        read(worker, source)

    starts, again = [], Worker.again

    def started(worker: Worker, source: str | None = None) -> Worker:
        starts.append(source)
        return again(worker, source)

    monkeypatch.setattr(Worker, "reread", reread)
    monkeypatch.setattr(Worker, "again", started)
    path = tmp_path / "model.py"
    path.write_text(written("defaults", {**RIGHT, "c2": 0.2}))
    assert validate(path, arm()).repaired is not None
    assert len(texts) > 20
    assert len(starts) < 20


def test_another_source_is_read_in_the_same_process(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text("def gravity(q):\n    return 2.0 * q\n")
    with Worker(path, "model", 5.0) as worker:
        states = [[np.array([1.0, 3.0])]]
        np.testing.assert_array_equal(worker.call("gravity", states)[0], [2.0, 6.0])
        worker.reread("def gravity(q):\n    return 5.0 * q\n")
        np.testing.assert_array_equal(worker.call("gravity", states)[0], [5.0, 15.0])
        with pytest.raises(ModelError, match="ZeroDivisionError"):
            worker.reread("1 / 0\n")
        with pytest.raises(ModelError, match="ended its Python process"):
            worker.reread("def gravity(q):\n    return q\n")


def test_what_other_processes_of_the_program_took_is_not_counted(tmp_path: Path) -> None:
    used, of_all = seconds_used(), os.times()
    busy = "import time\nwhile time.process_time() < 1.0:\n    pass\n"
    subprocess.run([sys.executable, "-c", busy], check=True)
    assert os.times().children_user + os.times().children_system > of_all.children_user + 0.9
    assert seconds_used() - used < 0.9  # what this process took itself
    path = tmp_path / "model.py"
    path.write_text(f"{busy}\ndef gravity(q):\n    return q\n")
    with Worker(path, "model", 5.0) as worker:
        assert worker.seconds >= 1.0
    assert seconds_used() - used >= 1.0
