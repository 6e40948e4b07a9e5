"""Robot: checks at the boundary, robots made from robots, frames, limits, and one robot per rollout.

That the equations of motion are right is in `test_dynamics.py` and `laws/test_every_robot.py`.
"""

from __future__ import annotations

import copy
import math
import pickle
import re
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import Array, State, robots, robots_and_states, states

from armgpi import Robot, RobotBatch
from armgpi.errors import ArrayError, LimitError, NameNotFound, ParameterError, UrdfError
from armgpi.robot.dynamics import StackedDynamics
from armgpi.robot.robots import locate

ARM = Robot.load("anthropomorphic3")
Q = np.array([0.3, 0.4, -0.5])
#: Every function of states, and its arguments.
FUNCTIONS = {
    "mass_matrix": ("q",),
    "gravity": ("q",),
    "nonlinear_effects": ("q", "v"),
    "forward_dynamics": ("q", "v", "tau"),
    "inverse_dynamics": ("q", "v", "a"),
    "inertia_times": ("q", "a"),
    "inertia_solve": ("q", "tau"),
}
ARGUMENTS = [(name, argument) for name, arguments in FUNCTIONS.items() for argument in arguments]


def call(robot: Robot | RobotBatch, name: str, **given: Any) -> Array:
    """Call a function of states, with Q for the arguments that are not given."""
    return getattr(robot, name)(*(given.get(argument, Q) for argument in FUNCTIONS[name]))


# --- The boundary --------------------------------------------------------------------------------

BAD = {
    "too few": [0.1, 0.2],
    "too many": [0.1, 0.2, 0.3, 0.4],
    "number": 0.1,
    "three axes": np.zeros((1, 1, 3)),
    "transposed batch": np.zeros((3, 2)),
    "float32": Q.astype(np.float32),
    "big-endian": Q.astype(">f8"),
    "integers": np.array([1, 2, 3]),
    "bools": np.array([True, False, True]),
    "ragged": [[0.1, 0.2, 0.3], [0.1]],
    "text": ["0.1", "0.2", "0.3"],
    "None": None,
}


@pytest.mark.parametrize("what", BAD)
@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_a_bad_array_is_refused_with_the_name_of_the_argument(name: str, argument: str, what: str) -> None:
    with pytest.raises(ArrayError) as caught:
        call(ARM, name, **{argument: BAD[what]})
    assert caught.value.name == argument
    assert str(caught.value).startswith(f"{argument}: expected")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_a_number_that_is_not_finite_is_refused_with_its_joint(name: str, argument: str, bad: float) -> None:
    # CRBA hides a NaN in q[0]: D is finite.
    batch = np.tile(Q, (4, 1))
    batch[2, 0] = bad
    for array, place in ((batch[2], "[0]"), (batch, "[2, 0]")):
        with pytest.raises(ArrayError, match="joint 'q1'") as caught:
            call(ARM, name, **{argument: array})
        assert f"{argument}{place} = {bad}" in str(caught.value)


@pytest.mark.parametrize("function", ["frame_pose", "frame_jacobian"])
@pytest.mark.parametrize("what", BAD)
def test_a_bad_posture_of_a_frame_is_refused(function: str, what: str) -> None:
    with pytest.raises(ArrayError, match="q: expected"):
        getattr(ARM, function)("tool", BAD[what])


def test_batches_of_different_sizes_do_not_go_together() -> None:
    with pytest.raises(ArrayError, match=r"q, v: shapes do not match: \(2, 3\), \(4, 3\)"):
        ARM.nonlinear_effects(np.zeros((2, 3)), np.zeros((4, 3)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_single_state_goes_with_any_batch(name: str) -> None:
    batch = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3))
    for argument in FUNCTIONS[name]:
        result = call(ARM, name, **{argument: batch})
        expected = [call(ARM, name, **{argument: row}) for row in batch]
        np.testing.assert_array_equal(result, expected, strict=True)


