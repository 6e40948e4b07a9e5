"""Build the wheel and try it as a user would: installed alone, run from another folder.

Usage: python tools/check_wheel.py (in an environment with the `dev` extra)
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TRIAL = 'import armgpi; print(*armgpi.Robot.load("anthropomorphic3").joint_names)'


def run(*command: str | Path, cwd: Path) -> None:
    """Run a command, showing it, and stop at its failure."""
    print("+", *command, flush=True)
    # Without PYTHON*: nothing of the calling environment may help the wheel to import.
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    subprocess.run([str(part) for part in command], cwd=cwd, env=env, check=True)


def main() -> None:
    """Build, look inside, install and try."""
    with tempfile.TemporaryDirectory(prefix="armgpi-wheel-") as name:
        tmp = Path(name)
        # The sdist is built first and the wheel from it, so both are tried.
        build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", tmp, ROOT]
        run(*build, cwd=ROOT)
        (wheel,) = tmp.glob("*.whl")

        shipped = set(zipfile.ZipFile(wheel).namelist())
        wanted = {f"armgpi/{path.relative_to(ROOT)}" for path in ROOT.glob("urdf/**/*.urdf")}
        if missing := sorted((wanted | {"armgpi/py.typed"}) - shipped):
            sys.exit(f"{wheel.name} lacks {', '.join(missing)}")

        venv.create(tmp / "venv", with_pip=True)
        bin_dir = tmp / "venv" / "bin"
        pip = [bin_dir / "python", "-m", "pip", "install", "--quiet", "--no-compile"]
        run(*pip, "-c", ROOT / "constraints.txt", wheel, cwd=tmp)
        run(bin_dir / "armgpi", "--help", cwd=tmp)
        run(bin_dir / "python", "-c", TRIAL, cwd=tmp)
        # And README's own line and commands, in another fresh environment.
        run(sys.executable, ROOT / "tools" / "commands.py", ROOT / "README.md", "--wheel", wheel, cwd=tmp)


if __name__ == "__main__":
    main()
