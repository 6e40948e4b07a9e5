"""The experiment file: what it means, and what is said when it is wrong."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from armgpi import GPI, BSplineNetwork, PIDPositions, Robot, config, default_omega
from armgpi.config import building, schema
from armgpi.config.section import by_shape
from armgpi.config.values import as_section
from armgpi.errors import ArmgpiError, ConfigError
from armgpi.plants.plant import Wrapper

ROOT = Path(__file__).parents[2]
ARM = "robot: {name: anthropomorphic3}\n"
KNOWN = ", ".join(schema.KINDS)


def build(text: str) -> Any:
    return config.build(*config.parse(text, "file.yaml"))


def refusal(text: str) -> ConfigError:
    with pytest.raises(ConfigError) as refused:
        build(text)
    assert "\n" not in str(refused.value)
    return refused.value


# Files and objects.


def test_the_demo_can_be_built() -> None:
    demo = config.build(*config.read(ROOT / "examples" / "demo.yaml"))
    assert list(demo.controllers) == ["GPI", "PID + inversion"]
    assert isinstance(demo.controllers["GPI"], GPI)
    # A rival that measures what the controller measures.
    assert isinstance(demo.controllers["PID + inversion"], PIDPositions)


def test_a_robot_alone_is_a_whole_experiment() -> None:
    whole = build(ARM)
    assert list(whole.controllers) == ["gpi"]
    middle = whole.robot.middle()
    reference = whole.reference
    np.testing.assert_array_equal(reference.at(0.0).q, middle)
    np.testing.assert_allclose(reference.at(reference.t_end).q, middle)
    assert whole.t_final == reference.t_end + 2.0


@pytest.mark.parametrize(
    "text", ["plant:", "controllers:", "reference:", "plant: {}", "t_final:", "reference: {}"]
)
def test_an_empty_section_is_as_good_as_none(text: str) -> None:
    assert build(ARM + text).config == build(ARM).config


def test_a_network_has_its_scales_from_the_encoder_and_its_box_from_the_sample_time() -> None:
    network = build(f"{ARM}plant: {{encoder_bits: 16}}\ncontrollers: [{{type: network}}]").controllers[
        "network"
    ]
    assert isinstance(network, GPI)
    assert isinstance(network.gains, BSplineNetwork)
    lower, upper = network.gains.boxes["omega_c"]
    np.testing.assert_allclose([lower, upper], [[22.0] * 3, [60.0] * 3])
    count = 2.0 * math.pi / 2**16
    told = network.gains.describe()
    assert told["error_range"] == [count] * 3
    assert told["dead_zone"] == [2.0 * count] * 3
    ideal = build(f"{ARM}controllers: [{{type: network}}]\nsample_time: 4e-3").controllers["network"].gains
    assert ideal.describe()["dead_zone"] == [0.0] * 3
    np.testing.assert_allclose(ideal.boxes["omega_c"][1], 2.0 * default_omega(4e-3))


def test_a_path_is_followed_by_the_tool() -> None:
    whole = build(f"{ARM}reference: {{path: {{type: laser}}}}")
    there = whole.robot.frame_pose("tool", whole.reference.at(1.0).q).translation
    np.testing.assert_allclose(there[0], 0.08 + 0.15 / 36.0, atol=1e-9)
    corners = "[[0.3, 0, 0.3], [0.3, 0.1, 0.3]]"
    ends = build(f"{ARM}reference: {{path: {{type: polyline, corners: {corners}, durations: 2}}}}")
    assert ends.t_final == 4.0
    assert config.build(config.parse(config.dump(ends.config), "again.yaml").config).config == ends.config


# Everything that can be said in a file, as strategies.

NUMBER = st.floats(0.01, 100.0).map(lambda x: round(x, 4))
PER_JOINT = st.one_of(
    NUMBER,
    st.lists(NUMBER, min_size=3, max_size=3),
    st.dictionaries(st.sampled_from(["q1", "q2", "q3"]), NUMBER, min_size=1),
)
ANGLE = st.floats(-1.5, 1.5).map(lambda x: round(x, 4))
CONFIGURATION = st.one_of(
    ANGLE,
    st.lists(ANGLE, min_size=3, max_size=3),
    st.dictionaries(st.sampled_from(["q1", "q2", "q3"]), ANGLE),
)


def section(required: dict[str, st.SearchStrategy], **optional: st.SearchStrategy) -> st.SearchStrategy:
    return st.fixed_dictionaries(required, optional=optional)


LOAD = st.one_of(
    section({"type": st.just("step"), "amplitude": PER_JOINT}, onset=NUMBER),
    section({"type": st.just("ramp"), "slope": PER_JOINT}, onset=NUMBER),
    section(
        {"type": st.just("sine"), "amplitude": PER_JOINT, "omega": PER_JOINT}, phase=NUMBER, onset=NUMBER
    ),
    section({"type": st.just("pulse"), "amplitude": PER_JOINT, "onset": NUMBER, "duration": NUMBER}),
    section({"type": st.just("paper")}),
)
CONTROLLER = st.one_of(
    section(
        {"type": st.just("gpi")},
        omega=st.floats(1.0, 30.0),
        zeta=st.floats(0.5, 2.0),
        p=st.one_of(st.none(), st.floats(1.0, 30.0)),
        realisation=st.sampled_from(["bumpless", "paper"]),
        start=st.sampled_from(["hold", "zero"]),
        inertia_scale=st.floats(0.5, 2.0),
    ),
    section(
        {"type": st.just("network")},
        label=st.just("two"),
        omega=st.one_of(NUMBER, st.just({"lower": 20, "upper": [30, 40, 50]})),
        zeta=st.just({"lower": 0.7, "upper": 0.9}),
        p=st.just([20, 30, 40]),
        learning=st.sampled_from(["magnitude", "signed"]),
        learning_rate=st.floats(0.0, 1.0),
        rate=st.floats(0.01, 1.0),
        dead_zone=st.floats(0.0, 1e-3),
        leak=st.floats(0.0, 10.0),
        bandwidth=st.floats(1.0, 500.0),
        start=st.sampled_from(["hold", "zero"]),
    ),
    section({"type": st.just("pid")}, label=st.just("one"), kp=PER_JOINT, ki=PER_JOINT, kd=PER_JOINT),
)
POINTS = st.integers(1, 4).flatmap(
    lambda count: section(
        {"points": st.lists(CONFIGURATION, min_size=count, max_size=count)},
        durations=st.one_of(NUMBER, st.lists(NUMBER, min_size=count - 1, max_size=count - 1)),
        holds=st.one_of(NUMBER, st.lists(NUMBER, min_size=count, max_size=count)),
    )
)
EXPERIMENT = section(
    {"robot": section({"name": st.just("anthropomorphic3")}, effort=NUMBER)},
    plant=section(
        {},
        payload=section(
            {"mass": NUMBER}, frame=st.just("tool"), com=st.lists(NUMBER, min_size=3, max_size=3)
        ),
        rotor_inertia=PER_JOINT,
        friction=st.sampled_from(["urdf", "none"]),
        loads=st.lists(LOAD, max_size=3),
        substeps=st.integers(1, 4),
        encoder_bits=st.integers(1, 52),
        delay=st.integers(0, 5),
        drop_out=st.floats(0.0, 0.9),
        noise=section({}, position=NUMBER, velocity=NUMBER),
        torque_rate=NUMBER,
    ),
    controllers=st.lists(CONTROLLER, min_size=1, max_size=3),
    reference=POINTS,
    sample_time=st.sampled_from([1e-3, 2.5e-4, 1e-5]),
    t_final=NUMBER,
    record_every=st.integers(1, 100),
    seed=st.integers(0, 2**63 - 1),
)


@pytest.mark.slow
@settings(max_examples=25)
@given(EXPERIMENT)
@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")  # gains too fast for the sample time
def test_what_is_written_is_read_back_the_same(data: dict[str, Any]) -> None:
    first = config.parse(yaml.safe_dump(data), "file.yaml").config
    assert config.parse(config.dump(first), "again.yaml").config == first
    # What was built says every default, and builds the same again.
    built = build(yaml.safe_dump(data))
    again = build(config.dump(built.config))
    assert again.config == built.config
    assert again.t_final == built.t_final
    times = np.linspace(0.0, built.t_final, 7)
    np.testing.assert_array_equal(again.reference.at(times).q, built.reference.at(times).q)
    assert again.plant.describe() == built.plant.describe()
    for label, controller in built.controllers.items():
        assert again.controllers[label].describe() == controller.describe()


@given(st.floats(1e-300, 1e300))
def test_a_number_survives_the_file_to_the_last_bit(number: float) -> None:
    first = config.parse(f"{ARM}t_final: {number!r}", "file.yaml").config
    assert config.parse(config.dump(first), "again.yaml").config.t_final == number == first.t_final


def test_every_default_is_written_out() -> None:
    written = yaml.safe_load(config.dump(build(ARM).config))
    # A file without the key `ideal` has what it states alone, as this one.
    assert set(written) == set(config.ExperimentConfig.keys) - {"ideal"}
    assert written["t_final"] > 0.0
    assert written["controllers"][0]["omega"] > 0.0
    assert len(written["reference"]["points"]) == 3
    assert len(written["reference"]["durations"]) == 2


# Quantities per joint.


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("20", [20.0, 20.0, 20.0]),
        ("2e1", [20.0, 20.0, 20.0]),  # text to YAML 1.1
        ("[10, 20, 30]", [10.0, 20.0, 30.0]),
        ("{q2: 20}", [default_omega(1e-3), 20.0, default_omega(1e-3)]),  # the others have the default
        ("{q3: 30, q1: 10, q2: 20}", [10.0, 20.0, 30.0]),
    ],
)
def test_a_quantity_is_a_number_a_list_or_a_mapping(text: str, expected: list[float]) -> None:
    controller = build(f"{ARM}controllers: [{{type: gpi, omega: {text}}}]").controllers["gpi"]
    np.testing.assert_array_equal(controller.gains.nominal().omega_c, expected)
    np.testing.assert_array_equal(controller.gains.nominal().p_c, expected)


def test_a_posture_keeps_the_joints_that_it_does_not_name() -> None:
    reference = build(
        f"{ARM}reference: {{points: [{{q1: 0.3}}, {{q2: 0.6}}, [1, 1, 1], {{q3: 0}}]}}"
    ).reference
    middle = Robot.load("anthropomorphic3").middle()
    np.testing.assert_array_equal(reference.moves[0].start, [0.3, *middle[1:]])
    np.testing.assert_array_equal(reference.moves[0].goal, [0.3, 0.6, middle[2]])
    np.testing.assert_array_equal(reference.moves[2].goal, [1.0, 1.0, 0.0])


def test_joints_are_locked_by_name_and_at_values() -> None:
    assert build("robot: {name: anthropomorphic3, lock: q1}").robot.joint_names == ("q2", "q3")
    assert build("robot: {name: anthropomorphic3, keep: [q3, q1]}").robot.joint_names == ("q1", "q3")
    locked = build("robot: {name: anthropomorphic3, lock: {q1: 0.3, q2: null}}").robot
    assert locked.provenance["locked"] == {"q1": 0.3, "q2": 0.0}


def test_effort_limits_can_be_given() -> None:
    robot = build("robot: {name: double_pendulum, effort: {joint1: 3, joint2: 4}}").robot
    np.testing.assert_array_equal(robot.limits.effort, [3.0, 4.0])


def test_the_controllers_know_the_delay_and_not_the_load() -> None:
    plant = "plant: {delay: 3, payload: {mass: 0.5}, rotor_inertia: 0.01}"
    text = f"controllers: [{{type: gpi}}]\n{plant}\nsample_time: 2e-3"
    built = build(ARM + text)
    controller = built.controllers["gpi"]
    assert controller.delay == 6e-3
    assert controller.robot.total_mass == built.robot.total_mass == built.plant.robot.total_mass - 0.5
    # Without gains, the bandwidth is the one for this sample time and delay: 0.1 / (1.5 dt + delay).
    np.testing.assert_allclose(controller.gains.nominal().omega_c, 0.1 / 9e-3)


def test_inertia_scale_is_the_papers_variation_of_D() -> None:
    built = build(f"{ARM}controllers: [{{type: gpi, inertia_scale: 0.8}}, {{type: pid, inertia_scale: 0.8}}]")
    for controller in built.controllers.values():
        q = np.array([0.1, 0.2, 0.3])
        np.testing.assert_allclose(controller.robot.mass_matrix(q), 0.8 * built.robot.mass_matrix(q))
    np.testing.assert_array_equal(built.controllers["pid"].bias_robot.gravity(q), built.robot.gravity(q))


# Where a URDF is looked for.


def test_a_urdf_is_looked_for_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "a folder" / "with spaces"
    folder.mkdir(parents=True)
    urdf = (ROOT / "urdf" / "anthropomorphic3.urdf").read_text().replace("anthropomorphic3", "mine")
    (folder / "mine.urdf").write_text(urdf)
    file = folder / "experiment.yaml"
    file.write_text("robot: {name: mine.urdf}")
    monkeypatch.chdir(tmp_path)
    assert config.build(*config.read(file)).robot.name == "mine"
    relative = file.relative_to(tmp_path)
    assert config.build(*config.read(relative)).robot.name == "mine"
    file.write_text(f"robot: {{name: {folder / 'mine.urdf'}}}")
    assert config.build(*config.read(file)).robot.name == "mine"


def test_the_arm_alone_is_that_of_the_whole_experiment() -> None:
    given = config.parse("robot: {name: anthropomorphic3, rotor_inertia: 0.2, lock: [q1]}", "x")
    alone, whole = building.robot(*given), config.build(*given).robot
    assert isinstance(alone, Robot)
    assert alone.joint_names == whole.joint_names == ("q2", "q3")
    np.testing.assert_array_equal(alone.mass_matrix([0.1, 0.2]), whole.mass_matrix([0.1, 0.2]))


def test_a_value_is_read_by_its_shape_a_list_of_one_list_as_well() -> None:
    def named(word: str) -> Any:
        return lambda value, path: (word, value)

    read = by_shape(named("single"), named("several"), named("named"), named("nested"))
    cases: tuple[tuple[str, Any], ...] = (
        ("single", 1.0),
        ("several", []),
        ("several", [1.0]),
        ("several", [1.0, [2.0]]),
        ("named", {"q1": 1.0}),
        ("nested", [[1.0]]),
        ("nested", [[1.0], 2.0]),
    )
    for word, value in cases:
        assert read(value, ()) == (word, value)
    alone = by_shape(named("single"))
    assert [alone(value, ())[0] for _, value in cases] == ["single"] * len(cases)


def test_a_known_name_stays_one_beside_a_file_that_is_called_so(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "panda").write_text("no robot")
    (tmp_path / "parts" / "arm").write_text("no robot")
    file = tmp_path / "experiment.yaml"
    for name, found in (("panda", "panda"), ("parts/arm", str(tmp_path / "parts" / "arm"))):
        file.write_text(f"robot: {{name: {name}}}")
        assert config.read(file).config.robot.name == found


# Errors: the file, the line, the key, and what was expected.

BAD: dict[str, tuple[str, str, int | None, str]] = {
    # name: text after the robot's line, key, line, part of the message
    "unknown section": ("plnt: {}", "plnt", 2, "did you mean 'plant'"),
    "unknown key": ("plant:\n  encoder_bit: 3", "plant.encoder_bit", 3, "did you mean 'encoder_bits'"),
    "unknown key of a load": (
        "plant:\n  loads:\n  - {type: sine, amplitude: 1, omga: 3}",
        "plant.loads.0.omga",
        4,
        "did you mean 'omega'",
    ),
    "unknown key of a controller": (
        "controllers:\n- type: gpi\n- type: pid\n  kpp: 3",
        "controllers.1.kpp",
        5,
        "did you mean 'kp'",
    ),
    "unknown controller": ("controllers:\n- type: lqr", "controllers.0.type", 3, f"known: {KNOWN}"),
    "controller without type": ("controllers:\n- omega: 3", "controllers.0.type", 3, "is missing"),
    "unknown load": ("plant: {loads: [{type: sin}]}", "plant.loads.0.type", 2, "did you mean 'sine'"),
    "key of a load missing": ("plant: {loads: [{type: step}]}", "plant.loads.0.amplitude", 2, "is missing"),
    "no controllers": ("controllers: []", "controllers", 2, "at least 1"),
    "controllers no list": ("controllers: {type: gpi}", "controllers", 2, "expected a list"),
    "section no mapping": ("plant: 3", "plant", 2, "expected a mapping, got 3"),
    "text for a number": ("sample_time: fast", "sample_time", 2, "expected a number, got 'fast'"),
    "truth for a number": ("sample_time: true", "sample_time", 2, "expected a number, got True"),
    "not a number": ("t_final: .nan", "t_final", 2, "expected a finite number"),
    "infinity": ("t_final: .inf", "t_final", 2, "expected a finite number"),
    "more than a number": ("t_final: 1" + 400 * "0", "t_final", 2, "expected a number"),
    "no time": ("sample_time: 0", "sample_time", 2, "1e-09 or more, got 0"),
    "hardly any time": ("sample_time: 1e-320", "sample_time", 2, "1e-09 or more"),
    "negative": ("t_final: -1", "t_final", 2, "above 0, got -1"),
    "more samples than sense": ("t_final: 1e300", "t_final", 2, "samples"),
    "less than a sample": ("t_final: 1e-4", "t_final", 2, "samples"),
    "truth for a whole number": ("seed: true", "seed", 2, "whole number, got True"),
    "broken number": ("seed: 1.5", "seed", 2, "whole number, got 1.5"),
    "negative seed": ("seed: -1", "seed", 2, "0 or more"),
    "endless seed": (f"seed: {2**63}", "seed", 2, "or less"),
    "no bits": ("plant: {encoder_bits: 0}", "plant.encoder_bits", 2, "1 or more"),
    "too many bits": ("plant: {encoder_bits: 53}", "plant.encoder_bits", 2, "52 or less"),
    "always lost": ("plant: {drop_out: 1}", "plant.drop_out", 2, "below 1"),
    "truth for friction": ("plant: {friction: yes}", "plant.friction", 2, "'urdf' or 'none'"),
    "negative mass": ("plant:\n  payload:\n    mass: -1", "plant.payload.mass", 4, "0 or more"),
    "unknown frame": ("plant: {payload: {mass: 1, frame: tol}}", "plant.payload", 2, "did you mean 'tool'"),
    "com of two": ("plant: {payload: {mass: 1, com: [0, 1]}}", "plant.payload.com", 2, "at least 3"),
    "list too short": (
        "controllers:\n- type: gpi\n  omega: [1, 2]",
        "controllers.0.omega",
        4,
        "expected 3 numbers (q1, q2, q3), got 2",
    ),
    "bad number in a list": (
        "controllers:\n- type: gpi\n  omega:\n  - 1\n  - x\n  - 3",
        "controllers.0.omega.1",
        6,
        "expected a number, got 'x'",
    ),
    "unknown joint": (
        "controllers:\n- type: gpi\n  omega:\n    q1: 3\n    q4: 3",
        "controllers.0.omega.q4",
        6,
        "known: q1, q2, q3",
    ),
    "bad number of a joint": ("plant: {rotor_inertia: {q1: -1}}", "plant.rotor_inertia.q1", 2, "0 or more"),
    "joint without torque rate": ("plant: {torque_rate: {q1: 3}}", "plant.torque_rate", 2, "q2, q3"),
    "no gain": ("controllers: [{type: gpi, omega: 0}]", "controllers.0.omega", 2, "above 0"),
    "negative gain": ("controllers: [{type: pid, kd: -1}]", "controllers.0.kd", 2, "0 or more"),
    "box upside down": (
        "controllers: [{type: network, omega: {lower: 60, upper: 20}}]",
        "controllers.0.omega",
        2,
        "lower <= upper",
    ),
    "half a box": (
        "controllers: [{type: network, omega: {lower: 60}}]",
        "controllers.0.omega.upper",
        2,
        "missing",
    ),
    "unstable learning": ("controllers: [{type: network, learning_rate: 2}]", "controllers.0", 2, "below 2"),
    "negative learning": (
        "controllers: [{type: network, learning_rate: -1}]",
        "controllers.0.learning_rate",
        2,
        "0 or more",
    ),
    "knots that decrease": (
        "controllers: [{type: network, knots: [-1, -1, -1, 0.5, 0, 1, 1, 1]}]",
        "controllers.0",
        2,
        "increasing knots",
    ),
    "knots of one side": (
        "controllers: [{type: network, knots: [0, 0, 0, 1, 1, 1]}]",
        "controllers.0",
        2,
        "symmetric about 0",
    ),
    "a unit": ("controllers: [{type: network, omega: 20 rad/s}]", "controllers.0.omega", 2, "a number"),
    "unknown path": ("reference: {path: {type: lasr}}", "reference.path.type", 2, "did you mean 'laser'"),
    "path and points": (
        "reference: {path: {type: laser}, points: [[0, 0, 0]]}",
        "reference.points",
        2,
        "use one of the two",
    ),
    "frame without path": ("reference: {frame: tool}", "reference.frame", 2, "requires path"),
    "unknown frame of a path": (
        "reference: {path: {type: laser}, frame: tol}",
        "reference.frame",
        2,
        "no frame named 'tol'",
    ),
    "path out of reach": (
        "reference: {path: {type: circle, centre: [2, 0, 0], radius: 1, period: 3}}",
        "reference.path",
        2,
        "out of reach",
    ),
    "point outside the limits": (
        "reference:\n  points:\n  - [0, 0, 0]\n  - [0, 0, 9]",
        "reference.points.1",
        5,
        "'q3' is 9, outside [-2.7, 2.7]",
    ),
    "point of an unknown joint": ("reference: {points: [{j1: 0}]}", "reference.points.0.j1", 2, "known: q1"),
    "no points": ("reference: {points: []}", "reference.points", 2, "at least 1"),
    "too many durations": (
        "reference: {points: [0, 1], durations: [1, 2]}",
        "reference",
        2,
        "durations must be a number or 1 of them",
    ),
    "no duration": ("reference: {points: [0, 1], durations: 0}", "reference.durations", 2, "above 0"),
    "negative hold": ("reference: {points: [0, 1], holds: [0, -1]}", "reference.holds.1", 2, "0 or more"),
    "a load that ends before it begins": (
        "plant: {loads: [{type: step, amplitude: 1, onset: 3, end: 2}]}",
        "plant.loads.0",
        2,
        "after the onset",
    ),
    "twice": ("seed: 1\nt_final: 3\nseed: 1", "seed", 4, "is a duplicate key"),
    "twice, deep": (
        "plant:\n  delay: 1\n  noise: {}\n  delay: 2",
        "plant.delay",
        5,
        "is a duplicate key",
    ),
    "key no text": ("1: 2", "1", None, "a key is text"),
    "not YAML": ("plant: {", "", 2, "is not valid YAML"),
    "a tab": ("plant:\n\tdelay: 1", "", 3, "is not valid YAML"),
    "two documents": ("---\nseed: 1", "", 2, "is not valid YAML"),
    "a date that is none": ("t_final: 2020-13-45", "", None, "is not valid YAML"),
    "code": ("seed: !!python/object/apply:os.getcwd []", "", 2, "is not valid YAML"),
    "control characters": ("seed: \x01", "", None, "is not valid YAML"),
    "an alias of itself": ("plant: &a [*a]", "", 2, "is an alias of something that it is in; write it out"),
    "two of a label": (
        "controllers: [{type: gpi}, {type: pid, label: gpi 3}, {type: gpi}]",
        "controllers.2.label",
        2,
        "labelled 'gpi 3'",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_an_error_names_file_line_key_and_what_was_expected(case: str) -> None:
    text, key, line, message = BAD[case]
    error = refusal(ARM + text)
    assert (error.source, error.key, error.line) == ("file.yaml", key, line)
    place = "file.yaml" if line is None else f"file.yaml:{line}"
    assert str(error).startswith(f"{place}: {key}: " if key else f"{place}: ")
    assert message in str(error)


@pytest.mark.parametrize(
    ("robot", "key", "message"),
    [
        ("{}", "robot.name", "is missing"),
        ("{name: 3}", "robot.name", "expected text"),
        ("{name: pandaa}", "robot.name", "did you mean 'panda'"),
        ("{name: none.urdf}", "robot.name", "no such file"),
        (f"{{name: {'a' * 300}}}", "robot.name", "aaa"),
        ("{name: anthropomorphic3, lok: [q1]}", "robot.lok", "did you mean 'lock'"),
        ("{name: anthropomorphic3, lock: [q9]}", "robot.lock", "known: q1, q2, q3"),
        ("{name: anthropomorphic3, lock: [q1, 3]}", "robot.lock.1", "expected text"),
        ("{name: anthropomorphic3, lock: {q1: x}}", "robot.lock.q1", "expected a number"),
        ("{name: anthropomorphic3, lock: 3}", "robot.lock", "expected a list"),
        ("{name: anthropomorphic3, keep: [q9]}", "robot.keep", "known: q1, q2, q3"),
        ("{name: anthropomorphic3, lock: [q1, q2, q3]}", "robot.name", "no moving joint"),
        ("{name: anthropomorphic3, effort: [1, 2]}", "robot.effort", "expected 3 numbers"),
        ("{name: anthropomorphic3, effort: {q1: 0}}", "robot.effort", "'q1' has effort limit 0"),
        ("{name: double_pendulum}", "robot.effort", "'joint1' has effort limit 0"),
        ("3", "robot", "expected a mapping"),
    ],
)
def test_an_error_about_the_robot_names_its_key(robot: str, key: str, message: str) -> None:
    error = refusal(f"seed: 1\nrobot: {robot}")
    assert (error.source, error.key, error.line) == ("file.yaml", key, 2)
    assert message in str(error)


def test_the_disturbances_of_the_paper_are_for_its_arm() -> None:
    error = refusal("robot: {name: ur5}\nplant: {loads: [{type: paper}]}")
    assert (error.key, error.line) == ("plant.loads.0", 2)


@pytest.mark.parametrize("text", ["", "# nothing but a remark", "[]", "- robot", "3", "robot", "null", "---"])
def test_a_file_that_is_no_mapping_is_refused(text: str) -> None:
    assert "expected a mapping" in str(refusal(text))


def test_a_file_without_robot_is_refused() -> None:
    assert (refusal("seed: 1").key, refusal("robot:").key) == ("robot", "robot")


def test_a_small_file_that_aliases_make_huge_is_refused() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert "keys and values" in str(refusal("\n".join(lines)))


# Files that cannot be read.


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "none.yaml", "no such file"),
        (lambda folder: folder, "is a (folder|device)"),
        (lambda folder: folder / ("a" * 300), "cannot be read"),
        (lambda folder: write(folder / "b.yaml", b"\xff\xfe\x00binary"), "not UTF-8"),
        (lambda folder: write(folder / "b.yaml", b"seed: caf\xe9"), "not UTF-8"),
        (lambda folder: write(folder / "b.yaml", bytes(range(32))), "not valid YAML"),
        (lambda folder: write(folder / "b.yaml", b"#" * 1_000_001), "larger than"),
        (lambda folder: write(folder / "b.yaml", b"[" * 100_000), "nested too deeply"),
        (lambda folder: Path("/dev/zero"), "is a (folder|device)"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(
    make: Callable[[Path], Path], message: str, tmp_path: Path
) -> None:
    path = make(tmp_path)
    with pytest.raises(ConfigError, match=message) as refused:
        config.read(path)
    assert refused.value.source == str(path)


def test_a_byte_order_mark_and_other_line_ends_are_fine(tmp_path: Path) -> None:
    text = "\ufeffrobot:\r\n  name: anthropomorphic3\r\nseed: 3\r\n"
    assert config.read(write(tmp_path / "w.yaml", text.encode("utf-8"))).config.seed == 3


# Whatever stands in the file: a configuration or our error.

WORDS = (
    "robot name anthropomorphic3 plant controllers type gpi omega reference points q1 loads sine payload mass"
)
ODD = "-1 .nan 1e999 0x10 1:30 2020-01-01 ~ yes { } [ ] &a *a !!float !!set << ? | # '"
SCRAPS = st.sampled_from([*WORDS.split(), *ODD.split(), ": ", "- ", ", ", " ", "\n", "\n  "])
TREES = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(),
        st.text(max_size=5),
        st.dates(),
        st.binary(max_size=3),
        st.sampled_from(["gpi", "q1", "paper"]),
    ),
    lambda children: st.one_of(
        st.lists(children, max_size=3),
        st.dictionaries(
            st.sampled_from(["q1", "type", "name", "mass", "points", "omega", "loads"]), children
        ),
    ),
    max_leaves=8,
)


@settings(max_examples=150)
@given(st.lists(SCRAPS, max_size=30).map("".join))
@example("robot: {name: anthropomorphic3}\nseed: !!bool x")
@example("robot: !!int x")
@example("? [a]\n: 1")
def test_no_text_causes_anything_but_our_error(text: str) -> None:
    try:
        config.parse(text, "file.yaml")
    except ConfigError as error:
        assert error.source == "file.yaml"  # noqa: PT017 (it may also pass)


@settings(max_examples=150)
@given(st.sampled_from(sorted(config.ExperimentConfig.keys)), TREES)
@example("sample_time", 15)  # longer than the default reference
def test_no_value_of_a_key_causes_anything_but_our_error(key: str, value: object) -> None:
    data = {"robot": {"name": "anthropomorphic3"}, key: value}
    try:
        config.build(config.check(data, config.Origin("data")))
    except ConfigError as error:
        assert error.key.split(".")[0] == key  # noqa: PT017 (it may also pass)


def test_every_error_of_the_file_is_an_error_of_ours() -> None:
    assert issubclass(ConfigError, ArmgpiError)
    assert math.isfinite(config.parse(ARM, "x").config.sample_time)


WEAK = """<robot name="weak"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="10"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="LOWER" upper="UPPER" effort="EFFORT" velocity="9"/></joint></robot>"""


@pytest.mark.parametrize(
    # Gravity is 49 N m times the cosine of the angle; the middle of the ranges is 1.2 or 1.5.
    ("lower", "upper", "effort", "goal"),
    [
        (0.2, 2.2, 40.0, 1.2 + 0.5),
        (-0.1, 1.9, 40.0, 0.9 + 0.5),  # 0.9 needs 30.5, and the way up less
        (1.1, 3.1, 25.0, 2.1 - 0.5),  # 2.1 needs 24.8, and beyond more
        (0.5, 2.64, 8.0, 1.57 + 0.125),  # it stands upright, and leans as far as it can
    ],
)
def test_a_move_that_nobody_asked_for_goes_where_the_motors_hold_the_arm(
    lower: float, upper: float, effort: float, goal: float, tmp_path: Path
) -> None:
    path = tmp_path / "weak.urdf"
    text = WEAK.replace("LOWER", str(lower)).replace("UPPER", str(upper))
    path.write_text(text.replace("EFFORT", str(effort)), encoding="utf-8")
    experiment = build(f"robot: {{name: {path}}}")
    out, back = experiment.reference.moves
    np.testing.assert_allclose(out.goal, [goal], atol=1e-12)
    # Both moves are slow enough for what the motor has left beside gravity.
    for move in (out, back):
        target = move.at(np.linspace(move.t_start, move.t_start + move.duration, 201))
        tau = experiment.robot.inverse_dynamics(*target)
        assert np.abs(tau).max() <= effort


def test_a_speed_limit_of_next_to_nothing_counts_as_none(tmp_path: Path) -> None:
    path = tmp_path / "slow.urdf"
    text = WEAK.replace("LOWER", "0.2").replace("UPPER", "2.2").replace("EFFORT", "90")
    path.write_text(text.replace('velocity="9"', 'velocity="1e-300"'), encoding="utf-8")
    assert build(f"robot: {{name: {path}}}").reference.t_end < 20.0


# Work that a small file can ask for.


def nested(levels: int, form: str) -> str:
    """Return YAML in which each level has the one before nine times over."""
    lines = ["a0: &a0 {x: 1}"]
    for level in range(1, levels):
        alias = f"*a{level - 1}"
        inside = {
            "merged": ", ".join([f"<<: {alias}"] * 9),
            "merged as a list": f"<<: [{', '.join([alias] * 9)}]",
            "values": ", ".join(f"k{i}: {alias}" for i in range(9)),
        }[form]
        lines.append(f"a{level}: &a{level} {{{inside}}}")
    return "\n".join(lines)


@pytest.mark.parametrize("form", ["merged", "merged as a list", "values"])
@pytest.mark.parametrize("levels", [6, 9, 100])
def test_aliases_of_aliases_are_refused_by_line_before_they_are_written_out(levels: int, form: str) -> None:
    begun = time.process_time()
    with pytest.raises(ConfigError, match=r"bomb:6: has more than 100000 keys and values"):
        config.parse(nested(levels, form), "bomb")
    assert time.process_time() - begun < 1.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: &b [1, *b]", "x:2: is an alias of something that it is in; write it out"),
        ("a: 1\nb: &b {c: {d: *b}}", "x:2: is an alias of something that it is in; write it out"),
        ("a: 1\nb: " + "1:" * 200_000 + "1", "x:2: is a value of more than 10000 characters"),
        ('a: 1\nb: "\\ud800"', r"x:2: '\ud800' has a character that no text has"),
        ('a: 1\nb: "q\\0"', r"x:2: 'q\x00' has a character that no text has"),
    ],
)
def test_what_cannot_be_written_out_is_refused_by_line(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=f"^{re.escape(said)}$"):
        config.parse(text, "x")


def test_a_mapping_may_be_merged_into_many() -> None:
    many = "\n".join(f"  - {{<<: *common, label: c{i}}}" for i in range(20))
    text = f"robot: {{name: anthropomorphic3}}\ncontrollers:\n  - &common {{type: gpi}}\n{many}\n"
    assert len(config.parse(text, "x").config.controllers) == 21


@pytest.mark.filterwarnings("ignore:sample time, delay and encoders leave")  # its encoder is coarse
def test_a_sensor_that_is_defined_later_is_no_key_and_does_no_harm() -> None:
    class Later(Wrapper):
        config_name = "later"

    wanted = {"robot": {"name": "anthropomorphic3"}, "plant": {"encoder_bits": 12}}
    plant = config.build(config.check(wanted, config.Origin())).plant
    assert [each["type"] for each in plant.describe()["io"]] == ["Saturated", "Encoder"]
    with pytest.raises(ConfigError, match="later"):
        config.check({**wanted, "plant": {"later": 1}}, config.Origin())


def test_a_chosen_value_is_written_as_a_file_has_it() -> None:
    cases: tuple[tuple[Any, Any], ...] = (
        (2, 2),
        ("model", "model"),
        (np.array([0.5, 0.5]), 0.5),
        (np.array([0.5, 0.6]), [0.5, 0.6]),
        ((20.0, 60.0), {"lower": 20.0, "upper": 60.0}),
        ((np.full(3, 1.0), np.array([2.0, 3.0])), {"lower": 1.0, "upper": [2.0, 3.0]}),
    )
    for value, written in cases:
        assert as_section(value) == written
