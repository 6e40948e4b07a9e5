"""Films of rollouts: bodies are where Pinocchio has them, and files hold what was asked for."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from commands import Answer

import armgpi
from armgpi.errors import MissingPackage, ParameterError
from armgpi.viewing import film, meshes, scene

Image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def rollout() -> xr.Dataset:
    """Return a move of the paper's arm of half a second."""
    robot = armgpi.Robot.load("anthropomorphic3")
    move = armgpi.Bezier(np.zeros(3), np.array([0.8, 0.4, -0.4]), duration=0.4)
    return armgpi.simulate(armgpi.RigidBodyPlant(robot), armgpi.GPI(robot, 1e-3), move, 0.5)


def test_bodies_are_where_pinocchio_has_them() -> None:
    robot = armgpi.Robot.load("ur5") if "ur5" in armgpi.robots.names() else armgpi.Robot.load("scara")
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (4, robot.n))
    placements = film._placements(scene.build(robot), q)
    model = robot.pinocchio_model()
    data = model.createData()
    for frame, each in enumerate(q):
        pin.forwardKinematics(model, data, each)
        for index in range(1, model.njoints):
            np.testing.assert_allclose(placements[index, frame], data.oMi[index].homogeneous, atol=1e-12)


def test_the_camera_keeps_lengths_and_shows_up_as_up() -> None:
    axes = film._camera(0.7)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert axes[2, 0] == pytest.approx(0.0)
    assert axes[2, 1] > 0.9


@pytest.mark.parametrize("side", [(1.0, 0.0), (-1.0, 0.2), (0.1, -1.0), (0.0, 1.0)])
def test_a_tool_beside_a_body_is_before_it(side: tuple[float, float]) -> None:
    points = np.array([[0.3, 0.3, 0.0], [-0.3, 0.3, 1.0], [0.3, -0.3, 1.0], [-0.3, -0.3, 0.0]])
    body = meshes.Triangles(points, np.zeros((4, 3)), np.zeros((4, 3)), np.array([[0, 1, 2], [1, 2, 3]]))
    still = np.tile(np.eye(4), (1, 3, 1, 1))
    path = np.array([[*side, 0.8], [*side, 0.9]])
    toward = film._camera(film._azimuth([body], still, path))[:, 2]
    assert path[0] @ toward > np.array([0.0, 0.0, 0.5]) @ toward


def test_a_gif_has_the_frames_and_the_length_of_the_run(rollout: xr.Dataset, tmp_path: Path) -> None:
    path = film.write(rollout, tmp_path / "run.gif")
    with Image.open(path) as picture:
        assert picture.n_frames == round(0.5 * film.FRAME_RATE) + 1
        assert picture.info["duration"] == 40  # ms, at 25 frames per second
        first = np.asarray(picture.convert("RGB")).astype(int)
        picture.seek(picture.n_frames - 1)
        last = np.asarray(picture.convert("RGB")).astype(int)
    assert (np.abs(first - last).sum(axis=-1) > 60).mean() > 0.01  # the arm moved


def test_python_writes_the_same_file(rollout: xr.Dataset, tmp_path: Path) -> None:
    armgpi.view(rollout, tmp_path / "one.gif")
    film.write(rollout, tmp_path / "two.gif")
    assert (tmp_path / "one.gif").read_bytes() == (tmp_path / "two.gif").read_bytes()
    robot = armgpi.Robot.load("anthropomorphic3")
    with pytest.raises(ParameterError, match="a film is of a rollout"):
        armgpi.view(robot, tmp_path / "arm.gif")
    with pytest.raises(ParameterError, match=r"ends in \.gif or \.mp4"):
        film.write(rollout, tmp_path / "run.avi")


def test_an_mp4_without_ffmpeg_names_the_package(
    rollout: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackage, match="an MP4 needs ffmpeg: pip install imageio-ffmpeg, or write"):
        film.write(rollout, tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())


def test_an_mp4_is_written_where_there_is_ffmpeg(rollout: xr.Dataset, tmp_path: Path) -> None:
    try:
        film._ffmpeg()
    except MissingPackage:
        pytest.skip("there is no ffmpeg")
    assert film.write(rollout, tmp_path / "run.mp4").read_bytes()[4:8] == b"ftyp"


def test_the_command_writes_films_of_rollouts_alone(
    rollout: xr.Dataset, tmp_path: Path, cli: Callable[..., Answer]
) -> None:
    armgpi.save(rollout, tmp_path / "rollout.nc")
    answer = cli("view", tmp_path / "rollout.nc", "--out", tmp_path / "run.gif")
    assert answer.code == 0, answer.err
    assert (tmp_path / "run.gif").read_bytes().startswith(b"GIF89a")
    answer = cli("view", "anthropomorphic3", "--out", tmp_path / "arm.gif")
    assert answer.code == 2
    assert "a film is of a rollout" in answer.err


@pytest.mark.parametrize("duration", [0.5, 24.0, 37.3, 100.0])
def test_a_gif_lasts_as_long_as_its_run(duration: float, tmp_path: Path) -> None:
    rate = film._rate(duration, animated=True)
    assert rate <= film.FRAME_RATE
    assert duration * rate <= film.MOST_FRAMES
    noise = np.random.default_rng(0).integers(0, 256, (8, 8, 3), np.uint8)
    dots = (np.roll(noise, number, axis=0) for number in range(4))  # Pillow joins equal frames
    path = tmp_path / "film.gif"
    path.write_bytes(film._write_gif(dots, rate))
    with Image.open(path) as picture:  # whole hundredths of a second, as the file has them
        assert picture.info["duration"] == pytest.approx(1e3 / rate, rel=1e-12)
