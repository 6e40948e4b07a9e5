"""One door for what varies: one name and one range for sweeps, searches, pages and loops."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi import config
from armgpi.config import keys
from armgpi.config.schema import VarySection
from armgpi.errors import ArmgpiWarning, ParameterError
from armgpi.gpi.law import GPI
from armgpi.parameter import Parameter, parameters
from armgpi.studies import space
from armgpi.studies.distributions import distribution
from armgpi.studies.sample import Sweep
from armgpi.studies.space import Range, Space
from armgpi.view.play.controls import stops_of

PLAIN = Parameter("a number", name="x")


@pytest.mark.parametrize(
    ("facts", "value", "wanted"),
    [
        ({"search": (1.0, 2.0), "slider": (3.0, 4.0)}, 9.0, (1.0, 2.0)),
        ({"slider": (3.0, 4.0), "least": 0.0, "most": 9.0}, 9.0, (3.0, 4.0)),
        ({"least": 0.0, "most": 10.0}, 1.0, (0.0, 10.0)),
        ({"least": 0.0, "most": 10.0, "above": True, "below": True}, None, (0.01, 9.99)),
        ({"least": 0.0}, 5.0, (0.5, 50.0)),
        ({}, -5.0, (-50.0, -0.5)),
        ({"most": 20.0}, np.array([1.0, 4.0]), (0.1, 20.0)),
        ({"least": 0.0}, 0.0, None),
        ({}, None, None),
        ({}, math.inf, None),
    ],
)
def test_a_range_is_that_of_the_search_the_slider_the_bounds_or_the_value(
    facts: Any, value: Any, wanted: Any
) -> None:
    assert replace(PLAIN, **facts).range(value) == wanted


def experiment(**plant: Any) -> Any:
    """Return a checked experiment."""
    data = {"robot": {"name": "anthropomorphic3"}, "plant": plant, "t_final": 0.1}
    return config.check(data, config.Origin("test"))


def test_every_variable_of_a_file_has_the_name_of_its_key() -> None:
    built = config.build(experiment(payload={"mass": 0.1}))
    loop = armgpi.prepare(built.plant, built.controllers["gpi"], built.reference, built.t_final)
    data = built.config.plain()
    for name in ("plant.payload.mass", "plant.payload.com", "plant.substeps", "controller.omega"):
        assert name in loop.parameters
        part, *steps = name.split(".")
        section = data["controllers"][0] if part == "controller" else data[part]
        for step in steps:
            assert step in section
            section = section[step]


def test_an_old_name_is_taken_and_says_the_new_one() -> None:
    built = config.build(experiment())
    loop = armgpi.prepare(built.plant, built.controllers["gpi"], built.reference, 0.1, backend="numpy")
    new = loop.run({"plant.payload.mass": [0.0, 0.1]})
    with pytest.warns(ArmgpiWarning, match=r"plant\.payload is called plant\.payload\.mass now"):
        old = loop.run({"plant.payload": [0.0, 0.1]})
    assert np.array_equal(old["q"], new["q"])
    vary = {"uniform": [0.0, 0.1]}
    given = {"robot": {"name": "anthropomorphic3"}, "t_final": 0.1}
    named = [
        config.check({**given, "vary": {name: vary}}, config.Origin("test"))
        for name in ("plant.payload", "plant.payload.mass")
    ]
    with pytest.warns(ArmgpiWarning, match=r"plant\.payload is called"):
        before = Sweep.of(named[0])
    after = Sweep.of(named[1])
    assert list(before.varied) == list(after.varied) == ["plant.payload.mass"]
    assert before.identity.digest == after.identity.digest  # and so the draws


def test_a_parameter_without_a_search_is_searched_and_swept_over_its_range() -> None:
    assert parameters(GPI)["rest_leak"].search is None
    built = config.build(experiment())
    section = built.config.controllers[0].replace(label=None).plain()
    (found,) = Space(section, built.controllers["gpi"], {"rest_leak": Range()}).dimensions
    assert (found.low, found.high) == parameters(GPI)["rest_leak"].slider
    drawn = distribution("rest_leak", VarySection(), parameters(GPI)["rest_leak"], 3)
    assert drawn.ends == parameters(GPI)["rest_leak"].slider
    assert distribution("x", VarySection(), replace(PLAIN, log=True), 3, 2.0).kind == "log_uniform"


def test_where_nothing_gives_a_range_one_line_asks_for_it() -> None:
    with pytest.raises(ParameterError, match="low and high: nothing declares a range"):
        space._ends("x", PLAIN, Range(), None)
    assert space._ends("x", PLAIN, Range(1.0, 2.0), None) == (1.0, 2.0)
    with pytest.raises(ParameterError, match="one of uniform"):
        distribution("x", VarySection(), PLAIN, 3)


def test_a_parameter_without_a_slider_has_one_over_its_range() -> None:
    assert stops_of(PLAIN) == ()
    stops = stops_of(PLAIN, 4.0)
    assert (stops[0], stops[-1]) == (0.4, 40.0)


def test_a_value_is_put_at_a_key_and_nowhere_else() -> None:
    data: dict[str, Any] = {"plant": {"payload": None, "loads": [{"onset": 1.0}], "delay": 1}, "seed": 3}
    keys.put(data, keys.path_of("plant.payload.mass"), 0.5)
    keys.put(data, keys.path_of("plant.loads.0.onset"), 2.0)
    keys.put(data, keys.path_of("plant.delay"), 2.0, known=True)
    assert data["plant"] == {"payload": {"mass": 0.5}, "loads": [{"onset": 2.0}], "delay": 2}
    assert isinstance(data["plant"]["delay"], int)
    for name in ("plant.loads.1.onset", "plant.other.0.onset", "plant.gravity"):
        with pytest.raises(LookupError):
            keys.put(data, keys.path_of(name), 1.0, known=True)
    with pytest.raises(TypeError):
        keys.put(data, keys.path_of("seed.more"), 1.0)
