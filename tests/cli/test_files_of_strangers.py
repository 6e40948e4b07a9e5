"""Files as a stranger might send them: one line, exit code 2, in bounded time and memory, for every kind."""

from __future__ import annotations

import importlib.util
import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest

import armgpi
from armgpi.loop import log, logs

pytestmark = pytest.mark.slow

#: What a command may take more than with a good file: processor time [s], memory [bytes].
TIME, MEMORY = 5.0, 200 * 2**20
ARM = "anthropomorphic3"
JOINTS = ("q1", "q2", "q3")


class Ended(NamedTuple):
    """How a command ended, and what it took."""

    code: int
    said: str
    time: float
    memory: int


def run(folder: Path, *words: str) -> Ended:
    """Run a command in a folder, no longer than a minute."""
    with (folder / "said").open("w+") as said:
        begun = subprocess.Popen(
            [
                "timeout",
                "-s",
                "KILL",
                "60",
                sys.executable,
                *([] if words[0] == "-c" else ["-m", "armgpi"]),
                *words,
            ],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=said,
        )
        _, status, used = os.wait4(begun.pid, 0)
        begun.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        memory = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        return Ended(begun.returncode, said.read(), used.ru_utime + used.ru_stime, memory)


@cache
def rollout() -> Any:
    """Return a short run."""
    robot = armgpi.Robot.load(ARM)
    plant, law = armgpi.RigidBodyPlant(robot), armgpi.GPI(robot, dt=1e-3)
    q0 = np.array([0.0, 0.3, -0.3])
    return armgpi.simulate(plant, law, armgpi.Bezier(q0, q0 + 0.1, duration=0.2), t_final=0.3)


@cache
def certificate() -> Any:
    robot = armgpi.Robot.load(ARM).with_armature(0.1)
    return armgpi.certify(robot, payload=(0.0, 0.1), speed=0.2, start="held", torque=0.001)


def save_rollout(path: Path) -> None:
    armgpi.save(rollout(), path)


def save_table(path: Path) -> None:
    rows = np.column_stack([rollout()["time"].values, rollout()["q"].values])[::10]
    np.savetxt(path, rows, delimiter=",", header=",".join(["time", *JOINTS]), comments="")


def save_log(path: Path) -> None:
    head = ["time", *(f"q_{name}" for name in JOINTS), *(f"tau_{name}" for name in JOINTS)]
    rows = np.column_stack([rollout()[name].values for name in ("time", "q", "tau")])
    np.savetxt(path, rows, delimiter=",", header=",".join(head), comments="")


def save_armlog(path: Path) -> None:
    inputs = {"q_measured": rollout()["q"].values, "q_ref": rollout()["q_ref"].values}
    log.write(log.of_samples(JOINTS, 1e-3, inputs, rollout()["tau"].values), path)


def save_urdf(path: Path) -> None:
    path.write_bytes(armgpi.robots.locate(ARM)[0].read_bytes())


def save_mjcf(path: Path) -> None:
    path.write_text(
        """<mujoco><worldbody><body><joint name="q1" axis="0 1 0"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.4 0 0"/></body></worldbody></mujoco>"""
    )


def save_xacro(path: Path) -> None:
    arm = armgpi.robots.locate(ARM)[0].read_text(encoding="utf-8")
    path.write_text(arm.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1))


def save_weights(path: Path) -> None:
    weights = armgpi.Weights(omega_c=[1.0, 2.0, 3.0, 4.0])
    armgpi.save_weights(weights, path, armgpi.Robot.load(ARM))


def text(content: str) -> Callable[[Path], object]:
    """Return what writes a text."""
    return lambda path: path.write_text(content)


