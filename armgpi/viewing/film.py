"""A rollout as a film: an animated GIF or an MP4, drawn by Matplotlib without a screen.

The arm is drawn from one side, its triangles from the farthest to the nearest, with the path of its tool and
the path that was desired. Several rollouts are side by side. The film runs in real time.
"""

from __future__ import annotations

import io
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.errors import MissingPackage, ParameterError, RolloutError, import_extra
from armgpi.robot.robot import Robot
from armgpi.viewing import meshes, plots, scene, style, tracks

if TYPE_CHECKING:
    import xarray as xr

#: Endings of films.
FORMATS = (".gif", ".mp4")
#: Frames per second [1/s] and most frames of a film; a longer run has fewer frames per second.
FRAME_RATE, MOST_FRAMES = 25.0, 500
#: Triangles of a body of the arm; larger meshes are simplified.
TRIANGLES = 900
#: Direction from which the arm is seen, around the vertical axis [rad].
_AZIMUTH = 0.7
#: Directions that are tried where its tool would be behind what does not move.
_DIRECTIONS = 8
#: Fixed bodies are seen as a whole where they make the picture at most so many times as large [-].
_SURROUNDINGS = 1.5
#: Likewise, above the horizontal plane [rad].
_ELEVATION = 0.35
#: Direction of the light, as the camera sees it: right, up, towards it [-].
_LIGHT = np.array([0.3, 0.5, 0.81])
#: Width of the picture of one rollout [in].
_WIDTH = 3.2
#: Height of it [in].
_HEIGHT = 3.6
#: Pixels per inch.
_DPI = 120
#: Frames of which the corners of the picture are taken.
_LOOKED_AT = 20
#: Share of a colour that a triangle has when light falls along it.
_SHADE = 0.45
#: Colour of bodies whose file contains none.
_GREY = (0.72, 0.74, 0.76)
#: Points of a path.
_PATH_POINTS = 400
#: Seconds that ffmpeg may take to finish a file.
_PATIENCE = 120.0
#: Units of the delays of a GIF in a second.
_CENTISECONDS = 100

_Image = npt.NDArray[np.uint8]
Progress = Callable[[str], None]


class _Drawn(NamedTuple):
    """One rollout as it is drawn.

    Attributes:
        label: its name.
        color: of its path.
        camera: columns to the right, up, and towards the camera, shape (3, 3).
        placements: of the bodies at the frames, homogeneous, shape (bodies, frames, 4, 4).
        path: of the tool on the picture [m], shape (k, 2).
        desired: path that the tool should have, likewise.
        tool: the tool on the picture at the frames [m], shape (frames, 2).
    """

    label: str
    color: str
    camera: Array
    placements: Array
    path: Array
    desired: Array
    tool: Array


def check_path(path: str | PathLike[str]) -> Path:
    """Return the path of a film after checks that it can be written.

    Raises:
        ParameterError: when its ending is none of :data:`FORMATS`.
        MissingPackage: when an MP4 is wanted and there is no ffmpeg.
    """
    target = Path(path)
    if target.suffix.lower() not in FORMATS:
        raise ParameterError("the film's file", str(path), f"one that ends in {' or '.join(FORMATS)}")
    if target.suffix.lower() == ".mp4":
        _ffmpeg()
    return target


def write(
    rollout: xr.Dataset,
    path: str | PathLike[str],
    robot: Robot | None = None,
    *,
    frame: str | None = None,
    progress: Progress = lambda _: None,
) -> Path:
    """Write the film of a rollout, or of several side by side.

    Args:
        rollout: the rollout(s).
        path: the file, which ends in .gif or .mp4.
        robot: the arm; the one that the rollout was made with when not given.
        frame: the tool; the tip when not given.
        progress: called with a text that says how far it is.

    Raises:
        ParameterError: when the file has another ending.
        MissingPackage: when trimesh is not installed; or ffmpeg, of an MP4.
        RolloutError: when the robot is not found any more, or the file cannot be written.
    """
    target = check_path(path)
    arm = scene.build(scene.robot_of(rollout) if robot is None else robot, frame)
    clip = scene.clip(rollout, arm.robot)
    duration = float(clip.times[-1] - clip.times[0])
    animated = target.suffix.lower() == ".gif"
    rate = _rate(duration, animated)
    count = max(2, round(duration * rate) + 1)
    wanted = np.linspace(clip.times[0], clip.times[-1], count)
    chosen = np.searchsorted(clip.times, wanted - 1e-9).clip(0, len(clip.times) - 1)
    images = _images(arm, clip, chosen, rollout, frame, progress)
    write_film = _write_gif if animated else _write_mp4
    return files.write(target, write_film(images, rate))


