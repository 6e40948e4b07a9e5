"""Forty mistakes of a user: each gets one line, an exit code of 2, and the way out."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import Answer

from armgpi import robots

#: What was typed, in a folder with the files below -> what the line must name.
MISTAKES = {
    "run arm.urdf --payload 1kg": "without its unit",
    "run arm.urdf --payload=-1": "--payload: expected 0 or more",
    "run arm.urdf --payload heavy": "expected a number",
    "inspect arm.urdf --payload 0,5": "with a point",
    "run arm.urdf --dt 1ms": "5 ms is 0.005",
    "run arm.urdf --dt 0": "--dt: expected 1e-09 or more",
    "run arm.urdf --to 30deg": "write 0.523599",
    "run arm.urdf --delay 1ms": "write 0.001",
    "run arm.urdf --omega fast": "expected numbers such as",
    "run arm.urdf --rotor-inertia 0.1kg": "write 0.1",
    "run arm.urdf --encoder-bits 16.5": "a whole number",
    "run arm.urdf --t-final=-1": "a number above 0",
    "excite arm.urdf --seconds 20s": "without its unit",
    "run anthropomorphic": "did you mean 'anthropomorphic3'",
    "run nothing.urdf": "in that folder there is arm.urdf",
    "run .": "give the URDF in it",
    "run readme.md": "give the whole URDF",
    "run page.html": "download the file itself",
    "run arm.xacro": "expand it first",
    "run broken.urdf": "correct that place",
    "run empty.urdf": "give a URDF",
    "run arm.urdf --lock nojoint": "known: q1, q2, q3",
    "run arm.urdf --keep left_arm": "known: q1, q2, q3",
    "run arm.urdf --to joint1=0.8": "known: q1, q2, q3",
    "run arm.urdf --to 0.1,0.2": "expected 3 numbers",
    "run arm.urdf --controller gpl": "did you mean 'gpi'",
    "run arm.urdf --controllers gpi,pid": "use armgpi compare",
    "compare arm.urdf --controllers gpi;pid": "did you mean",
    "run arm.urdf --t-final 0.1 --out file.txt": "choose another folder",
    "run arm.urdf --t-final 0.1 --out /proc/nope": "choose another folder",
    "export arm.urdf -o /proc/nope": "choose another folder",
    "run arm.urdf --plot a.gif": ".png, .svg, .pdf",
    "run arm.urdf --report .": "name a file",
    "run": "name a robot",
    "run nothing.yaml": "armgpi new",
    "run --config arm.urdf": "armgpi new",
    "run key.yaml": "did you mean 'plant'",
    "run tabs.yaml": "indent with spaces",
    "run law.yaml": "as in 'type: gpi'",
    "run load.yaml": "its keys: mass, frame, com",
    "run name.yaml": "did you mean",
    "rnu arm.urdf": "did you mean 'run'",
    "run arm.urdf --paylod 1": "--payload",
    "run arm.urdf exp.yaml": "armgpi run --help",
    "sweep exp.yaml --out x": "specify distributions below vary",
    "sweep ur5 --out x": "armgpi new",
    "view rollout.nc": "a rollout that armgpi wrote",
    "report file.txt -o r.html": "a rollout that armgpi wrote",
    "certify arm.urdf --payload 3": "as '0:3'",
    "identify log.csv --robot arm.urdf": "known: time, q",
    "validate nothing.py --robot arm.urdf": "in that folder there is dynamics.py",
    "run weak.urdf": "--effort q1=10.0,q2=10.0,q3=10.0",  # all of its joints cannot be locked
    "sweep weak.yaml": "robot.effort: {q1: 10.0, q2: 10.0, q3: 10.0}",  # it has no --effort
    "new arm.urdf --target uur": "bare, fci, ur, ros2_control",
    "sweep exp.yaml --rollouts many --out x": "a whole number from 1",
    "run arm.urdf --to 90,45,30": "90 deg is 1.571",
    "new arm.urdf -o arm.urdf": "is the robot itself; choose another file, such as arm.yaml",
    "new exp.yaml": "armgpi run exp.yaml",
    "play arm.urdf -o page.pdf": "name it page.html",
    "sweep vary.yaml --out x": "did you mean 'plant.delay'",
    "certify arm.urdf --payload 3:0": "the lighter first",
    "compare exp.yaml key.yaml": "armgpi compare takes one argument, ROBOT",
    "run arm.urdf --seed abc": "expected a whole number",
    "run arm.urdf -payload 1": "names of options have two dashes",
    "run nothing_in_it.yaml": "is empty; expected a mapping",
    "run colon.yaml": "put each key on a line of its own",
    "run tag.yaml": "leave the tag out",
    "run twice.yaml": "is a duplicate key; leave one",
    "run dt.yaml": "write sample_time",
    "run mapping.yaml": "begin each entry with '- '",
    "run no_robot.yaml": "is missing; add it, such as 'robot: ...'",
    "identify semicolons.csv --robot arm.urdf": "separate columns by commas",
    "run behind.yaml": "behind.yaml:4: plant.environment.0.distance: must be a wall that 'tool0'",
    "certify behind.yaml": "behind.yaml:3: plant.environment: disturbances of a bound are given by --torque",
    "inspect arm.urdf --keep nope": "command line: --keep: there is no moving joint named 'nope'",
    "derive arm.urdf --lock nope=1": "command line: --lock: there is no moving joint named 'nope'",
    "view arm.urdf --keep nope": "command line: --keep: there is no moving joint named 'nope'",
    "view behind.yaml": "behind.yaml is an experiment file; name its robot",
    "derive behind.yaml": "is YAML: for an experiment file, give the name or the URDF of its robot",
    "export behind.yaml -o c": "a wall that 'tool0' starts before",
    "loop behind.yaml --clock simulated": "a wall that 'tool0' starts before",
    "loop arm.urdf --clock real": "--clock: must be one of wall, simulated",
    "loop arm.urdf --watchdog=-3": "--watchdog: must be a whole number",
    "export arm.urdf --target fci -o c": "--target: must be one for a model with rotor inertia",
    "export arm.urdf --name 9x -o c": "--name: must be a C identifier",
    "run unit.urdf": "effort='30 Nm' is not a number; write 30 (N m)",
    "run same.urdf": "two joints are named 'q1'; rename one",
}
FILES = {
    "empty.urdf": "",
    "readme.md": "# hello\n",
    "page.html": "<html></html>",
    "arm.xacro": '<robot xmlns:xacro="http://ros.org/wiki/xacro" name="a"><xacro:if value="1"/></robot>',
    "file.txt": "x",
    "key.yaml": "robot: arm.urdf\npayload: 1\n",
    "tabs.yaml": "robot: arm.urdf\nplant:\n\tdelay: 1\n",
    "name.yaml": "robot: anthropomorphic\n",
    "law.yaml": "robot: arm.urdf\ncontrollers: [gpi]\n",
    "load.yaml": "robot: arm.urdf\nplant: {payload: 0.5}\n",
    "exp.yaml": "robot: arm.urdf\n",
    "vary.yaml": "robot: arm.urdf\nvary: {plant.dela: {choices: [0, 1]}}\n",
    "log.csv": "time,q\n0,1\n",
    "dynamics.py": "",
    "nothing_in_it.yaml": "",
    "colon.yaml": "robot: arm.urdf\nplant: delay: 1\n",
    "tag.yaml": "robot: !!python/object:os.system arm.urdf\n",
    "twice.yaml": "robot: arm.urdf\nseed: 1\nseed: 2\n",
    "dt.yaml": "robot: arm.urdf\ndt: 0.001\n",
    "mapping.yaml": "robot: arm.urdf\ncontrollers: {mine: {type: gpi}}\n",
    "no_robot.yaml": "seed: 1\n",
    "semicolons.csv": "time;q1\n0;1\n",
    "behind.yaml": (
        "robot: {name: ur5}\nplant:\n  environment:\n"
        "    - {type: wall, frame: tool0, normal: [0, 0, 1], distance: 2.2, stiffness: 1.0e4}\n"
    ),
    "weak.yaml": "robot: weak.urdf\nvary: {plant.delay: {choices: [0, 1]}}\n",
}


@pytest.mark.parametrize("typed", MISTAKES)
def test_a_mistake_gets_one_line_that_names_the_way_out(
    typed: str, cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    urdf = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    weak = re.sub('effort="[^"]*"', 'effort="0"', urdf)
    arms = {
        "arm": urdf,
        "broken": urdf[:900],
        "weak": weak,
        "same": urdf.replace('joint name="q2"', 'joint name="q1"'),
    }
    arms["unit"] = re.sub('effort="([^"]*)"', r'effort="\1 Nm"', urdf)
    for name, text in {**FILES, **{f"{name}.urdf": text for name, text in arms.items()}}.items():
        Path(name).write_text(text, encoding="utf-8")
    answer = cli(*typed.split())
    assert answer.code == 2, answer.out
    (line,) = answer.err.splitlines()
    assert re.match("error: ", line, re.IGNORECASE)
    assert MISTAKES[typed] in line