MODEL = "import numpy as np\ndef mass_matrix(q):\n    return np.eye(3)\n"
EXPERIMENT = f"robot: {ARM}\nt_final: 0.1\n"
VARIED = f"robot: {ARM}\nt_final: 0.1\nvary: {{controller.omega: {{uniform: [20.0, 30.0]}}}}\n"
#: What a program of the user's calls ends like a command, where no command reads such files.
CALL = """import sys, armgpi
try:
    {}
except armgpi.errors.ArmgpiError as error:
    sys.exit((print(error, file=sys.stderr), 2)[1])
"""
POSES = "time,x,y,z,qx,qy,qz,qw\n0.0,0.3,0.0,0.2,0.0,0.0,0.0,1.0\n0.1,0.3,0.1,0.2,0.0,0.0,0.0,1.0\n"
FOLLOW = ("run", "-c", "follow.yaml")
#: Kind -> name of the file, what makes a good one, the command that reads it.
KINDS: dict[str, tuple[str, Callable[[Path], object], tuple[str, ...]]] = {
    "URDF": ("arm.urdf", save_urdf, ("inspect", "arm.urdf")),
    "experiment": ("e.yaml", text(EXPERIMENT), ("run", "-c", "e.yaml")),
    "trajectory": ("t.csv", save_table, FOLLOW),
    "trajectory in NetCDF": ("t.nc", save_rollout, FOLLOW),
    "trajectory in MCAP": ("t.mcap", lambda path: logs.write(rollout(), path), FOLLOW),
    "rollout": ("r.nc", save_rollout, ("report", "r.nc", "-o", "out.mcap")),
    "log of an arm": ("l.armlog", save_armlog, ("log", "l.armlog")),
    "log to identify from": ("l.csv", save_log, ("identify", "l.csv", "--robot", ARM, "--out", "made")),
    "drives": ("d.yaml", text("q1: {rotor_inertia: 0.1}\n"), ("run", ARM, "--drives", "d.yaml")),
    "certificate": (
        "c.json",
        lambda path: certificate().save(path),
        ("certify", ARM, "--refute", "c.json"),
    ),
    "task": ("b.yaml", text("around: 0.0\nby: 0.1\n"), ("certify", ARM, "--box", "b.yaml")),
    "MJCF": ("m.xml", save_mjcf, ("inspect", "m.xml")),
    "xacro": ("x.xacro", save_xacro, ("expand", "x.xacro")),
    "identification": ("i.json", text("{}"), ("certify", ARM, "--identified", "i.json")),
    "study": (
        "swept/study.json",
        lambda path: path.with_name("kept").touch(),
        ("sweep", "vary.yaml", "--rollouts", "2", "--out", "swept"),
    ),
    "poses": ("p.csv", text(POSES), ("-c", CALL.format("armgpi.load_poses('p.csv')"))),
    "weights": (
        "w.nc",
        save_weights,
        ("-c", CALL.format(f"armgpi.load_weights('w.nc', armgpi.Robot.load({ARM!r}))")),
    ),
    "model": ("m.py", text(MODEL), ("validate", "m.py", "--robot", ARM)),
}


def prepare(folder: Path, kind: str) -> tuple[Path, tuple[str, ...]]:
    """Write what stands beside a file of a kind, and return its path and command."""
    name, _, words = KINDS[kind]
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / "vary.yaml").write_text(VARIED)
    (folder / "follow.yaml").write_text(f"robot: {ARM}\nreference: {{file: {name}}}\nt_final: 0.1\n")
    return folder / name, words


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ended]:
    """Return what tells how a command does with a good file."""

    @cache
    def found(kind: str) -> Ended:
        folder = tmp_path_factory.mktemp("good")
        path, words = prepare(folder, kind)
        KINDS[kind][1](path)
        return run(folder, *words)

    return found


def check_refused(ended: Ended, usual: Ended) -> None:
    """Check that a command ended in one line and exit code 2, and took little."""
    assert ended.code == 2, ended.said
    assert len(ended.said.strip().splitlines()) == 1, ended.said
    assert "Traceback" not in ended.said
    assert ended.time <= usual.time + TIME
    assert ended.memory <= usual.memory + MEMORY


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_sparse(path: Path) -> None:
    """Make a file that says to have 32 GiB."""
    with path.open("wb") as file:
        file.write(b"\x89HDF\r\n\x1a\n" if path.suffix == ".nc" else b"ARMLOG")
        file.truncate(32 * 2**30)