def _rate(duration: float, animated: bool) -> float:
    """Return the frames per second [1/s] of a film of a run that lasts so long [s].

    The delays of an animated GIF are whole hundredths of a second; Pillow cuts what is beyond them, and the
    film would be faster than the run.
    """
    rate = min(FRAME_RATE, MOST_FRAMES / max(duration, 1e-9))
    return _CENTISECONDS / math.ceil(_CENTISECONDS / rate - 1e-9) if animated else rate


# Frames --------------------------------------------------------------------------------------------------


def _images(
    arm: scene.Scene,
    clip: scene.Clip,
    chosen: npt.NDArray[np.int64],
    rollout: xr.Dataset,
    frame: str | None,
    progress: Progress,
) -> Iterator[_Image]:
    """Yield the frames as pictures, shape (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    parts = [meshes.simplify(body.coarse, TRIANGLES) for body in arm.bodies]
    every = _drawn(arm, parts, clip, chosen, rollout, frame)
    box = _bounds(parts, every)
    with plots.styled():
        figure = plots.Figure(figsize=(_WIDTH * len(every), _HEIGHT), dpi=_DPI)
        canvas: Any = FigureCanvasAgg(figure)
        drawers = [
            _drawer(figure.add_subplot(1, len(every), place + 1), parts, drawn, box)
            for place, drawn in enumerate(every)
        ]
        clock = figure.text(0.5, 0.02, "", ha="center", family="DejaVu Sans Mono")
        for number, index in enumerate(chosen):
            for draw in drawers:
                draw(number)
            clock.set_text(f"{clip.times[index]:6.2f} s")
            canvas.draw()
            progress(f"frame {number + 1} of {len(chosen)}")
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _drawn(
    arm: scene.Scene,
    parts: list[meshes.Triangles],
    clip: scene.Clip,
    chosen: npt.NDArray[np.int64],
    rollout: xr.Dataset,
    frame: str | None,
) -> list[_Drawn]:
    """Return the rollouts as they are drawn."""
    paths = tracks.tool_paths(rollout, arm.robot, frame, _PATH_POINTS)
    placements = [_placements(arm, actor.q[chosen].astype(float)) for actor in clip.actors]
    camera = _camera(_azimuth(parts, placements[0], paths[0].desired))
    found = []
    for actor, path, places in zip(clip.actors, paths, placements, strict=False):
        tool = places[arm.tip_body] @ arm.tip
        found.append(
            _Drawn(
                label=style.shorten(actor.label),
                color=actor.color,
                camera=camera,
                placements=places,
                path=(path.drawn @ camera)[:, :2],
                desired=(path.desired @ camera)[:, :2],
                tool=(tool[:, :3, 3] @ camera)[:, :2],
            )
        )
    return found


def _placements(arm: scene.Scene, q: Array) -> Array:
    """Return where the bodies of an arm are at configurations (frames, n): (bodies, frames, 4, 4)."""
    placements = np.empty((len(arm.bodies), len(q), 4, 4))
    for index, body in enumerate(arm.bodies):
        if body.parent < 0:
            placements[index] = body.placement
            continue
        moved = np.tile(np.eye(4), (len(q), 1, 1))
        if body.kind:
            x = body.ratio * q[:, body.coordinate] + body.offset
            if body.kind == "prismatic":
                moved[:, :3, 3] = x[:, np.newaxis] * body.axis
            else:
                moved[:, :3, :3] = _rotations(body.axis, x)
        placements[index] = placements[body.parent] @ body.placement @ moved
    return placements


def _rotations(axis: Array, angles: Array) -> Array:
    """Return the rotations about an axis of length 1 (Rodrigues' formula), shape (k, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine = np.sin(angles)[:, None, None]
    cosine = np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * cross @ cross)


