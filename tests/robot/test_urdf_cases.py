"""Bad files as a user brings them: each ends as its verdict says, in a process of its own.

`expected.tsv` gives a verdict per file: "refuse" (exit code 2, one line that says why, with one of the names
where there are some), "warn" (a finding) or "accept" (exit code 0). No traceback, crash or hang.
"""

from __future__ import annotations

import csv
import json
import os
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "fixtures" / "urdf_cases"
MEMORY, SECONDS = 2 * 1024**3, 10
Inspect = Callable[..., subprocess.CompletedProcess[str]]


def cases() -> list[tuple[str, ...]]:
    with (FOLDER / "expected.tsv").open(encoding="utf-8", newline="") as file:
        return [tuple(row.values()) for row in csv.DictReader(file, delimiter="\t")]


#: Imports what `armgpi inspect` does once, and has a child of its own do it for each line that it reads.
CHILDREN = f"""
import json, os, resource, signal, sys, tempfile, traceback
from contextlib import redirect_stdout
from armgpi.cli import main

def call(words):
    sys.argv = ["armgpi", "inspect", *words]
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    except BaseException:
        traceback.print_exc()
    return 99

with open(os.devnull, "w") as nothing, redirect_stdout(nothing):
    call(["anthropomorphic3"])
for line in sys.stdin:
    files = [tempfile.TemporaryFile("w+", encoding="utf-8") for _ in range(2)]
    child = os.fork()
    if not child:
        resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
        resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS}, {SECONDS}))
        signal.alarm(60 * {SECONDS})  # who waits for ever takes no processor time
        sys.stdout, sys.stderr = files
        for i, file in enumerate(files):
            os.dup2(file.fileno(), i + 1)
        code = call(json.loads(line))
        for file in files:
            file.flush()
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    for file in files:
        file.seek(0)
    print(json.dumps([code, *(file.read() for file in files)]), flush=True)
"""


@pytest.fixture(scope="module")
def children() -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", CHILDREN],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONIOENCODING": "utf-8"},
    ) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


@pytest.fixture
def inspect_file(children: subprocess.Popen[str]) -> Inspect:
    """How `armgpi inspect` ends, in a process of its own with 10 s of the processor and 2 GiB."""

    def call(*words: Path | str) -> subprocess.CompletedProcess[str]:
        assert children.stdin is not None
        assert children.stdout is not None
        print(json.dumps([*map(str, words)]), file=children.stdin, flush=True)
        return check_end(subprocess.CompletedProcess(words, *json.loads(children.stdout.readline())))

    return call


def check_end(done: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    """The end of a process that shows no traceback."""
    assert "Traceback" not in done.stderr + done.stdout
    assert done.returncode in (0, 1, 2), done.stderr
    return done


def reason(done: subprocess.CompletedProcess[str]) -> str:
    """Return the line with which a file is refused."""
    assert done.returncode == 2, done.stdout
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert not done.stdout
    return line


def test_every_file_has_a_verdict() -> None:
    assert {name for name, _, _ in cases()} == {path.name for path in FOLDER.glob("*.urdf")}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "verdict", "words"), cases(), ids=[name for name, _, _ in cases()])
def test_a_file_ends_as_its_verdict_says(inspect_file: Inspect, name: str, verdict: str, words: str) -> None:
    if "mjcf" in name:
        pytest.importorskip("mujoco")
    done = inspect_file(FOLDER / name, "--json")
    if verdict == "refuse":
        line = reason(done)
        assert not words or any(word in line for word in words.split("|")), line
        return
    report: dict[str, Any] = json.loads(done.stdout)
    serious = [f for f in report["findings"] if f["level"] != "info"]
    assert done.returncode == any(f["level"] == "error" for f in serious)
    if verdict == "accept":
        assert done.returncode == 0
        assert not serious
    else:
        assert serious
        assert not words or any(word in f["where"] for f in serious for word in words.split("|"))


# --- Made on the fly -----------------------------------------------------------------------------


def good() -> str:
    return (FOLDER / "00_good.urdf").read_text(encoding="utf-8")


def test_what_is_no_file_of_text_is_refused_at_once(inspect_file: Inspect, tmp_path: Path) -> None:
    fifo, zero, device = tmp_path / "fifo.urdf", tmp_path / "zero.urdf", tmp_path / "null.urdf"
    os.mkfifo(fifo)
    zero.symlink_to("/dev/zero")
    device.symlink_to("/dev/null")
    for path in (fifo, zero, device):
        assert "no regular file" in reason(inspect_file(path))
    assert "a folder" in reason(inspect_file(tmp_path))
    loop = tmp_path / "loop.urdf"
    loop.symlink_to(loop)
    assert "no such file" in reason(inspect_file(loop))


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_refused(inspect_file: Inspect, tmp_path: Path) -> None:
    path = tmp_path / "secret.urdf"
    path.write_text(good(), encoding="utf-8")
    path.chmod(stat.S_IWUSR)
    assert "ermission" in reason(inspect_file(path))


def test_twenty_thousand_links_in_a_row_are_refused(inspect_file: Inspect, tmp_path: Path) -> None:
    chain = (
        f'<link name="l{i + 1}"/><joint name="j{i}" type="fixed">'
        f'<parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(20_000)
    )
    path = tmp_path / "chain.urdf"
    path.write_text(f'<robot name="c"><link name="l0"/>{"".join(chain)}</robot>', encoding="utf-8")
    assert "more than 2000 joints" in reason(inspect_file(path))


def test_ten_megabytes_of_comments_are_no_obstacle(inspect_file: Inspect, tmp_path: Path) -> None:
    path = tmp_path / "comments.urdf"
    comment = f"<!-- {'x' * 995} -->\n"
    path.write_text(good().replace("</robot>", f"{comment * 10_000}</robot>"), encoding="utf-8")
    assert inspect_file(path).returncode == 0


def test_millions_of_elements_and_attributes_are_refused(inspect_file: Inspect, tmp_path: Path) -> None:
    path = tmp_path / "many.urdf"
    path.write_text(good().replace("</robot>", f"{'<a/>' * 7_000_000}</robot>"), encoding="utf-8")
    assert "XML elements" in reason(inspect_file(path))
    for count, said in ((40_000, "attributes"), (2_000_000, "tag is longer")):
        crowd = " ".join(f'a{i}=""' for i in range(count))
        path.write_text(good().replace("</robot>", f"<gazebo {crowd}/></robot>"), encoding="utf-8")
        assert said in reason(inspect_file(path))