@pytest.mark.parametrize("layout", [list, tuple, np.asfortranarray, lambda x: np.repeat(x, 2, -1)[..., ::2]])
def test_lists_and_arrays_of_any_layout_give_the_same_bits(layout: Callable[[Array], Any]) -> None:
    batch = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    for name in FUNCTIONS:
        arguments = dict.fromkeys(FUNCTIONS[name], batch)
        expected = call(ARM, name, **arguments)
        odd = {key: layout(value) for key, value in arguments.items()}
        np.testing.assert_array_equal(call(ARM, name, **odd), expected)


def test_an_empty_batch_gives_empty_results() -> None:
    none = np.zeros((0, 3))
    for name, arguments in FUNCTIONS.items():
        shape = (0, 3, 3) if name == "mass_matrix" else (0, 3)
        assert call(ARM, name, **dict.fromkeys(arguments, none)).shape == shape
    assert [part.shape for part in ARM.frame_pose("tool", none)] == [(0, 3, 3), (0, 3)]
    assert ARM.frame_jacobian("tool", none).shape == (0, 6, 3)


def test_results_are_the_callers_own() -> None:
    tau = np.zeros(3)
    for name, arguments in FUNCTIONS.items():
        first = call(ARM, name, **dict.fromkeys(arguments, tau))
        first += 1.0
    assert not tau.any()
    pose = ARM.frame_pose("tool", Q)
    before = pose.translation.copy()
    ARM.frame_pose("tool", 2.0 * Q)
    np.testing.assert_array_equal(pose.translation, before)


# --- Frames --------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [ARM.frame_pose, ARM.frame_jacobian])
def test_a_frame_that_does_not_exist_is_refused_and_the_near_one_offered(function: Any) -> None:
    # Pinocchio returns an index past the end for it, which crashes or is silently zero later.
    with pytest.raises(NameNotFound, match="no frame named 'tol'; did you mean 'tool'") as caught:
        function("tol", Q)
    assert caught.value.valid == ARM.frame_names
    for name in (None, 3, ["tool"]):
        with pytest.raises(NameNotFound):
            function(name, Q)


def test_links_and_joints_are_frames_and_the_base_does_not_move() -> None:
    assert {"base", "q1", "link1", "q2", "link2", "q3", "link3", "tool"} <= set(ARM.frame_names)
    assert not ARM.frame_jacobian("base", Q).any()
    np.testing.assert_array_equal(ARM.frame_pose("base", Q).rotation, np.eye(3))


def test_the_pose_is_a_rotation_and_a_position_of_the_same_frame_as_in_pinocchio() -> None:
    model = ARM.pinocchio_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, Q)
    place = data.oMf[model.getFrameId("tool")]
    pose = ARM.frame_pose("tool", Q)
    np.testing.assert_array_equal(pose.rotation, place.rotation)
    np.testing.assert_array_equal(pose.translation, place.translation)


# --- Limits --------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(robots_and_states(max_joints=4))
def test_positions_inside_the_limits_pass_and_those_outside_are_refused_by_joint(
    case: tuple[Robot, State],
) -> None:
    robot, (q, _, _) = case
    np.testing.assert_array_equal(robot.check_position(q, "the start"), q)
    for j, name in enumerate(robot.joint_names):
        for limit, step in ((robot.limits.lower[j], -1e-6), (robot.limits.upper[j], 1e-6)):
            if np.isinf(limit):
                continue
            outside = q.copy()
            outside[j] = limit + step
            with pytest.raises(LimitError, match="the start") as caught:
                robot.check_position(np.stack([q, outside]), "the start")
            assert (caught.value.joint, caught.value.value) == (name, outside[j])
            assert (caught.value.lower, caught.value.upper) == (
                robot.limits.lower[j],
                robot.limits.upper[j],
            )
            outside[j] = limit + 1e-6 * step  # rounding is no offence
            robot.check_position(outside, "the start")