def _camera(azimuth: float) -> Array:
    """Return the axes of a camera at an azimuth [rad] as columns: to the right, up, and towards it."""
    toward = np.array(
        [
            np.cos(_ELEVATION) * np.cos(azimuth),
            np.cos(_ELEVATION) * np.sin(azimuth),
            np.sin(_ELEVATION),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(toward, right), toward], axis=1)


def _is_fixed(placements: Array) -> bool:
    """Tell whether a body stays where it is over the frames (frames, 4, 4)."""
    return bool((placements == placements[:1]).all())


def _azimuth(parts: list[meshes.Triangles], placements: Array, path: Array) -> float:
    """Return where an arm is seen from [rad]: from a side at which the tool is before what does not move.

    Args:
        parts: the bodies.
        placements: of them at the frames, (bodies, frames, 4, 4).
        path: the desired one of the tool [m], (k, 3).
    """
    points = [
        part.points @ places[0, :3, :3].T + places[0, :3, 3]
        for part, places in zip(parts, placements, strict=True)
        if _is_fixed(places) and len(part.points)
    ]
    path = path[np.isfinite(path).all(axis=1)]
    if not points or not len(path):
        return _AZIMUTH
    fixed = np.concatenate(points)
    lever = path.mean(axis=0) - 0.5 * (fixed.min(axis=0) + fixed.max(axis=0))
    azimuths = _AZIMUTH + 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
    ahead = lever[0] * np.cos(azimuths) + lever[1] * np.sin(azimuths)
    return _AZIMUTH if ahead[0] >= 0.0 else float(azimuths[np.argmax(ahead)])