ODD: dict[str, Callable[[Path], object]] = {
    "pipe": make_pipe,
    "device": make_device,
    "sparse": make_sparse,
    "folder": Path.mkdir,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("odd", ODD)
def test_what_is_no_regular_file_is_refused_at_once(
    kind: str, odd: str, tmp_path: Path, good: Callable[[str], Ended]
) -> None:
    path, words = prepare(tmp_path, kind)
    ODD[odd](path)
    check_refused(run(tmp_path, *words), good(kind))


def altered(change: Callable[[Any], None]) -> Callable[[Path], object]:
    """Return what writes a rollout and changes it."""

    def make(path: Path) -> None:
        save_rollout(path)
        path.with_name("secret").write_bytes(b"TOP-SECRET-KEY-000007-" * 5000)
        with h5py.File(path, "r+") as file:
            change(file)

    return make


def replace(file: Any, name: str, make: Callable[[Any], Any]) -> None:
    """Put another variable in the place of one, with its dimensions where it is in the file."""
    old = file[name]
    scales = [[scale.name for scale in old.dims[i].values()] for i in range(old.ndim)]
    del file[name]
    made = make(old)
    for i, names in enumerate(scales):
        for scale in names:
            made.dims[i].attach_scale(file[scale])


def store_outside(file: Any) -> None:
    outside = [(os.path.join(os.path.dirname(file.filename), "secret"), 0, h5py.h5f.UNLIMITED)]
    replace(file, "tau", lambda old: file.create_dataset("tau", old.shape, "f8", external=outside))


def make_virtual(file: Any) -> None:
    other = os.path.join(os.path.dirname(file.filename), "other.h5")
    shape = file["tau"].shape
    with h5py.File(other, "w") as source:
        source["x"] = np.full(shape, 7.0)
    layout = h5py.VirtualLayout(shape, "f8")
    layout[:] = h5py.VirtualSource(other, "x", shape)
    replace(file, "tau", lambda _: file.create_virtual_dataset("tau", layout))


def link_outside(file: Any) -> None:
    other = os.path.join(os.path.dirname(file.filename), "other.h5")
    with h5py.File(other, "w") as source:
        source["x"] = np.full(file["tau"].shape, 7.0)
    del file["tau"]
    file["tau"] = h5py.ExternalLink(other, "/x")


def link_to_pipe(file: Any) -> None:
    pipe = os.path.join(os.path.dirname(file.filename), "pipe.h5")
    os.mkfifo(pipe)
    del file["tau"]
    file["tau"] = h5py.ExternalLink(pipe, "/x")


def link_softly(file: Any) -> None:
    del file["tau"]
    file["tau"] = h5py.SoftLink("/q")


def declare(file: Any) -> None:
    """Declare samples that are stored nowhere."""
    for name in ("q", "q_ref", "tau"):
        del file[name]
        file.create_dataset(
            name, (300_000_000, 3), "f8", chunks=(2**16, 3), compression="gzip", fillvalue=0.0
        )


def compress(file: Any) -> None:
    """Store zeros, which deflate makes a thousand times smaller."""
    del file["tau"]
    file.create_dataset("tau", data=np.zeros((12_000_000, 3)), chunks=(2**16, 3), compression="gzip")


def chunk(file: Any) -> None:
    """Have chunks that are larger than the file: one number asks for all of one."""
    replace(
        file,
        "tau",
        lambda old: file.create_dataset(
            "tau", old.shape, "f8", maxshape=(None, 3), chunks=(2**27, 3), compression="gzip"
        ),
    )


def refer(file: Any) -> None:
    file.create_dataset("more", data=np.array([file["q"].ref] * 3, h5py.ref_dtype), dtype=h5py.ref_dtype)


def filter_oddly(file: Any) -> None:
    replace(file, "tau", lambda old: file.create_dataset("tau", data=np.zeros(old.shape), compression="lzf"))


def repeat_text(file: Any) -> None:
    """Have many texts that are one: a long one, of which the file has a single copy."""
    file.create_dataset("more", (9_000,), h5py.string_dtype())
    file["more"][0] = "x" * 50_000
    place = file["more"].id
    name = file.filename
    offset = place.get_offset()
    file.close()
    with open(name, "r+b") as stream:
        stream.seek(offset)
        first = stream.read(16)
        stream.seek(offset)
        stream.write(first * 9_000)


HDF5 = {
    "stored outside": (store_outside, "outside the file"),
    "virtual": (make_virtual, "virtual"),
    "link to a file": (link_outside, "link"),
    "link to a pipe": (link_to_pipe, "link"),
    "soft link": (link_softly, "link"),
    "stored nowhere": (declare, "memory"),
    "zeros compressed": (compress, "memory"),
    "chunks": (chunk, "chunks"),
    "references": (refer, "neither numbers nor texts"),
    "another filter": (filter_oddly, "filter"),
    "a text again and again": (repeat_text, "texts"),
}


@pytest.mark.parametrize("name", HDF5)
@pytest.mark.parametrize("kind", ["rollout", "trajectory in NetCDF", "log to identify from"])
def test_a_netcdf_file_holds_its_own_numbers_and_not_more_than_it_can(
    kind: str, name: str, tmp_path: Path, good: Callable[[str], Ended]
) -> None:
    change, said = HDF5[name]
    path, words = prepare(tmp_path, kind)
    if kind == "log to identify from":
        path, words = tmp_path / "l.nc", ("identify", "l.nc", "--robot", ARM)
    altered(change)(path)
    ended = run(tmp_path, *words)
    check_refused(ended, good(kind))
    assert said in ended.said


def test_zeros_that_fit_into_memory_are_read(tmp_path: Path) -> None:
    path = tmp_path / "r.nc"
    armgpi.save(rollout().assign(tau=rollout()["tau"] * 0.0), path)
    assert not armgpi.load(path)["tau"].any()


def one_line(path: Path) -> None:
    path.write_bytes(b"time," + b"q," * 20_000_000)


def wide_rows(path: Path) -> None:
    path.write_bytes(b"time,q1,q2,q3\n" + b"1," * 20_000_000)


def mcap_chunk(path: Path, compression: str, data: bytes, size: int) -> None:
    """Write an MCAP file with one chunk."""
    body = struct.pack("<QQQI", 0, 1, size, 0) + struct.pack("<I", len(compression)) + compression.encode()
    body += struct.pack("<Q", len(data)) + data
    header = struct.pack("<I", 0) + struct.pack("<I", 0)
    magic = b"\x89MCAP0\r\n"
    records = ((1, header), (6, body), (15, bytes(4)), (2, bytes(20)))
    path.write_bytes(magic + b"".join(struct.pack("<BQ", code, len(x)) + x for code, x in records) + magic)


def zstd_bomb(path: Path) -> None:
    zstandard = pytest.importorskip("zstandard")
    mcap_chunk(path, "zstd", zstandard.compress(bytes(2**30)), 2**30)


def lz4_bomb(path: Path) -> None:
    lz4 = pytest.importorskip("lz4.frame")
    mcap_chunk(path, "lz4", lz4.compress(bytes(2**30)), 1000)


def aliases(path: Path) -> None:
    """Write lists of lists of lists of the same."""
    lines = ["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    path.write_text("\n".join(lines))


OTHERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "a line without end": ("trajectory", one_line),
    "a row without end": ("trajectory", wide_rows),
    "a log's line without end": ("log to identify from", one_line),
    "a log's row without end": ("log to identify from", wide_rows),
    "zstd": ("trajectory in MCAP", zstd_bomb),
    "lz4": ("trajectory in MCAP", lz4_bomb),
    "aliases in an experiment": ("experiment", aliases),
    "aliases in drives": ("drives", aliases),
    "aliases in a task": ("task", aliases),
    "many keys": ("experiment", text("[" + "[]," * 300_000 + "]")),
    "many keys in drives": ("drives", text("[" + "[]," * 300_000 + "]")),
    "nested": ("experiment", text("[" * 100_000)),
    "nested in a task": ("task", text("[" * 100_000)),
    "nested JSON": ("certificate", text("[" * 100_000)),
    "a header without end": (
        "log of an arm",
        lambda path: path.write_bytes(log.MAGIC + b"\xff" * 100),
    ),
    "entities": ("URDF", text('<!DOCTYPE r [<!ENTITY a "' + "a" * 1000 + '">]><robot name="&a;"/>')),
    "a link for every byte": ("URDF", text("<robot name='r'>" + "<a/>" * 2_000_000 + "</robot>")),
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_grows_when_it_is_read_is_refused(
    name: str, tmp_path: Path, good: Callable[[str], Ended]
) -> None:
    kind, make = OTHERS[name]
    path, words = prepare(tmp_path, kind)
    make(path)
    check_refused(run(tmp_path, *words), good(kind))


def test_a_set_of_files_names_none_outside_its_folder(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("")
    folder = tmp_path / "sent"
    folder.mkdir()
    save_rollout(folder / "rollout.nc")
    (folder / "SHA256SUMS").write_text(f"{'0' * 64}  ../secret\n")
    with pytest.raises(armgpi.errors.RolloutError, match="outside its folder"):
        armgpi.base.files.check_set(folder)


def test_good_files_are_read(good: Callable[[str], Ended]) -> None:
    codes = {kind: good(kind).code for kind in KINDS}
    # These end in a verdict, or need a package that is not always there.
    may_fail = {"log to identify from", "model", "certificate", "identification"}
    if importlib.util.find_spec("xacrodoc") is None:
        may_fail.add("xacro")
    assert {kind for kind, code in codes.items() if code} <= may_fail
    assert json.dumps(codes)
