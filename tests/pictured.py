"""Robots and rollouts for tests of pictures: small, quick, and of every kind that a picture may meet."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh
import xarray as xr

import armgpi
from armgpi import GPI, Bezier, FixedGains, RigidBodyPlant, Robot, Saturated, Step, simulate
from armgpi.config import experiment

HOSTILE = ("<script>alert(1)</script>", "</script><img src=x onerror=alert(1)>", "$\\frac{a}{$ _^", "_hidden")


def chain(
    n: int, reach: float = 1.0, joints: list[str] | None = None, links: list[str] | None = None
) -> Robot:
    """A chain of n joints about changing axes, its second one prismatic where there are more than two."""
    return Robot.from_xml(chain_urdf(n, reach, joints, links))


def chain_urdf(
    n: int, reach: float = 1.0, joints: list[str] | None = None, links: list[str] | None = None
) -> str:
    """The URDF of :func:`chain`; no visuals."""
    joints = joints or [f"joint{i}" for i in range(n)]
    links = links or [f"link{i}" for i in range(n + 1)]
    part = reach / n
    text = ['<robot name="chain">']
    text += [
        f"<link name={quoteattr(name)}><inertial><mass value='1'/>"
        "<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        for name in links
    ]
    for i, name in enumerate(joints):
        kind = "prismatic" if i == 1 and n > 2 else "revolute"
        axis = ("0 1 0", "1 0 0", "0 0 1")[i % 3]
        text.append(
            f"<joint name={quoteattr(name)} type='{kind}'><parent link={quoteattr(links[i])}/>"
            f"<child link={quoteattr(links[i + 1])}/><origin xyz='0.01 0 {part}' rpy='0.1 0.2 0.3'/>"
            f"<axis xyz='{axis}'/><limit lower='-2' upper='2' effort='50' velocity='5'/></joint>"
        )
    return "".join(text) + "</robot>"


def run(
    robot: Robot, move: float = 0.3, t_final: float = 0.3, omega: float = 20.0, onset: float = 0.1
) -> xr.Dataset:
    """A rollout of a few hundred samples with a disturbance that sets in."""
    plant = Saturated(RigidBodyPlant(robot, [Step(np.full(robot.n, 0.05), onset=onset)]))
    reference = Bezier(start=robot.middle(), goal=robot.middle() + move, duration=0.6 * t_final)
    return simulate(plant, GPI(robot, dt=1e-3, gains=FixedGains(omega)), reference, t_final=t_final)


def made_up(robot: Robot, samples: int = 200) -> xr.Dataset:
    """A rollout like those of :func:`run`, but of numbers out of the air: for robots of any size, at once."""
    base = run(armgpi.Robot.load("anthropomorphic3"), t_final=0.05)
    rng = np.random.default_rng(0)
    time = np.arange(samples) * 1e-2
    names = np.array(robot.joint_names)
    values = {
        name: (("time", "joint"), np.cumsum(rng.normal(size=(samples, robot.n)), axis=0) * 0.05, v.attrs)
        for name, v in base.data_vars.items()
        if v.dims == ("time", "joint")
    }
    limits = {name: ("joint", limit) for name, limit in robot.limits._asdict().items()}
    coords = {"time": time, "joint": names, "joint_type": ("joint", np.array(robot.joint_types))}
    more = {"status": base["status"], "t_end": base["t_end"].copy(data=float(time[-1]))}
    return xr.Dataset({**values, **limits, **more}, coords=coords, attrs=dict(base.attrs, robot=robot.name))


def compared(**runs: xr.Dataset) -> xr.Dataset:
    """Rollouts in one dataset, by label."""
    return experiment.join(runs)


def package(folder: Path, **meshes: bytes | str) -> Path:
    """A robot's package in `folder`: a URDF whose links draw the meshes, one each, and the meshes."""
    (folder / "pkg" / "meshes").mkdir(parents=True)
    (folder / "pkg" / "urdf").mkdir()
    names = []
    for name, content in meshes.items():
        stem, _, kind = name.rpartition("_")
        file = f"{stem}.{kind}"
        names.append(file)
        (folder / "pkg" / "meshes" / file).write_bytes(
            content if isinstance(content, bytes) else content.encode()
        )
    links = [Path(name).stem for name in names]
    links = [*links, "end"] if len(links) == 1 else links
    text = chain_urdf(len(links) - 1, joints=[f"to {link}" for link in links[1:]], links=links)
    for name in names:
        link = f"<link name={quoteattr(Path(name).stem)}>"
        mesh = f"<visual><geometry><mesh filename='package://pkg/meshes/{name}'/></geometry></visual>"
        text = text.replace(link, link + mesh)
    urdf = folder / "pkg" / "urdf" / "arm.urdf"
    urdf.write_text(text, encoding="utf-8")
    return urdf


def box_mesh(kind: str) -> bytes:
    """A box of 0.1 x 0.2 x 0.3 m as a file."""
    content = trimesh.creation.box(extents=(0.1, 0.2, 0.3)).export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()