def _bounds(parts: list[meshes.Triangles], every: list[_Drawn]) -> tuple[Array, Array]:
    """Return the corners of what is seen of all rollouts over the film, with a margin [m].

    Of a larger robot, such as one with two arms, what does not move may be cut off.
    """
    moving: list[Array] = []
    fixed: list[Array] = []
    for drawn in every:
        paths = np.concatenate([drawn.path, drawn.desired])
        moving.append(paths[np.isfinite(paths).all(axis=1)])
        stride = max(1, drawn.placements.shape[1] // _LOOKED_AT)
        for index, part in enumerate(parts):
            placements = drawn.placements[index][::stride]
            rotations = placements[:, :3, :3]
            corners = part.points @ rotations.swapaxes(1, 2) + placements[:, np.newaxis, :3, 3]
            seen = (corners @ drawn.camera).reshape(-1, 3)[:, :2]
            (fixed if _is_fixed(placements) else moving).append(seen)
    everything = np.concatenate(moving + fixed)
    low, high = everything.min(axis=0), everything.max(axis=0)
    if fixed and len(alone := np.concatenate(moving)):
        own_low, own_high = alone.min(axis=0), alone.max(axis=0)
        size = (high - low).max()
        own_size = (own_high - own_low).max()
        if size > _SURROUNDINGS * own_size:
            low, high = own_low, own_high
    margin = 0.05 * float((high - low).max())
    return low - margin, high + margin


def _drawer(
    axes: Any, parts: list[meshes.Triangles], drawn: _Drawn, box: tuple[Array, Array]
) -> Callable[[int], None]:
    """Return a function that draws a frame of a rollout into axes."""
    from matplotlib.collections import PolyCollection

    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(box[0][0], box[1][0])
    axes.set_ylim(box[0][1], box[1][1])
    axes.set_title(drawn.label)
    shapes: Any = PolyCollection([], antialiased=True, linewidths=0.3)
    axes.add_collection(shapes)
    axes.plot(*drawn.desired.T, color=style.REFERENCE, linestyle=":", linewidth=0.8, zorder=3)
    axes.plot(*drawn.path.T, color=drawn.color, linewidth=1.0, alpha=0.8, zorder=3)
    (tool,) = axes.plot([], [], "o", color=drawn.color, markersize=3.5, zorder=4)

    def draw(number: int) -> None:
        corners, colors = [], []
        for index, part in enumerate(parts):
            triangles, paint = _shaded(part, drawn.placements[index, number], drawn.camera)
            corners.append(triangles)
            colors.append(paint)
        all_corners = np.concatenate(corners)
        all_colors = np.concatenate(colors).clip(0.0, 1.0)
        farthest_first = np.argsort(all_corners[:, :, 2].mean(axis=1))
        shapes.set_verts(all_corners[farthest_first, :, :2])
        shapes.set_facecolor(all_colors[farthest_first])
        shapes.set_edgecolor(all_colors[farthest_first])
        tool.set_data(drawn.tool[number, :1], drawn.tool[number, 1:])

    return draw


def _shaded(part: meshes.Triangles, placement: Array, camera: Array) -> tuple[Array, Array]:
    """Return the triangles of a part as the camera sees them, (k, 3, 3), and their colours, (k, 3).

    Args:
        part: in its own coordinates.
        placement: of it, homogeneous (4, 4).
        camera: its axes as columns, (3, 3).
    """
    points = (part.points @ placement[:3, :3].T + placement[:3, 3]) @ camera
    triangles = points[part.faces]
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    lit = np.abs(normals @ _LIGHT) / np.maximum(lengths, 1e-30)
    color = np.nan_to_num(part.colors[part.faces[:, 0]], nan=-1.0)
    color = np.where(color < 0.0, np.array(_GREY), color)
    return triangles, color * (_SHADE + (1.0 - _SHADE) * lit[:, np.newaxis])


# Files ---------------------------------------------------------------------------------------------------


def _write_gif(images: Iterator[_Image], rate: float) -> bytes:
    """Return pictures as an animated GIF that repeats."""
    from PIL import Image  # comes with Matplotlib

    pictures: list[Any] = []
    for image in images:
        picture = Image.fromarray(image)
        palette = pictures[0] if pictures else None
        pictures.append(picture.quantize(128) if palette is None else picture.quantize(palette=palette))
    content = io.BytesIO()
    pictures[0].save(
        content,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=10 * round(_CENTISECONDS / rate),
        loop=0,
    )
    return content.getvalue()


def _write_mp4(images: Iterator[_Image], rate: float) -> bytes:
    """Return pictures as an MP4 (H.264), by ffmpeg.

    Raises:
        RolloutError: when ffmpeg fails.
    """
    first = next(images)
    height, width = (2 * (size // 2) for size in first.shape[:2])  # H.264 takes even sizes alone
    with tempfile.TemporaryDirectory(prefix="armgpi-", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "film.mp4"
        command = [
            *(_ffmpeg(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"),
            *("-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"),
            *("-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target)),
        ]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdin is not None
            with suppress(BrokenPipeError):  # what ffmpeg says of it is read below
                for image in chain([first], images):
                    process.stdin.write(np.ascontiguousarray(image[:height, :width]).tobytes())
            _, said = process.communicate(timeout=_PATIENCE)
        if process.returncode or not target.is_file():
            text = " ".join(said.decode(errors="replace").strip().splitlines()[-1:])
            raise RolloutError(f"ffmpeg failed: {text or process.returncode}; write a .gif instead")
        return target.read_bytes()


def _ffmpeg() -> str:
    """Return the path of ffmpeg: the system's, or that of the package imageio-ffmpeg.

    Raises:
        MissingPackage: when there is none.
    """
    if found := shutil.which("ffmpeg"):
        return found
    try:
        return str(import_extra("imageio_ffmpeg", "viz", "imageio-ffmpeg").get_ffmpeg_exe())
    except MissingPackage as error:
        raise error.instead("an MP4 needs ffmpeg", "or write a .gif, which needs nothing more") from None
