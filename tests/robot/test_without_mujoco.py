"""Commands on a MuJoCo model where the package `mujoco` is not installed: one line that names it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

MODEL = """<mujoco model="lever"><worldbody><body name="arm"><joint name="turn" axis="0 1 0" limited="true"
 range="-60 60" damping="0.1" armature="0.1"/><geom type="box" size="0.03 0.03 0.2"/></body></worldbody>
<actuator><motor joint="turn" forcelimited="true" forcerange="-30 30"/></actuator></mujoco>"""
#: A process in which `mujoco` is not found, as where it is not installed, runs commands one after the other.
CODE = """
import contextlib, importlib.machinery, io, json, sys
found = importlib.machinery.PathFinder.find_spec
def without(name, path=None, target=None):
    return None if name.partition(".")[0] == "mujoco" else found(name, path, target)
importlib.machinery.PathFinder.find_spec = without
from armgpi.cli import main
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["armgpi", *arguments]
    error = io.StringIO()
    code = 0
    with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    print(json.dumps([code, error.getvalue()]))
"""


def run(commands: list[list[str]], folder: Path) -> list[Any]:
    """Run commands without the package, and return exit code and standard error of each."""
    call = [sys.executable, "-c", CODE, json.dumps(commands)]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_every_command_on_an_mjcf_names_the_package_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "lever.xml").write_text(MODEL)
    (tmp_path / "move.yaml").write_text("robot: lever.xml\n")
    (tmp_path / "model.py").write_text("def gravity(q):\n    return [0.0]\n")
    arm = "lever.xml"
    commands = [
        *([name, arm] for name in ("run", "inspect", "compare", "new", "certify", "bound", "view", "play")),
        ["derive", arm],
        ["export", arm, "-o", "out"],
        ["inspect", arm, "--cross-check"],
        ["validate", "model.py", "--robot", arm],
        ["run", "-c", "move.yaml"],
    ]
    for command, (code, said) in zip(commands, run(commands, tmp_path), strict=True):
        assert code == 2, (command, said)
        assert said.startswith("error: "), (command, said)
        assert said.count("\n") == 1, (command, said)
        assert "pip install mujoco" in said, (command, said)


def test_what_needs_no_mujoco_runs_without_it(tmp_path: Path) -> None:
    for code, said in run([["robots"], ["doctor"], ["derive", "twodof"]], tmp_path):
        assert code == 0, said