@settings(max_examples=30)
@given(robots(max_joints=4))
def test_the_middle_halves_the_ranges_and_is_zero_without(robot: Robot) -> None:
    middle, (lower, upper, _, _) = robot.middle(), robot.limits
    bounded = np.isfinite(lower)
    np.testing.assert_allclose(middle[bounded] - lower[bounded], upper[bounded] - middle[bounded], atol=1e-15)
    assert not middle[~bounded].any()


@pytest.mark.parametrize("batch", [False, True])
def test_the_first_position_outside_is_found_whatever_the_leading_axes(batch: bool) -> None:
    robot: Robot | RobotBatch = RobotBatch([ARM, ARM.with_limits(upper={"q3": 0.1})]) if batch else ARM
    q = np.zeros((4, 2, 3))
    assert robot.outside(q) is None
    q[2, 1, 2] = 100.0
    upper = 0.1 if batch else ARM.limits.upper[2]
    assert robot.outside(q) == ((2, 1, 2), "q3", 100.0, ARM.limits.lower[2], upper)


def test_the_share_that_holding_takes_is_gravity_over_effort() -> None:
    q = ARM.random_positions(50)
    torque = np.abs(ARM.gravity(q))
    np.testing.assert_array_equal(ARM.holding_share(q), torque / ARM.limits.effort)
    assert not ARM.with_limits(effort=np.inf).holding_share(q).any()
    # q1 turns about the vertical: gravity asks it for nothing, so no motor is enough.
    np.testing.assert_array_equal(ARM.with_limits(effort=0.0).holding_share(q[0]), [0.0, np.inf, np.inf])
    # What a file has for next to nothing is too little as well, without a warning.
    file, *_ = locate("anthropomorphic3")
    weak = Robot.from_xml(re.sub('effort="[^"]*"', 'effort="1e-310"', file.read_text(encoding="utf-8")))
    np.testing.assert_array_equal(weak.holding_share(q[0]), [0.0, np.inf, np.inf])
    batch = RobotBatch([ARM, ARM.with_limits(effort=1.0)])
    np.testing.assert_array_equal(batch.holding_share(q[:2])[1], torque[1])


def test_the_motor_that_is_the_weakest_against_gravity_is_found_and_refused() -> None:
    q = ARM.random_positions(50)
    torque = ARM.gravity(q)
    row = int(np.abs(torque[:, 1]).argmax())
    most = abs(torque[row, 1])
    enough, weak = ARM.with_limits(effort={"q2": most}), ARM.with_limits(effort={"q2": 0.5 * most})
    assert enough.overloaded(q) is None
    enough.check_holding(q, "the start")
    assert weak.overloaded(q) == ((row, 1), "q2", torque[row, 1], 0.5 * most)
    with pytest.raises(LimitError, match=r"holds the arm at the start of joint 'q2'.*with_limits") as caught:
        weak.check_holding(q, "the start")
    (remedy,) = caught.value.remedies
    assert remedy[:2] == ("effort", ("q2",))
    assert isinstance(remedy.value, float)
    assert remedy.value == pytest.approx(1.5 * most, rel=5e-3)
    ARM.with_limits(effort={"q2": remedy.value}).check_holding(q, "the start")


def test_a_count_divides_a_turn_or_the_travel_of_a_joint_that_slides() -> None:
    np.testing.assert_array_equal(ARM.encoder_count(16), np.full(3, 2.0 * np.pi / 65536))
    np.testing.assert_array_equal(ARM.encoder_count(np.array([1, 2, 3])), 2.0 * np.pi / np.array([2, 4, 8]))
    panda = Robot.load("panda", mimic="follow")
    assert panda.prismatic.tolist() == [False] * 7 + [True]
    assert panda.encoder_count(3)[7] == (panda.limits.upper[7] - panda.limits.lower[7]) / 8
    boundless = panda.with_limits(lower={"panda_finger_joint1": -np.inf})
    assert boundless.encoder_count(3)[7] == 0.125


