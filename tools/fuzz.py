"""Throw bad files and arguments at what reads them: every one ends well or in an error of ours, in time.

    python tools/fuzz.py yaml --count 2000 --seed 0
    python tools/fuzz.py rollout --count 2000
    python tools/fuzz.py arguments --count 300

The URDF reader has a tool of its own, `tools/fuzz_urdf.py`. The same seed gives the same cases. A case that
fails is printed with its seed, which alone repeats it: `--seed SEED --count 1`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from armgpi import GPI, Hold, RigidBodyPlant, Robot, config, load, save, simulate
from armgpi.cli import main as command
from armgpi.errors import ArmgpiError

ROOT = Path(__file__).parents[1]
ARM = "anthropomorphic3"
#: Longest time that a case may take [s]; an export compiles and replays, on a machine that may be busy.
PATIENCE = 60.0

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


def rollout_case(rng: np.random.Generator, folder: Path) -> None:
    """Read a rollout that was damaged at a few places."""
    good = folder / "good.nc"
    if not good.exists():
        robot = Robot.load(ARM)
        plant, hold = RigidBodyPlant(robot), Hold([0.0, 0.1, 0.0])
        save(simulate(plant, GPI(robot, 1e-3), hold, 0.02), good)
    data = bytearray(good.read_bytes())
    for _ in range(rng.integers(1, 8)):
        at = int(rng.integers(len(data)))
        change = rng.integers(3)
        if change == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif change == 1:
            data[at : at + 8] = rng.bytes(8)
        else:
            del data[max(at, 1) :]
    (folder / "bad.nc").write_bytes(data)
    load(folder / "bad.nc")


def arguments_case(rng: np.random.Generator, folder: Path) -> None:
    """Call the command line with words in any order."""
    chosen = [ARGUMENTS[rng.integers(len(ARGUMENTS))] for _ in range(rng.integers(0, 7))]
    arguments = [word for word in chosen if word not in ("validate", "view")]  # these start programs, or wait
    if chosen and chosen[0] in ("run", "compare", "export"):
        arguments += ["--t-final", "0.002", *(("-o", str(folder / "out")) if chosen[0] == "export" else ())]
    out, err = io.StringIO(), io.StringIO()
    before = sys.argv
    sys.argv = ["armgpi", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            command()
    except SystemExit as end:
        if end.code not in (None, 0, 1, 2):
            raise AssertionError(f"exit code {end.code} of {arguments}") from None
    except BaseException as error:
        raise AssertionError(f"{type(error).__name__} of {arguments}") from error
    finally:
        sys.argv = before
    text = (out.getvalue() + err.getvalue()).replace("\n", "")
    raw = {c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    if raw or "Traceback" in text:
        raise AssertionError(f"{sorted(map(ascii, raw))} or a traceback is shown by {arguments}")


CASES: dict[str, Callable[[np.random.Generator, Path], None]] = {
    "yaml": yaml_case,
    "rollout": rollout_case,
    "arguments": arguments_case,
}


def main() -> int:
    """Run the cases, print what came out, and return 1 when something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=CASES)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    ends: Counter[str] = Counter()
    failed = 0
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in range(chosen.seed, chosen.seed + chosen.count):
            begun = time.perf_counter()
            try:
                CASES[chosen.what](np.random.default_rng(seed), Path(name))
                end = "fine"
            except ArmgpiError as error:
                end = type(error).__name__
            except Exception:
                end = "FAILED"
                print(f"seed {seed}:\n{traceback.format_exc()}")
            if (took := time.perf_counter() - begun) > PATIENCE:
                print(f"seed {seed}: took {took:.1f} s")
                end = "FAILED"
            failed += end == "FAILED"
            ends[end] += 1
    print(f"{chosen.what}: {chosen.count} cases: {', '.join(f'{n} {end}' for end, n in ends.most_common())}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
