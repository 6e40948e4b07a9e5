"""Doors to other programs: Gymnasium, MCAP, Rerun, MuJoCo's models, notebooks."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, Bezier, RigidBodyPlant, Robot, metrics, plots, simulate
from armgpi.config import experiment
from armgpi.errors import MissingPackage, ParameterError, UnreadableTrajectory, UrdfError
from armgpi.loop import logs
from armgpi.references.recorded import Recorded

ARM = Robot.load("anthropomorphic3")
MOVE = Bezier(ARM.middle(), ARM.middle() + 0.3, duration=0.2)
RUN = simulate(RigidBodyPlant(ARM), GPI(ARM, 1e-3), MOVE, 0.25, progress=False)

TWO = """<mujoco model="two"><compiler angle="radian"/><worldbody>
  <body name="base"><geom type="box" size="0.1 0.1 0.05" mass="1"/>
    <body name="upper" pos="0 0 0.1" euler="0.1 0.2 0.3">
      <joint name="j1" axis="0 1 0" range="-2 2" damping="0.3" armature="0.05" frictionloss="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.04" mass="2"/>
      <body name="lower" pos="0 0 0.4">
        <joint name="j2" type="slide" axis="1 0 0" range="-1 1" armature="0.02"/>
        <inertial pos="0 0 0.15" mass="1.2" diaginertia="0.01 0.011 0.002"/>
        <body name="tool" pos="0 0 0.3"/></body></body></body></worldbody>
  <actuator><motor joint="j1" ctrlrange="-30 30" ctrllimited="true"/>
    <motor joint="j2" gear="2" forcerange="-10 10" forcelimited="true"/></actuator>{more}</mujoco>"""


# Gymnasium.


def test_an_environment_without_actions_is_the_closed_loop() -> None:
    pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    from armgpi.envs import ArmEnv

    env = ArmEnv(RigidBodyPlant(ARM), GPI(ARM, 1e-3), MOVE, 0.25)
    with warnings.catch_warnings():
        # It warns of unbounded observations, and of an environment without a name.
        warnings.simplefilter("ignore")
        check_env(env, skip_render_check=True)
    env.reset(seed=0)
    rewards, done = [], False
    while not done:
        _, reward, lost, done, info = env.step(np.zeros(3))
        assert not lost
        rewards.append(reward)
    np.testing.assert_array_equal(info["error"], metrics.error(RUN).values[-1])
    after = np.abs(metrics.error(RUN).values[1:])
    np.testing.assert_allclose(-sum(rewards), 1e-3 * after.mean(axis=1).sum(), rtol=1e-12)


def test_an_episode_draws_its_plant_and_an_action_adds_torque() -> None:
    pytest.importorskip("gymnasium")
    from armgpi.envs import ArmEnv

    def loaded(rng: np.random.Generator) -> RigidBodyPlant:
        return RigidBodyPlant(ARM.with_payload("tool", mass=float(rng.uniform(0.0, 0.2))))

    env = ArmEnv(loaded, GPI(ARM, 1e-3), lambda _: MOVE, 0.25, authority=0.5)
    masses = {env.reset(seed=seed) and str(env.loop.describe()["plant"]) for seed in (1, 2, 1)}
    assert len(masses) == 2
    _, _, _, _, info = env.step(np.ones(3))
    np.testing.assert_allclose(info["tau"] - info["own"], 0.5 * ARM.limits.effort)
    with pytest.raises(ParameterError, match="authority"):
        ArmEnv(loaded, GPI(ARM, 1e-3), MOVE, 0.25, authority=2.0)


# Logs.


def test_an_mcap_is_read_again_as_a_reference(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    path = logs.write(RUN, tmp_path / "run.mcap")
    again = Recorded.load(path, ARM, variable="/reference")
    np.testing.assert_array_equal(again.q, RUN["q_ref"].values)
    np.testing.assert_allclose(again.times, RUN["time"].values, atol=1e-9)
    assert Recorded.load(path, ARM).q.shape == again.q.shape
    with pytest.raises(UnreadableTrajectory, match="no message on the topic '/nothing'"):
        Recorded.load(path, ARM, variable="/nothing")
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(UnreadableTrajectory, match="cannot be read"):
        Recorded.load(path, ARM)


def test_joint_states_of_ros_2_are_a_reference(tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros2")
    from mcap_ros2.writer import Writer

    definition = (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
        + "=" * 80
        + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    path = tmp_path / "bag.mcap"
    positions = RUN["q_ref"].values[::10]
    with path.open("wb") as file:
        writer: Any = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", definition)
        for k, row in enumerate(positions):
            stamp = {"sec": 0, "nanosec": 10_000_000 * k}
            # ROS says joints in any order, and others too.
            state = {
                "header": {"stamp": stamp, "frame_id": ""},
                "name": ["finger", *reversed(ARM.joint_names)],
                "position": [0.0, *row[::-1]],
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joint_states", schema, state, log_time=10_000_000 * k + 7)
        writer.finish()
    found = Recorded.load(path, ARM)
    np.testing.assert_array_equal(found.q, positions)
    np.testing.assert_allclose(np.diff(found.times), 0.01)


def test_several_rollouts_have_topics_of_their_own(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    from mcap.reader import make_reader

    both = experiment.join({"gpi": RUN, "pid": RUN})
    with logs.write(both, tmp_path / "both.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    topics = {channel.topic for _, channel, _ in messages}
    assert topics == {
        f"/{label}/{kind}" for label in ("gpi", "pid") for kind in ("joint_states", "reference", "measured")
    }
    last = json.loads(messages[-1][2].data)
    assert last["name"] == list(ARM.joint_names)
    assert messages[-1][2].log_time == 250_000_000


def test_a_recording_for_rerun_has_every_joint(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    content = logs.write(RUN, tmp_path / "run.rrd").read_bytes()
    assert content.startswith(b"RRF")
    for joint in ARM.joint_names:
        assert f"/joint_states/position/{joint}".encode() in content
    with pytest.raises(ParameterError, match=r"ends in \.mcap or \.rrd"):
        logs.write(RUN, tmp_path / "run.bag")


# MuJoCo's models.


def test_an_mjcf_is_the_arm_that_mujoco_simulates(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "two.xml"
    path.write_text(TWO.format(more=""))
    robot = Robot.load(path)
    assert robot.joint_names == ("j1", "j2")
    np.testing.assert_array_equal(robot.limits.effort, [30.0, 20.0])
    np.testing.assert_array_equal(robot.armature, [0.05, 0.02])
    free = tmp_path / "free.xml"
    free.write_text(re.sub('<motor joint="j2"[^>]*/>', "", TWO.format(more="")))
    assert Robot.load(free).limits.effort[1] > 1e100  # no motor, no limit that is known
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, a = rng.uniform(-1.0, 1.0, (2, 2))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, 0.0, a
        mujoco.mj_inverse(model, data)
        # Dry friction is a constraint in MuJoCo, and in armgpi a part of the plant.
        expected = data.qfrc_inverse + data.qfrc_constraint
        np.testing.assert_allclose(robot.inverse_dynamics(q, np.zeros(2), a), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '<equality><joint joint1="j1" joint2="j2" polycoef="0 1 2 0 0"/></equality>',
            "no ratio between two",
        ),
        ('<equality><connect body1="lower" body2="base" anchor="0 0 0"/></equality>', "a loop: <connect>"),
        (
            '<tendon><fixed stiffness="2"><joint joint="j1" coef="1"/></fixed></tendon>',
            "which pulls by itself",
        ),
        ('<default><joint stiffness="3"/></default>', "a spring, which acts on 'j1'"),
        ("<nonsense/>", "MuJoCo cannot read it"),
    ],
)
def test_an_mjcf_with_more_than_an_arm_is_refused(tmp_path: Path, more: str, said: str) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "two.xml"
    path.write_text(TWO.format(more=more))
    with pytest.raises(UrdfError, match=said):
        Robot.load(path)


# Notebooks, and packages that are not there.


def test_pages_and_figures_show_in_notebooks() -> None:
    from armgpi.viewing import report

    assert report.build(RUN, ARM)._repr_html_().startswith("<iframe srcdoc=")  # type: ignore[attr-defined]
    assert plots.errors(RUN)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("package", "installed", "use"),
    [
        ("mcap.writer", "mcap", lambda folder: logs.write(RUN, folder / "run.mcap")),
        ("rerun", "rerun-sdk", lambda folder: logs.write(RUN, folder / "run.rrd")),
        ("mujoco", "mujoco", lambda folder: Robot.from_mjcf(folder / "two.xml")),
        ("mcap.stream_reader", "mcap", lambda folder: Recorded.load(folder / "run.mcap", ARM)),
    ],
)
def test_a_missing_package_says_what_brings_it(
    package: str, installed: str, use: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run.mcap").write_bytes(b"x")
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MissingPackage, match=f"pip install {installed}"):
        use(tmp_path)