def test_limits_cannot_be_changed_in_place() -> None:
    for array in (*ARM.limits, *ARM.friction):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("effort", "expected"),
    [
        (5.0, [5.0, 5.0, 5.0]),
        ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        ({"q2": 7.0}, [30.0, 7.0, 15.0]),
        (np.inf, [np.inf] * 3),
        ({"q2": np.inf}, [30.0, np.inf, 15.0]),
        ([1.0, np.inf, 3.0], [1.0, np.inf, 3.0]),
        (0.0, [0.0, 0.0, 0.0]),
    ],
)
def test_limits_are_given_as_a_number_an_array_or_by_name(effort: Any, expected: list[float]) -> None:
    robot = ARM.with_limits(effort=effort)
    np.testing.assert_array_equal(robot.limits.effort, expected)
    np.testing.assert_array_equal(robot.limits.lower, ARM.limits.lower)
    np.testing.assert_array_equal(ARM.limits.effort, [30.0, 30.0, 15.0])


@pytest.mark.parametrize("robot", [ARM, Robot.load("kinova"), Robot.load("finger_edu")])
def test_a_robots_own_limits_change_nothing(robot: Robot) -> None:
    same = robot.with_limits(**robot.limits._asdict())
    for limit, own in zip(same.limits, robot.limits, strict=True):
        np.testing.assert_array_equal(limit, own)


@pytest.mark.parametrize("name", ["effort", "velocity"])
def test_a_negative_limit_is_refused_by_joint(name: str) -> None:
    with pytest.raises(LimitError, match=f"{name} of joint 'q2' is -1") as caught:
        ARM.with_limits(**{name: {"q2": -1.0}})
    assert caught.value.joint == "q2"


def test_a_lower_limit_above_the_upper_is_refused_by_joint() -> None:
    with pytest.raises(LimitError, match="lower limit of joint 'q3' is 3") as caught:
        ARM.with_limits(lower={"q3": 3.0})
    assert (caught.value.value, caught.value.upper) == (3.0, ARM.limits.upper[2])


# --- Robots made from robots ---------------------------------------------------------------------

CHANGES: dict[str, Callable[[Robot], Robot]] = {
    "payload": lambda robot: robot.with_payload("tool", 0.5, [0.0, 0.0, 0.1]),
    "armature": lambda robot: robot.with_armature(0.1),
    "inertia_scale": lambda robot: robot.scaled_inertia(0.8),
    "gravity": lambda robot: robot.with_gravity([0.0, 0.0, -1.62]),
    "limits": lambda robot: robot.with_limits(effort=5.0),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_change_makes_another_robot_that_remembers_it(what: str) -> None:
    before = {name: call(ARM, name) for name in FUNCTIONS}
    other = CHANGES[what](ARM)
    assert other is not ARM
    assert [set(change) for change in other.provenance["changes"]] == [{what}]
    assert ARM.provenance["changes"] == []
    assert (other.name, other.joint_names, other.frame_names) == (
        ARM.name,
        ARM.joint_names,
        ARM.frame_names,
    )
    for name, result in before.items():
        np.testing.assert_array_equal(call(ARM, name), result, err_msg=name)


def test_changes_add_up_whatever_their_order() -> None:
    one = ARM.with_payload("tool", 0.5).with_armature(0.1).with_gravity([0.0, 0.0, -1.62])
    two = ARM.with_gravity([0.0, 0.0, -1.62]).with_armature(0.1).with_payload("tool", 0.5)
    for name in FUNCTIONS:
        np.testing.assert_allclose(call(one, name), call(two, name), rtol=1e-14)
    assert len(one.provenance["changes"]) == 3


def test_two_loads_at_a_frame_are_one_with_the_masses_added() -> None:
    two = ARM.with_payload("tool", 0.2, [0.1, 0.0, 0.0]).with_payload("tool", 0.3, [0.1, 0.0, 0.0])
    one = ARM.with_payload("tool", 0.5, [0.1, 0.0, 0.0])
    for name in FUNCTIONS:
        np.testing.assert_allclose(call(two, name), call(one, name), rtol=1e-13)


def test_no_load_is_no_change() -> None:
    empty = ARM.with_payload("tool", 0.0)
    for name in FUNCTIONS:
        np.testing.assert_allclose(call(empty, name), call(ARM, name), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("tol", 1.0), NameNotFound),
        (("base", 1.0), ParameterError),  # it does not move
        (("tool", -1.0), ParameterError),
        (("tool", np.nan), ArrayError),
        (("tool", np.inf), ArrayError),
        (("tool", "1.0"), ArrayError),
        (("tool", [1.0]), ArrayError),
        (("tool", True), ArrayError),
        (("tool", 1.0, [0.0, 0.0]), ArrayError),
        (("tool", 1.0, [0.0, 0.0, np.nan]), ArrayError),
        (("tool", 1.0, 0.1), ArrayError),
        (("tool", 1.0, (0.0, 0.0, 0.0), np.eye(2)), ArrayError),
        (("tool", 1.0, (0.0, 0.0, 0.0), np.diag([1.0, -0.1, 1.0])), ArrayError),
        (("tool", 1.0, (0.0, 0.0, 0.0), np.triu(np.ones((3, 3)))), ArrayError),
    ],
)
def test_a_load_that_cannot_be_is_refused(arguments: tuple[Any, ...], error: type[Exception]) -> None:
    with pytest.raises(error):
        ARM.with_payload(*arguments)


