"""Throw bad files and arguments at what reads them: every one ends well or in an error of ours, in time.

    python tools/fuzz.py yaml --count 2000 --seed 0
    python tools/fuzz.py rollout --count 2000
    python tools/fuzz.py arguments --count 300
    python tools/fuzz.py tune --count 1000

Files that are read back are damaged at random places: rollouts, weights, trajectories, logs, certificates,
tasks, what was identified, and what a study keeps (tune, contend, zoo, sweep, rare), whose commands then end
with exit code 2 and one line, or with what an unbroken study leaves.

A case may take 60 s of processor time, and all of them 2 GB of memory; the most that was taken is printed.

Run it in a tree that nobody changes meanwhile: commands import modules when they need them.

The URDF reader has a tool of its own, `tools/fuzz_urdf.py`. The same seed gives the same cases. A case that
fails is printed with its seed, which alone repeats it: `--seed SEED --count 1`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import resource
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from armgpi import (
    GPI,
    Hold,
    Recorded,
    RigidBodyPlant,
    Robot,
    config,
    load,
    load_weights,
    save,
    save_weights,
    simulate,
)
from armgpi.certification import check_certificate
from armgpi.certification.box import box_of, read_box
from armgpi.certification.certificate import Certificate, certify
from armgpi.cli import main as command
from armgpi.errors import ArmgpiError
from armgpi.gpi.weights import Weights
from armgpi.hardware.realtime import run
from armgpi.identification.arm import identify
from armgpi.identification.excitation import excite
from armgpi.identification.logs import Log, read_log
from armgpi.identification.posterior import read_posterior
from armgpi.identification.writing import write_identified
from armgpi.loop import log, logs
from armgpi.robot import identified, repairs, robots
from armgpi.robot.drives import Drives
from armgpi.studies import contend

#: A case: given random numbers and a folder.
Case = Callable[[np.random.Generator, Path], None]

ROOT = Path(__file__).parents[1]
ARM = "anthropomorphic3"
#: Processor time that a case may take [s]; an export compiles and replays. Memory of all of them [bytes].
PATIENCE, MEMORY = 60.0, 2 << 30

WORDS = (
    *("robot", "name", "plant", "controllers", "type", "gpi"),
    *("pid", "label", "reference", "goal", "t_final"),
    *(
        "<<:",
        "*a",
        "&a",
        "!!python/object:os.system",
        "!!binary",
        "~",
        "null",
        ".inf",
        ".nan",
        "-.inf",
        "1e400",
    ),
    *(
        "9" * 400,
        "0x" + "f" * 300,
        "1:2:3:4",
        "2020-13-45",
        '"\\ud800"',
        '"\\0"',
        "\x1b[31m",
        "\u202e",
        "{",
        "}",
    ),
    *(
        "[",
        "]",
        ":",
        "- ",
        "? ",
        "|",
        ">",
        "%YAML 1.1",
        "---",
        "...",
        "\t",
        "\n  ",
        "'",
        '"',
        "#",
        ",",
        "@",
        "`",
    ),
)
ARGUMENTS = (
    *("run", "compare", "inspect", "view", "report", "export", "derive", "validate", "scenarios", "robots"),
    *(
        ARM,
        "ur5",
        "none.urdf",
        "README.md",
        "examples/demo.yaml",
        "paper",
        "scenario-5.2",
        "",
        " ",
        "-",
        "--",
    ),
    *("--to", "--from", "--config", "--controller", "--lock", "--keep", "--effort", "--payload", "--dt"),
    *(
        "--omega",
        "--encoder-bits",
        "--delay",
        "--seed",
        "--backend",
        "--json",
        "--path",
        "--duration",
        "--robot",
    ),
    *(
        "q1=1",
        "q1=nan",
        "0.1,0.2,0.3",
        "1e400",
        "-1",
        "0",
        "nan",
        "inf",
        "1e-300",
        "q1",
        "=",
        ",",
        "q1=,",
        "gpi",
    ),
    *("gpi,pid", "laser", "numpy", "9" * 400, "\x1b[31m"),
    *("\u202ex", "\udcff", "a\nb", "--help", "--t-final"),
)


def yaml_case(rng: np.random.Generator, _: Path) -> None:
    """Read an experiment file that was changed at a few places."""
    texts = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("*.yaml"))]
    text = texts[rng.integers(len(texts))]
    for _ in range(rng.integers(1, 6)):
        at, length = rng.integers(len(text) + 1), int(rng.integers(0, 12))
        lines = text.splitlines(keepends=True)
        change = rng.integers(4)
        if change == 0:
            text = text[:at] + WORDS[rng.integers(len(WORDS))] + text[at + length :]
        elif change == 1:
            text = text[:at] + text[at + length :]
        elif change == 2 and lines:
            lines.insert(rng.integers(len(lines)), lines[rng.integers(len(lines))])
            text = "".join(lines)
        else:
            text = text.replace(": ", f": {WORDS[rng.integers(len(WORDS))]} ", int(rng.integers(1, 3)))
    loaded = config.parse(text, "fuzz.yaml")
    config.parse(config.dump(loaded.config), "dumped.yaml")


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a file that was damaged at a few places: bits, bytes, words, zeros, parts left out."""
    whole = bytearray(data)
    for _ in range(rng.integers(1, 6)):
        at, length = int(rng.integers(len(whole) + 1)), int(rng.integers(1, 40))
        change = rng.integers(6)
        if change == 0 and at < len(whole):
            whole[at] ^= 1 << int(rng.integers(8))
        elif change == 1:
            whole[at : at + 8] = rng.bytes(8)
        elif change == 2:
            whole[at : at + length] = WORDS[rng.integers(len(WORDS))].encode(errors="replace")
        elif change == 3:
            whole[at:] = bytes(len(whole) - at)
        elif change == 4:
            del whole[at : at + length]
        else:
            del whole[at:]
    return bytes(whole)


