"""Generated equations of motion are Pinocchio's, for every arm there is; wrong ones are refused."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from machines import sled, swing
from sampling import sample
from strategies import robots_and_states

from armgpi import ArmgpiWarning, Robot, RobotBatch, robots
from armgpi.codegen import model
from armgpi.codegen.model import SymbolicModel
from armgpi.codegen.symbols import NotElementwise
from armgpi.robot.dynamics import PinocchioDynamics, ScaledDynamics, VariedDynamics

ca = pytest.importorskip("casadi")
from armgpi.codegen import kernels  # noqa: E402
from armgpi.codegen.kernels import Arm  # noqa: E402

KERNELS = {
    "inverse": 3,
    "inertia_times": 2,
    "nonlinear_effects": 2,
    "gravity": 1,
    "mass_matrix": 1,
    "forward": 3,
    "inertia_solve": 2,
}
#: Those that divide by D(q), and so lose as many digits as its condition number has.
DIVIDE = ("forward", "inertia_solve")
LINKAGE = """<robot name="linkage"><link name="base"/>
<link name="l1"><inertial><origin xyz="0.2 0.1 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
<link name="l2"><inertial><origin xyz="0 0.1 0.1"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0.001"/></inertial></link>
<link name="l3"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint>
<joint name="b" type="prismatic"><parent link="l1"/><child link="l2"/><origin xyz="0.4 0 0" rpy="0.3 0 0"/>
<axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" effort="50" velocity="5"/>
<mimic joint="a" multiplier="-0.4" offset="0.1"/></joint>
<joint name="c" type="revolute"><parent link="l1"/><child link="l3"/><origin xyz="0 0.2 0" rpy="0 0.5 1"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="50" velocity="5"/></joint></robot>"""


def worst(robot: Any, names: Any = KERNELS, states: int = 4) -> float:
    """Return the largest error of generated functions, in roundings of the largest torque or acceleration.

    What divides by D(q) may be wrong by D(q)'s condition number as many roundings, here times what they are.
    """
    rng = np.random.default_rng(5)
    arm = Arm(robot.dynamics)
    factor = 0.0
    for name in names:
        kernel = arm.kernel(name)
        function = ca.Function("f", [ca.vertcat(*kernel.inputs)], [ca.vertcat(*kernel.outputs)])
        for _ in range(states):
            x, y, z = rng.normal(size=(3, robot.n))
            x = np.clip(x, robot.limits.lower, robot.limits.upper)
            arguments = (x, y, z)[: KERNELS[name]]
            expected = np.ravel(getattr(robot.dynamics, name)(*arguments))
            got = np.array(function(np.concatenate(arguments))).ravel()
            D = robot.mass_matrix(x)
            if name in DIVIDE or name == "mass_matrix":
                size = np.abs(expected).max() * np.linalg.cond(D)
            else:
                size = np.abs(D).sum() * (1.0 + y @ y + np.abs(z).max()) + robot.total_mass * 9.81
            factor = max(factor, float(np.abs(got - expected).max() / size))
    return factor / np.finfo(np.float64).eps


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    sample(robots.names(), 4),
)
def test_every_arm_of_the_zoo_is_generated_right(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        # With its gripper, where there is one: arms that branch.
        robot = Robot.load(name)
    assert worst(robot) < 100.0


@settings(max_examples=15)
@given(robots_and_states(max_joints=5))
def test_any_chain_or_tree_is_generated_right(case: Any) -> None:
    robot, _ = case
    assert worst(robot, ("inverse", "forward"), states=2) < 100.0


def variants() -> dict[str, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        panda = Robot.load("panda", mimic="follow")
        ur5 = Robot.load("ur5")
    linkage = Robot.from_xml(LINKAGE, mimic="follow")
    return {
        "fingers that follow": panda,
        "a slide that follows a turn": linkage,
        "one that follows, with rotors": linkage.with_armature([0.3, 0.1]),
        "payload": ur5.with_payload(ur5.tip, 2.0, [0.1, 0.0, 0.05]),
        "rotors": ur5.with_armature(np.linspace(0.1, 0.6, 6)),
        "gravity": ur5.with_gravity([1.0, -2.0, 3.0]),
        "no gravity": ur5.with_gravity([0.0, 0.0, 0.0]),
        "on a wall": Robot.load("anthropomorphic3").with_gravity([-9.81, 0.0, 0.0]),
        "rail": sled(),
        "hoist": sled(axis="0 0 1"),
        "pendulums": swing(3),
        "level arm": swing(3, "0 0 1"),
    }


@pytest.mark.parametrize("name", variants())
def test_changed_arms_are_generated_right(name: str) -> None:
    assert worst(variants()[name]) < 100.0


def test_joints_that_gravity_does_not_load_are_no_reason_to_refuse() -> None:
    # Their torque is zero, or what rounding leaves of it: relative to itself that is all wrong.
    turned = swing(2, "0.6 0 0.8").with_gravity([-0.6 * 9.81, 0.0, -0.8 * 9.81])
    for robot in (turned, swing(2, "0 0 1"), sled()):
        for name in ("gravity", "nonlinear_effects"):
            Arm(robot.dynamics).kernel(name)


def test_rows_of_a_batch_have_their_own_numbers() -> None:
    base = Robot.load("anthropomorphic3")
    arms = [
        base,
        base.with_payload(base.tip, 0.5),
        base.with_armature(0.1),
        base.with_gravity([0.0, 1.0, -9.0]),
        base.scaled_inertia(0.8),
        base,
    ]
    batch = RobotBatch(arms)
    arm = Arm(batch.dynamics)
    kernel = arm.kernel("inverse")
    function = ca.Function(
        "f", [ca.vertcat(*kernel.inputs), ca.vertcat(*kernel.parameters)], [ca.vertcat(*kernel.outputs)]
    )
    scale = np.broadcast_to(arm.scale, (len(arms), 1))
    states = np.random.default_rng(0).normal(size=(len(arms), 3, base.n))
    for robot, row, factor, (q, v, a) in zip(arms, arm.table, scale, states, strict=True):
        got = factor * np.array(function(np.concatenate([q, v, a]), row)).ravel()
        np.testing.assert_allclose(got, robot.dynamics.inverse(q, v, a), rtol=1e-12, atol=1e-12)
    # What all of them share is in the code, not in the table.
    assert arm.table.shape[1] < 30
    assert Arm(RobotBatch([base, base]).dynamics).table.shape[1] == 0


def test_a_wrong_model_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot.load("ur5")
    inverse = SymbolicModel.inverse

    mass_matrix = SymbolicModel.mass_matrix

    def planted(error: float, name: str) -> None:
        monkeypatch.setattr(kernels, "_made", {})  # what was made without the error
        # Forward dynamics divides by D: an error in both D and the rest would cancel.
        if name in DIVIDE or name == "mass_matrix":
            monkeypatch.setattr(
                SymbolicModel, "mass_matrix", lambda self, q: mass_matrix(self, q) * (1.0 + error)
            )
        else:
            wrong = lambda *a, **b: inverse(*a, **b) * (1.0 + error)  # noqa: E731
            monkeypatch.setattr(SymbolicModel, "inverse", wrong)

    for name in KERNELS:
        planted(1e-11, name)
        Arm(robot.dynamics).kernel(name)
        planted(3e-9, name)
        with pytest.raises(NotElementwise, match=f"generated {name} differs from Pinocchio's by .*e-09"):
            Arm(robot.dynamics).kernel(name)
        monkeypatch.undo()


def test_equal_models_have_their_equations_in_common_and_others_have_not() -> None:
    robot, again = Robot.load("ur5"), Robot.load("ur5")
    arms = [Arm(each.dynamics) for each in (robot, again, robot.with_armature(0.1), robot.with_armature(0.2))]
    first, same, light, heavy = (arm.kernel("forward") for arm in arms)
    assert same is not first  # who calls it is told by it
    assert same.outputs is first.outputs
    assert len({first.name, light.name, heavy.name}) == 3
    assert light.outputs is not first.outputs
    assert heavy.outputs is not first.outputs


def test_a_batch_is_checked_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    base = Robot.load("anthropomorphic3")
    arm = Arm(RobotBatch([base, base.with_payload(base.tip, 0.5)]).dynamics)
    arm.model.table[1] *= 1.0 + 1e-8
    with pytest.raises(NotElementwise, match="differs from Pinocchio's"):
        arm.kernel("inverse")


def test_dynamics_of_others_are_refused() -> None:
    class Own:
        def __getattr__(self, name: str) -> Any:
            return lambda *arguments: np.zeros(2)

    for dynamics in (Own(), ScaledDynamics(Own(), 2.0)):
        with pytest.raises(NotElementwise, match="its dynamics are Own, not Pinocchio's"):
            Arm(dynamics)


@pytest.mark.parametrize("what", ["load", "armature", "gravity", "load armature gravity"])
def test_numbers_that_vary_are_those_that_differ_between_the_rows(what: str) -> None:
    """Rows of a batch have other numbers where they are said to vary, and nowhere else."""
    arm = Robot.load("ur5").dynamics
    assert isinstance(arm, PinocchioDynamics)
    rng = np.random.default_rng(4)
    given: dict[str, Any] = {
        "load": {
            "joint": 4,
            "load": np.column_stack([rng.uniform(1.0, 2.0, 3), rng.uniform(-0.1, 0.1, (3, 3))]),
        },
        "armature": {"armature": rng.uniform(0.1, 1.0, (3, 6))},
        "gravity": {"gravity": rng.uniform(-9.0, 9.0, (3, 3))},
    }
    varied = VariedDynamics(arm, 3, **{key: x for name in what.split() for key, x in given[name].items()})
    rows = np.array([model.numbers_of(*model.bodies(varied.row(i).model)) for i in range(3)])
    says = model.varying(arm.model, varied)
    differ = (rows != rows[0]).any(axis=0)
    assert says.shape == rows[0].shape
    assert not (differ & ~says).any()
    assert differ.sum() >= 0.9 * says.sum()  # a moment may be equal by chance, a mass is not
    own = model.numbers_of(*model.bodies(arm.model))[says]
    table = model.varied_table(arm.model, varied, own)
    np.testing.assert_allclose(table, rows[:, says], rtol=1e-12, atol=1e-15)