@pytest.mark.parametrize("factor", [0.0, -1.0])
def test_an_inertia_factor_is_positive(factor: float) -> None:
    with pytest.raises(ParameterError, match="factor must be positive"):
        ARM.scaled_inertia(factor)
    assert ARM.scaled_inertia(1e-30).total_mass > 0.0


@pytest.mark.parametrize("factor", [np.nan, np.inf, [1.0, 2.0], "1", True])
def test_an_inertia_factor_is_one_finite_number(factor: Any) -> None:
    with pytest.raises(ArrayError, match="factor"):
        ARM.scaled_inertia(factor)


def test_the_armature_of_joints_that_are_not_named_stays() -> None:
    robot = ARM.with_armature([0.1, 0.2, 0.3]).with_armature({"q2": 0.5})
    np.testing.assert_array_equal(robot.armature, [0.1, 0.5, 0.3])


@pytest.mark.parametrize(
    ("armature", "error"),
    [
        (-0.1, LimitError),
        ({"q2": -0.1}, LimitError),
        (np.inf, LimitError),
        (np.nan, ArrayError),
        ({"q2": np.nan}, ArrayError),
        ({"q2": [0.1]}, ArrayError),
        ([0.1, 0.2], ArrayError),
        (np.ones(3, dtype=np.float32), ArrayError),
        ({"q4": 0.1}, NameNotFound),
    ],
)
def test_an_armature_that_cannot_be_is_refused(armature: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"armature|q4"):
        ARM.with_armature(armature)


@pytest.mark.parametrize("gravity", [9.81, [0.0, -9.81], [0.0, 0.0, np.nan]])
def test_gravity_is_a_vector(gravity: Any) -> None:
    with pytest.raises(ArrayError, match="gravity"):
        ARM.with_gravity(gravity)


def test_the_pinocchio_model_is_a_copy() -> None:
    model = ARM.pinocchio_model()
    model.gravity = pin.Motion.Zero()
    assert ARM.gravity(Q).any()
    assert ARM.pinocchio_model() is not ARM.pinocchio_model()


def test_a_robot_says_what_it_is() -> None:
    assert repr(ARM) == "Robot('anthropomorphic3', n=3, joints=q1, q2, q3)"
    assert ARM.tip == "tool"


# --- Frozen, safe in threads, picklable ----------------------------------------------------------


@pytest.mark.parametrize("robot", [ARM, RobotBatch([ARM, ARM.scaled_inertia(1.2)])])
def test_no_attribute_of_a_robot_can_be_assigned_or_deleted(robot: Robot | RobotBatch) -> None:
    names = [name for name in (*vars(robot), *vars(type(robot))) if not name.startswith("_")]
    assert {"limits", "dynamics", "name"} <= set(names)
    for name in [*names, "n", "prismatic", "provenance", "batch", "a_name_of_ones_own"]:
        with pytest.raises(ParameterError, match=f"^{name} must be left as it is: a Robot") as caught:
            setattr(robot, name, None)
        assert (caught.value.name, caught.value.value) == (name, None)
        with pytest.raises(ParameterError, match=name):
            delattr(robot, name)