def arm() -> Robot:
    """Return the arm of the files."""
    return Robot.load(ARM).with_armature(0.1)


#: What takes the place of a word of a text, beside its other words.
_ODD_WORDS = (
    "-1",
    "0",
    "1e999",
    "nan",
    "inf",
    "1e-300",
    "99999999999999999999",
    "",
    "/dev/zero",
    "..",
    "é",
    "~",
)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a text a few words of which are others, or are not there."""
    words = re.split(r"([\w.+/-]+)", data.decode())
    for _ in range(rng.integers(1, 4)):
        at = 2 * int(rng.integers(len(words) // 2)) + 1
        other = words[2 * int(rng.integers(len(words) // 2)) + 1]
        words[at] = str(rng.choice([*_ODD_WORDS, other, other, other]))
    return "".join(words).encode()


def read_again(
    name: str,
    write: Callable[[Path], Any],
    read: Callable[[Path], Any],
    damage: Callable[[bytes, np.random.Generator], bytes] | None = None,
) -> Case:
    """Return the case of a file that a function reads."""

    def case(rng: np.random.Generator, folder: Path) -> None:
        good, bad = folder / f"good{name}", folder / f"bad{name}"
        if not good.exists():
            write(good)
        bad.write_bytes((damage or damaged)(good.read_bytes(), rng))
        read(bad)

    return case


def write_rollout(path: Path) -> None:
    """Write a short rollout."""
    plant, hold = RigidBodyPlant(Robot.load(ARM)), Hold([0.0, 0.1, 0.0])
    save(simulate(plant, GPI(plant.robot, 1e-3), hold, 0.02), path)


def write_armlog(path: Path) -> None:
    """Write the log of a short loop."""
    done = run(RigidBodyPlant(arm()), GPI(arm(), 1e-3), Hold([0.0, 0.1, 0.0]), 0.02, clock="simulated")
    log.write(done.log, path)  # type: ignore[arg-type]


def write_identification(path: Path) -> None:
    """Write what was identified from a short log, with the files that it names beside it."""
    t = np.arange(0.0, 6.0, 4e-3)
    motion, between = (excite(arm(), 6.0).reference.at(t + late) for late in (0.0, 2e-3))
    tau = arm().inverse_dynamics(between.q, between.v, between.a)
    write_identified(identify(Log(t, motion.q, tau), arm(), check_first=False), path.parent)
    path.write_bytes((path.parent / identified.NAME).read_bytes())


def read_identification(path: Path) -> None:
    """Read it, and draw an arm."""
    read_posterior(identified.read(path).path, arm()).sample(arm(), 1)


def write_table(path: Path, *columns: str) -> None:
    """Write a table with a time and three numbers for each of some columns."""
    names = [f"{column}{joint}" for column in columns for joint in arm().joint_names]
    rows = [",".join(["time", *names])]
    rows += [",".join(f"{x:g}" for x in (0.01 * k, *[1e-3 * k] * len(names))) for k in range(60)]
    path.write_text("\n".join(rows) + "\n")


def check_file(path: Path) -> None:
    """Check a certificate; what is none ends in one line."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = check_certificate.main([str(path)])
    if code == 2 and len(said.getvalue().splitlines()) != 1:
        raise AssertionError(said.getvalue())
    Certificate.load(path)


