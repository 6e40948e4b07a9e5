"""One door for what varies: one name and one range for sweeps, searches, pages and loops."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi import config
from armgpi.base.parameter import Parameter, parameters
from armgpi.config import experiment as experiments
from armgpi.config import keys
from armgpi.config.schema import VarySection
from armgpi.errors import ArmgpiWarning, ConfigError, NameNotFound, ParameterError
from armgpi.gpi.law import GPI
from armgpi.loop import metrics
from armgpi.loop.variables import robot_with
from armgpi.studies import space
from armgpi.studies.distributions import distribution
from armgpi.studies.sample import Sweep
from armgpi.studies.space import Range, Space
from armgpi.viewing.play.controls import stops_of

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
    law = built.controllers["gpi"]
    (found,) = Space(section, law, {"rest_leak": Range()}).dimensions
    assert Space(section, law, {"controller.rest_leak": Range()}).dimensions == [found]  # its name elsewhere
    for name, said in {"plant.delay": "armgpi sweep", "controller.rolloff": "for each value"}.items():
        with pytest.raises(NameNotFound, match=said):
            Space(section, law, {name: Range()})
    assert (found.low, found.high) == parameters(GPI)["rest_leak"].slider
    drawn = distribution("rest_leak", VarySection(), parameters(GPI)["rest_leak"], 3)
    assert drawn.ends == parameters(GPI)["rest_leak"].slider
    assert distribution("x", VarySection(), replace(PLAIN, log=True), 3, 2.0).kind == "log_uniform"


def test_where_nothing_gives_a_range_one_line_asks_for_it() -> None:
    with pytest.raises(ParameterError, match="low and high: nothing declares a range"):
        space._ends("x", PLAIN, Range(), None)
    assert space._ends("x", PLAIN, Range(1.0, 2.0), None) == (1.0, 2.0)
    with pytest.raises(ParameterError, match="a distribution, such as"):
        distribution("x", VarySection(), PLAIN, 3)


def test_a_parameter_without_a_slider_has_one_over_its_range() -> None:
    assert stops_of(PLAIN) == ()
    stops = stops_of(PLAIN, 4.0)
    assert (stops[0], stops[-1]) == (0.4, 40.0)


def test_a_value_is_put_at_a_key_and_nowhere_else() -> None:
    data: dict[str, Any] = {"plant": {"payload": None, "loads": [{"onset": 1.0}], "delay": 1}, "seed": 3}
    keys.put(data, keys.path_of("plant.payload.mass"), 0.5)
    keys.put(data, keys.path_of("plant.loads.0.onset"), 2.0)
    keys.put(data, keys.path_of("plant.delay"), 2.0)
    assert data["plant"] == {"payload": {"mass": 0.5}, "loads": [{"onset": 2.0}], "delay": 2}
    assert isinstance(data["plant"]["delay"], int)
    for name in ("plant.loads.1.onset", "plant.other.0.onset"):
        with pytest.raises(LookupError):
            keys.put(data, keys.path_of(name), 1.0)
    with pytest.raises(TypeError):
        keys.put(data, keys.path_of("seed.more"), 1.0)


def leaves(data: Any, path: tuple[str, ...] = ()) -> Any:
    """Yield names and values of all numbers of plain data, and lists of numbers."""
    if isinstance(data, dict) or (isinstance(data, list) and data and isinstance(data[0], dict | list)):
        for step, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from leaves(value, (*path, str(step)))
    elif data not in (None, []) and not isinstance(data, str | bool):
        yield ".".join(path), data


FULL = {
    "robot": {"name": "anthropomorphic3", "effort": 60.0, "friction": {"viscous": 0.1, "coulomb": 0.2}},
    "plant": {
        "payload": {"mass": 0.1},
        **{"inertia_scale": 1.1, "rotor_inertia": 0.1, "viscous": 0.3, "coulomb": [0.1, 0.2, 0.3]},
        "loads": [{"type": "step", "amplitude": 1.0, "onset": 0.1}],
        **{"noise": {"position": 1e-4}, "motor_fault": {"onset": 1.0, "end": 2.0}},
    },
    "controllers": [{"type": "network", "rolloff": 1, "payload_range": {"lightest": 0.1, "heaviest": 0.2}}],
    "supervisor": {},
    "t_final": 0.05,
}


def test_every_number_of_a_file_has_one_name_that_tells_its_value_and_what_is_declared() -> None:
    built = config.build(config.check(FULL, config.Origin("test"))).config
    others = ("format", "vary", "failure")
    found = dict(leaves({key: x for key, x in built.plain().items() if key not in others}))
    assert len(found) > 60
    for name, value in found.items():
        if name.startswith("reference.points"):  # configurations, number by number
            continue
        declared, now = keys.find(built, name.replace("controllers.0.", "controller."))
        assert now == value, name
        assert declared.text, name
    assert keys.find(built, "reference.points.1.0")[1] == built.reference.points[1][0]
    assert keys.find(built, "plant.delay")[0].range() == (0, 20)  # whose section the file does not have
    for name in ("plant", "plant.friction", "plant.loads.1.onset", "robot.name", "reference.path.radius"):
        with pytest.raises(LookupError):
            keys.find(built, name)


def test_a_number_of_a_reference_is_a_time_or_a_position_of_each_joint() -> None:
    arm = armgpi.Robot.load("anthropomorphic3")
    plant, law, points = armgpi.RigidBodyPlant(arm), GPI(arm, 1e-3), np.zeros((3, 3))
    for reference in (
        armgpi.Hold(points[0]),
        armgpi.Bezier(points[0], points[1], 0.5),
        armgpi.Waypoints(points, [0.2, 0.2], [0.1, 0.1, 0.1]),
    ):
        loop = armgpi.prepare(plant, law, reference, 0.1, backend="numpy")
        own = {name: x for name, x in loop.parameters.items() if name.startswith("reference.")}
        assert own
        for name, x in own.items():
            joints = np.size(x.value) == arm.n
            assert (x.declared.per_joint, x.declared.unit) == (joints, "rad or m" if joints else "s"), name


def test_what_a_loop_cannot_be_given_anew_is_swept_as_the_file_runs_with_it() -> None:
    data: dict[str, Any] = {"robot": {"name": "anthropomorphic3"}, "t_final": 0.05}
    vary: dict[str, Any] = {"controller.integrators": {}, "plant.delay": {}, "sample_time": {}}
    sweep = Sweep.of(config.check({**data, "vary": vary}, config.Origin("test")))
    assert sweep.apart == tuple(vary)
    assert [*sweep.varied["controller.integrators"].numbers] == [1, 2, 3]
    data["vary"] = {"robot.effort": {"uniform": [30.0, 60.0], "each": "joint"}}
    sweep = Sweep.of(config.check(data, config.Origin("test")))
    table = sweep.run(0, 2)
    for place, row in enumerate(table):
        drawn = dict(zip(sweep.columns, row, strict=True))
        (run,) = experiments.record_all(
            config.build(sweep.config_of(drawn, place)), backend="compiled"
        ).values()
        itae = metrics.of_recorded(run)["itae"][0]
        np.testing.assert_array_equal([drawn[f"itae[{joint}]"] for joint in sweep.robot.joint_names], itae)


def test_a_number_that_nothing_gives_a_range_of_or_that_cannot_be_is_refused_in_one_line() -> None:
    data = {"robot": {"name": "anthropomorphic3"}, "t_final": 0.05}
    for name, said in {
        "robot.effort": "must be a distribution, such as {uniform: [1, 2]}",
        "plant.ripple_period": "requires engine: elastic",
        "seed": "a number that differs by rollout",
        "plant.friction": "there is no number of this experiment named 'plant.friction'",
    }.items():
        with pytest.raises(ConfigError, match=re.escape(said)) as refused:
            Sweep.of(config.check({**data, "vary": {name: {}}}, config.Origin("test")))
        assert refused.value.key == f"vary.{name}"


def test_what_each_rollout_has_of_an_arm_is_what_is_given_for_it_or_for_all() -> None:
    arm, com = armgpi.Robot.load("ur5"), np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    own = robot_with(arm, {"com": com, "payload": np.array([1.0, 2.0]), "frame": "tool0"}, 2)
    same = robot_with(arm, {"com": com[0], "payload": 1.5, "frame": "tool0"}, 2)
    np.testing.assert_array_equal(own.variation["com"], com)
    np.testing.assert_array_equal(own.variation["payload"], [1.0, 2.0])
    np.testing.assert_array_equal(same.variation["com"], com[[0, 0]])
    np.testing.assert_array_equal(same.variation["payload"], [1.5, 1.5])