def test_the_provenance_is_the_callers_own() -> None:
    given: dict[str, Any] = {"source": "a file", "locked": {}, "changes": []}
    robot = Robot(ARM.pinocchio_model(), "arm", ARM.joint_types, ARM.limits, ARM.friction, given)
    given["locked"]["q1"] = 1.0
    provenance = robot.provenance
    provenance["changes"].append("a forgery")
    provenance["source"] = "another file"
    assert robot.provenance == {"source": "a file", "locked": {}, "changes": []}
    assert robot.with_limits(effort=1.0).provenance["changes"] == [{"limits": {"effort": [1.0, 1.0, 1.0]}}]


@pytest.fixture
def impatient_threads() -> Iterator[None]:
    """Make Python change threads as often as it can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def answers(robot: Robot, q: Array) -> list[Array]:
    """Return what every function of a robot says at some configurations, one by one and as a batch."""
    calls = [
        lambda q: robot.frame_pose("tool", q).translation,
        lambda q: robot.frame_jacobian("tool", q),
        lambda q: robot.frame_drift("tool", q, q),
        lambda q: robot.mass_matrix(q),
        lambda q: robot.forward_dynamics(q, q, q),
        lambda q: robot.inverse_dynamics(q, q, q),
        lambda q: robot.inertia_times(q, q),
        lambda q: robot.inertia_solve(q, q),
    ]
    return [np.array([call(row) for row in q]) for call in calls] + [np.array(call(q)) for call in calls]


@pytest.mark.usefixtures("impatient_threads")
def test_threads_may_use_one_robot_at_the_same_time() -> None:
    # With one working memory for all of them, threads read each other's poses.
    robot = ARM.scaled_inertia(0.8)
    configurations = np.random.default_rng(5).uniform(-1.0, 1.0, (4, 300, 3))
    expected = [answers(robot, q) for q in configurations]
    with ThreadPoolExecutor(4) as pool:
        got = list(pool.map(lambda q: answers(robot, q), [*configurations] * 5))
    for one, other in zip(got, expected * 5, strict=True):
        for values, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(values, right)


COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


@pytest.mark.parametrize("used", [False, True])
@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize(
    "make",
    [
        lambda: Robot.load("anthropomorphic3"),
        lambda: Robot.load("anthropomorphic3").with_payload("tool", 0.3).scaled_inertia(0.8),
        lambda: Robot.load("z1", mimic="follow"),
    ],
)
def test_a_copy_of_a_robot_says_the_same_before_and_after_use(
    make: Callable[[], Robot], way: str, used: bool
) -> None:
    robot = make()
    q = robot.random_positions(20)
    if used:
        call_all(robot, q)
    other = COPIES[way](robot)
    for one, two in zip(call_all(other, q), call_all(robot, q), strict=True):
        np.testing.assert_array_equal(one, two)
    assert (other.provenance, other.joint_names, other.tip) == (
        robot.provenance,
        robot.joint_names,
        robot.tip,
    )
    for array in (*other.limits, *other.friction, *(other.coupling or ())):
        assert not array.flags.writeable


def call_all(robot: Robot | RobotBatch, q: Array) -> list[Array]:
    """Return what the equations of motion, and the frames of a single robot, say."""
    results = [getattr(robot, name)(*(q for _ in arguments)) for name, arguments in FUNCTIONS.items()]
    if isinstance(robot, Robot):
        results += [robot.frame_pose(robot.tip, q).rotation, robot.frame_jacobian(robot.tip, q)]
    return results


@pytest.mark.parametrize("way", COPIES)
def test_a_copy_of_a_robot_batch_says_the_same_and_keeps_its_groups(way: str) -> None:
    robots = RobotBatch([ARM, ARM.scaled_inertia(1.2), ARM.with_payload("tool", 0.3), ARM])
    q = ARM.random_positions(4)
    call_all(robots, q)
    other = COPIES[way](robots)
    for one, two in zip(call_all(other, q), call_all(robots, q), strict=True):
        np.testing.assert_array_equal(one, two)
    assert isinstance(other.dynamics, StackedDynamics)
    assert len(other.dynamics.groups) == 2  # two different models, one of them with two factors
    assert not other.limits.effort.flags.writeable


# --- One robot per rollout -----------------------------------------------------------------------


@settings(max_examples=30)
@given(robots(max_joints=4), st.data())
def test_every_row_of_a_robot_batch_is_its_robots(robot: Robot, data: st.DataObject) -> None:
    members = [robot, robot.scaled_inertia(1.2), robot.with_armature(0.3), robot]
    batch = RobotBatch(members)
    rows = [data.draw(states(robot)) for _ in members]
    given = {"q": [s.q for s in rows], "v": [s.v for s in rows], "a": [s.a for s in rows]}
    given["tau"] = given["a"]
    for name, arguments in FUNCTIONS.items():
        result = getattr(batch, name)(*(np.stack(given[key]) for key in arguments))
        expected = [
            getattr(member, name)(*(given[key][i] for key in arguments)) for i, member in enumerate(members)
        ]
        np.testing.assert_array_equal(result, expected, err_msg=name, strict=True)


def test_one_state_is_every_rows_state() -> None:
    batch = RobotBatch([ARM, ARM.scaled_inertia(0.8)])
    expected = [robot.mass_matrix(Q) for robot in batch.robots]
    np.testing.assert_array_equal(batch.mass_matrix(Q), expected)
    np.testing.assert_array_equal(batch.middle(), [ARM.middle(), ARM.middle()])


@pytest.mark.parametrize("rows", [1, 3])
def test_a_batch_of_states_has_one_row_per_robot_or_a_single_one(rows: int) -> None:
    batch = RobotBatch([ARM, ARM])
    if rows == 1:
        assert batch.gravity(Q[np.newaxis]).shape == (2, 3)
        return
    with pytest.raises(ArrayError, match="shapes do not match"):
        batch.gravity(np.tile(Q, (rows, 1)))


def test_every_row_has_its_own_limits() -> None:
    batch = RobotBatch([ARM, ARM.with_limits(upper={"q3": 0.1})])
    assert batch.limits.upper.shape == (2, 3)
    inside = np.array([0.0, 0.0, 0.1])
    np.testing.assert_array_equal(batch.check_position(inside, "the start"), [inside, inside])
    for outside in (np.array([0.0, 0.0, 0.2]), np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 0.2]])):
        with pytest.raises(LimitError) as caught:
            batch.check_position(outside, "the start")
        assert (caught.value.joint, caught.value.upper) == ("q3", 0.1)
    with pytest.raises(ArrayError):
        batch.check_position(np.zeros((3, 3)), "the start")


@pytest.mark.parametrize("members", [[], None, [ARM, "panda"], [ARM, Robot.load("twodof")]])
def test_robots_that_do_not_stack_are_refused(members: Any) -> None:
    with pytest.raises(ParameterError, match="robots must be"):
        RobotBatch(members)


TRANSMISSIONS = {
    "drake": (
        """<transmission><joint name="j1"/><actuator name="a"><drake:gear_ratio value="50"/>
        <drake:rotor_inertia value="2e-5"/></actuator></transmission>""",
        0.05,
    ),
    "classic": (
        """<transmission name="t"><joint name="j1"/><actuator name="a">
        <mechanicalReduction>10</mechanicalReduction>
        <motorInertia>1e-4</motorInertia></actuator></transmission>""",
        0.01,
    ),
    "no ratio": (
        """<transmission name="t"><joint name="j1"/><actuator name="a">
        <rotor_inertia>0.3</rotor_inertia></actuator>
        </transmission>""",
        0.3,
    ),
    "ros2_control": (
        """<ros2_control name="c" type="system"><joint name="j1">
        <param name="rotor_inertia">0.2</param></joint>
        <joint name="other"><param name="rotor_inertia">9</param></joint></ros2_control>""",
        0.2,
    ),
    "none": ("""<transmission name="t"><joint name="j1"/><actuator name="a"/></transmission>""", 0.0),
}


@pytest.mark.parametrize("name", TRANSMISSIONS)
def test_the_rotor_inertia_of_a_urdf_is_taken(name: str) -> None:
    text, expected = TRANSMISSIONS[name]
    robot = Robot.from_xml(driven(text))
    np.testing.assert_allclose(robot.armature, [expected], rtol=1e-15)
    bare = Robot.from_xml(driven(""))
    np.testing.assert_allclose(robot.mass_matrix([0.3]), bare.mass_matrix([0.3]) + expected, rtol=1e-12)


@pytest.mark.parametrize(("name", "ratio"), [("drake", 50.0), ("classic", 10.0), ("no ratio", math.nan)])
def test_the_gear_ratio_of_a_urdf_is_kept(name: str, ratio: float) -> None:
    robot = Robot.from_xml(driven(TRANSMISSIONS[name][0]))
    np.testing.assert_array_equal(robot.drives.value("gear_ratio"), [ratio])


@pytest.mark.parametrize("ratio", ["0", "inf", "nan", "many"])
def test_a_gear_ratio_of_a_urdf_that_cannot_be_is_refused(ratio: str) -> None:
    text = TRANSMISSIONS["classic"][0].replace(">10<", f">{ratio}<")
    with pytest.raises(UrdfError, match=r"gear ratio of joint 'j1'|mechanicalReduction"):
        Robot.from_xml(driven(text))


@pytest.mark.parametrize("value", ["-1", "heavy", "nan"])
def test_a_rotor_inertia_that_cannot_be_is_refused(value: str) -> None:
    with pytest.raises(UrdfError, match="rotor"):
        Robot.from_xml(driven(TRANSMISSIONS["no ratio"][0].replace("0.3", value)))


def driven(transmission: str) -> str:
    """An arm of one joint with a transmission."""
    return f"""<robot name="r" xmlns:drake="http://drake.mit.edu"><link name="base"/><link name="l">
    <inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j1" type="revolute"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>{transmission}</robot>"""


