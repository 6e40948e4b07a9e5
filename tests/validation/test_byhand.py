"""Mistakes listed by hand, in styles of real code: names hold for other numbers than those of the file."""

from __future__ import annotations

from pathlib import Path

import byhand
import numpy as np
import pytest

from armgpi import validate
from armgpi.validation import units


@pytest.mark.parametrize("style", byhand.STYLES)
def test_every_mistake_can_be_made(style: str) -> None:
    sources = [mistake.source for mistake in byhand.mistakes(style)]
    assert len(set(sources)) == len(sources) >= 25
    assert byhand.source(style) not in sources


@pytest.mark.parametrize("style", [*(style for style in byhand.STYLES if style != "lagrange"), *byhand.THIRD])
def test_right_models_agree(style: str) -> None:
    assert validate(byhand.FOLDER / f"{style}.py", byhand.robot(style)).agrees


@pytest.mark.parametrize(
    ("style", "line"),
    [
        ("closed", 28),  # g = 9.8 was "g stands where (g + I3) belongs"
        ("attributes", 8),  # attributes were no names
        ("attributes", 20),  # where l1 ** 2 is small any product agrees
        ("gears", 20),  # a dropped rotor was another number of teeth
        ("matlab", 12),  # I1 is I2 + I3
        ("graph", 4),  # expressions of CasADi were not searched
    ],
)
def test_a_name_holds_for_other_numbers(style: str, line: int, tmp_path: Path) -> None:
    (mistake,) = (one for one in byhand.mistakes(style) if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.right, found.text
    assert found.confirmed


def test_a_derivative_is_one_by_numbers_of_one_unit() -> None:
    rng = np.random.default_rng(3)
    mass, length = rng.normal(size=(2, 9))
    spans = {"kg": mass[:, None] / np.linalg.norm(mass), "m": length[:, None] / np.linalg.norm(length)}
    known = units.Slopes(("gravity",), (1.0,), spans, np.array([2.0, 0.5]), np.stack([mass, length], axis=-1))
    assert known.spans(-3.0 * mass)
    assert not known.spans(mass + length)
    assert known.pins(mass, -2.0)
    assert not known.pins(mass, 0.5)


def test_numbers_that_have_a_name() -> None:
    source = "a = 1.5\nself.b, c = 2, -3.0\np = {'m': 4.0}\ns = Box(l=5.0)\nv = [6.0, 7.0]\nd = 8.0 * a\n"
    found = [(name, node.value) for name, node in units.numbers(source)]
    assert found == [
        ("a", 1.5), ("self.b", 2), ("c", 3.0), ("v", 6.0), ("v", 7.0), ("'m'", 4.0), ("l", 5.0)
    ]  # fmt: skip
    (_, node), *_ = units.numbers(source)
    assert units.with_number(source, node, 9.5).splitlines()[0] == "a = 9.5"