def called(*arguments: str) -> tuple[int, str]:
    """Return exit code and messages of a command."""
    out, err = io.StringIO(), io.StringIO()
    before = sys.argv
    sys.argv = ["armgpi", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            command()
        code: Any = 0
    except SystemExit as end:
        code = end.code or 0
    except BaseException as error:
        raise AssertionError(f"{type(error).__name__} of {arguments}") from error
    finally:
        sys.argv = before
    if code not in (0, 1, 2):
        raise AssertionError(f"exit code {code} of {arguments}")
    text = (out.getvalue() + err.getvalue()).replace("\n", "")
    raw = {c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    if raw or "Traceback" in text:
        raise AssertionError(f"{sorted(map(ascii, raw))} or a traceback is shown by {arguments}")
    return code, err.getvalue()


def arguments_case(rng: np.random.Generator, folder: Path) -> None:
    """Call the command line with words in any order."""
    chosen = [ARGUMENTS[rng.integers(len(ARGUMENTS))] for _ in range(rng.integers(0, 7))]
    arguments = [word for word in chosen if word not in ("validate", "view")]  # these start programs, or wait
    if chosen and chosen[0] in ("run", "compare", "export"):
        arguments += ["--t-final", "0.002", *(("-o", str(folder / "out")) if chosen[0] == "export" else ())]
    called(*arguments)


SWEEP = f"""
robot: {{name: {ARM}}}
controllers: [{{type: gpi, omega: 20}}]
reference: {{points: [[0, 0.3, 0], [0.1, 0.4, -0.1]], durations: 0.15, holds: [0.02, 0.1]}}
t_final: 0.25
vary: {{plant.payload.mass: {{uniform: [0.0, 0.3]}}, controller.inertia_scale: {{log_uniform: [0.8, 1.3]}}}}
failure: {{peak_error: 0.15}}
"""
TUNE = f"""
robot: {{name: {ARM}}}
controllers: [{{type: gpi, rolloff: 1}}]
reality: {{sample_time: [0.004], delay: [1, 1], effort_share: 0.0, duration: [0.15, 0.3], t_final: 0.6}}
tune: {{evaluations: 12, population: 4, scenarios: 1, held_out: 1}}
"""


def study_case(text: str, *arguments: str) -> Case:
    """Return the case of a study that is gone on with, one of whose files is damaged."""

    def case(rng: np.random.Generator, folder: Path) -> None:
        file, out = folder / f"{arguments[0]}.yaml", folder / f"{'-'.join(arguments)[:20]}"
        own = [part if part != "FILE" else str(file) for part in arguments]
        if not out.exists():
            file.write_text(text)
            contend.QUICK = contend.Setting(12, 1, 1, 1)
            code, said = called(*own, "--out", str(out))
            if code == 2:
                raise AssertionError(said)
        whole = {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
        kept = [path for path in whole if path.suffix == ".chunk" or path.name == "study.json"]
        place = kept[rng.integers(len(kept))]
        place.write_bytes(damaged(whole[place], rng))
        code, said = called(*own, "--out", str(out), *(["--resume"] if arguments[0] == "tune" else []))
        errors = [line for line in said.splitlines() if line.startswith("error: ")]
        others = [path for path in whole if path != place and path.read_bytes() != whole[path]]
        for path, content in whole.items():
            path.write_bytes(content)
        if others:
            raise AssertionError(f"{place.name} was damaged and taken for whole: {others}")
        if code == 2:
            if len(errors) != 1:
                raise AssertionError(said)
            raise ArmgpiError(errors[0])

    return case


MJCF = """<mujoco model="fuzzed"><compiler angle="radian" meshdir="meshes"/><include file="more.xml"/>
<default><joint damping="0.2" armature="0.02"/></default><size memory="8M"/>
<worldbody><body name="one" pos="0.1 0.2 0.3" euler="0.3 0.4 0.2"><joint name="a" axis="1 2 3" range="-1 2"/>
<inertial pos="0.01 0.02 0.1" mass="3" fullinertia="0.03 0.04 0.02 0.001 0.002 0.003"/>
<body name="two" pos="0 0.05 0.4"><joint name="b" type="slide" axis="0 0.6 0.8" ref="0.05" range="0 0.3"/>
<replicate count="2" offset="0 0 0.1"><geom type="box" size="0.05 0.02 0.04" mass="0.6"/></replicate>
</body></body></worldbody>
<actuator><position joint="a" kp="30" forcerange="-40 50"/></actuator></mujoco>
"""


def write_mjcf(path: Path) -> None:
    """Write a MuJoCo model with a file that it includes."""
    (path.parent / "more.xml").write_text("<mujoco><option gravity='0 0 -9.81'/></mujoco>")
    path.write_text(MJCF)


def read_repaired(path: Path) -> None:
    """Read a URDF with the repairs of what is written wrongly, and of what identifications give."""
    Robot.load(path, repair=[repairs.ALL, repairs.ACCEPT, repairs.NO_FRICTION])


CASES: dict[str, Case] = {
    "mjcf": read_again(".mjcf.xml", write_mjcf, Robot.load, altered),
    "repaired": read_again(
        ".urdf", lambda path: path.write_bytes(robots.locate(ARM)[0].read_bytes()), read_repaired, altered
    ),
    "drives": read_again(
        ".drives.yaml",
        lambda path: path.write_text("q1: {rotor_inertia: 0.1, stiffness: 4000.0, gear_ratio: 50.0}\n"),
        lambda path: Drives.read(path, arm().joint_names),
        altered,
    ),
    "netcdf": read_again(".t.nc", write_rollout, lambda path: Recorded.load(path, arm())),
    "mcap": read_again(
        ".mcap",
        lambda path: logs.write(
            simulate(RigidBodyPlant(arm()), GPI(arm(), 1e-3), Hold([0.0] * 3), 0.02), path
        ),
        lambda path: Recorded.load(path, arm()),
    ),
    "yaml": yaml_case,
    "arguments": arguments_case,
    "rollout": read_again(".nc", write_rollout, load),
    "weights": read_again(
        ".weights.nc",
        lambda path: save_weights(Weights(omega_c=np.full((3, 4), 0.5)), path, arm()),
        lambda path: load_weights(path, arm()),
    ),
    "trajectory": read_again(
        ".csv", lambda path: write_table(path, ""), lambda path: Recorded.load(path, arm())
    ),
    "log": read_again(
        ".log.csv", lambda path: write_table(path, "q_", "tau_"), lambda path: read_log(path, arm())
    ),
    "armlog": read_again(".armlog", write_armlog, lambda path: log.to_rollout(log.read(path), arm())),
    "identification": read_again(".identified.json", write_identification, read_identification),
    "task": read_again(
        ".yaml",
        lambda path: path.write_text("around: {q1: 0.1, q2: 0.2, q3: -0.3}\nby: [0.1, 0.2, 0.3]\n"),
        lambda path: box_of(arm(), read_box(path)),
    ),
    "certificate": read_again(".json", lambda path: certify(arm(), speed=0.2).save(path), check_file),
    "tune": study_case(TUNE, "tune", "FILE", "--backend", "numpy"),
    "contend": study_case("", "benchmark", "controllers", ARM, "--quick", "--law", "GPI, roll-off"),
    "zoo": study_case("", "benchmark", "robots", ARM),
    "sweep": study_case(SWEEP, "sweep", "FILE", "--rollouts", "40"),
    "rare": study_case(SWEEP, "sweep", "FILE", "--rollouts", "100", "--rare"),
}


def main() -> int:
    """Run the cases, print what came out, and return 1 when something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=CASES)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    ends: Counter[str] = Counter()
    failed, longest, before = 0, 0.0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY, resource.RLIM_INFINITY))
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in range(chosen.seed, chosen.seed + chosen.count):
            begun = time.process_time()
            try:
                CASES[chosen.what](np.random.default_rng(seed), Path(name))
                end = "fine"
            except ArmgpiError as error:
                end = type(error).__name__
            except Exception:
                end = "FAILED"
                print(f"seed {seed}:\n{traceback.format_exc()}")
            longest = max(longest, took := time.process_time() - begun)
            if took > PATIENCE:
                print(f"seed {seed}: took {took:.1f} s")
                end = "FAILED"
            failed += end == "FAILED"
            ends[end] += 1
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    said = ", ".join(f"{n} {end}" for end, n in ends.most_common())
    print(f"{chosen.what}: {chosen.count} cases: {said}; at most {longest:.1f} s each, {more:.0f} MB in all")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