def test_friction_can_be_set_joint_by_joint() -> None:
    robot = Robot.load("ur5")
    name = robot.joint_names[1]
    rough = robot.with_friction(viscous=2.0, coulomb={name: 3.0})
    np.testing.assert_array_equal(rough.friction.viscous, 2.0)
    np.testing.assert_array_equal(rough.friction.coulomb[1], 3.0)
    np.testing.assert_array_equal(np.delete(rough.friction.coulomb, 1), np.delete(robot.friction.coulomb, 1))
    assert rough.provenance["changes"][-1]["friction"]["viscous"] == [2.0] * robot.n
    with pytest.raises(LimitError, match="coulomb"):
        robot.with_friction(coulomb=-1.0)


def test_loads_that_differ_between_rollouts_hang_where_their_frame_is() -> None:
    """With and without a centre of mass of their own, each row is the arm with that load."""
    arm, q = Robot.load("ur5"), np.linspace(-0.5, 0.5, 6)
    masses, centres = np.array([0.5, 2.0]), np.array([[0.0, 0.02, 0.1], [0.05, 0.0, 0.0]])
    frame = "ee_link"
    assert np.linalg.norm(arm._model.frames[arm._frame(frame)].placement.translation) > 0.05
    for options in ({}, {"com": centres}):
        rows = arm.varied(payload=masses, frame=frame, **options)
        held = rows.gravity(np.tile(q, (2, 1)))
        for i, mass in enumerate(masses):
            wanted = arm.with_payload(frame, mass, *[each[i] for each in options.values()]).gravity(q)
            np.testing.assert_allclose(held[i], wanted, rtol=1e-12, atol=1e-12)
