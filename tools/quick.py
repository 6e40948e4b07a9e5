"""Run the tests of the packages that a change touches, and the fast tests of all.

Usage: python tools/quick.py [options for pytest]

A change is what differs from `main`, committed or not. `armgpi/ROOM/` has its tests in `tests/ROOM/`, the
modules beside the rooms in `tests/base/`. Tests marked `slow` are for `make test` alone.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: They look at much in some seconds.
FAST = """
    base/arrays base/public_names robot/robot robot/robots robot/urdf robot/crosscheck robot/meshes
    robot/grippers robot/locking robot/mimic health/health config/scenario config/experiment gpi/gains gpi/gpi
    gpi/realisation gpi/network gpi/splines references/bezier references/waypoints references/reference
    plants/loads plants/actuators plants/sensors plants/turns paper/scenarios codegen/lanes codegen/refusals
"""


def git(*arguments: str) -> list[str]:
    """Return what git prints, line by line."""
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()


def file_of(name: str) -> Path:
    """Return the tests in `tests/` that go by a name: gpi/gains -> tests/gpi/test_gains.py."""
    return (ROOT / "tests" / name).with_name(f"test_{Path(name).name}.py")


def tests_of(path: Path) -> list[Path]:
    """Return the tests of a file of the project: itself, those of its room, or none."""
    if path.parts[0] == "tests" and path.name.startswith("test_"):
        return [ROOT / path]
    if path.parts[0] != "armgpi":
        return []
    return [ROOT / "tests" / (path.parts[1] if len(path.parts) > 2 else "base")]


def main() -> None:
    """Find the tests and run them."""
    base = git("merge-base", "HEAD", "main")
    changed = git("diff", "--name-only", *base) + git("ls-files", "--others", "--exclude-standard")
    own = {test for path in changed for test in tests_of(Path(path))}
    tests = {str(test) for test in own.union(map(file_of, FAST.split())) if test.exists()}
    options = ["-n", "auto", "--dist", "worksteal", "-m", "not search and not slow", *sys.argv[1:]]
    sys.exit(subprocess.call([sys.executable, "-m", "pytest", *options, *sorted(tests)], cwd=ROOT))


if __name__ == "__main__":
    main()
