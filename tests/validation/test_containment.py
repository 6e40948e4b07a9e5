"""What a model starts ends with the command, and nothing that it writes harms the process that reads it."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import random
import resource
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from armgpi import errors, validate
from armgpi.validation import containment, worker
from armgpi.validation.line import Line, pair

ARM = "double_pendulum"
#: Forks twice with a session of its own in between, as a daemon does; the last process writes its id.
DAEMON = """
import os, time
if not os.path.exists({path!r}):
    if not os.fork():
        os.setsid()
        if not os.fork():
            open({path!r} + ".new", "w").write(str(os.getpid()))
            os.rename({path!r} + ".new", {path!r})
            time.sleep(300)
        os._exit(0)
    os.wait()
def gravity(q):
    {body}
    return [0.0, 0.0]
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="adoption of orphans is Linux's")


def can_isolate() -> bool:
    """Tell whether this system has user namespaces, in a fork, as the answer changes who asks."""
    if not (tried := os.fork()):
        try:
            containment.isolate()
            os._exit(0)
        except containment.Unavailable:
            os._exit(1)
    return os.waitpid(tried, 0)[1] == 0


def start(folder: Path, body: str, *options: str) -> tuple[subprocess.Popen[str], Path]:
    """Start `armgpi validate` on a model with a daemon; return it, and where the daemon writes its id."""
    place = folder / "daemon"
    (folder / "model.py").write_text(DAEMON.format(path=str(place), body=body), encoding="utf-8")
    words = ["-m", "armgpi", "validate", "model.py", "--robot", ARM, "--time-limit", "60", *options]
    begun = subprocess.Popen(
        [sys.executable, *words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return begun, place


def daemon_of(place: Path) -> int:
    """Return the id of a daemon, as soon as it has written it."""
    until = time.monotonic() + 60.0
    while not place.exists():
        assert time.monotonic() < until
        time.sleep(0.02)
    return int(place.read_text())


def wait_for_end(process: int) -> None:
    """Wait until a process is no more."""
    until = time.monotonic() + 20.0
    while os.path.exists(f"/proc/{process}"):
        assert time.monotonic() < until, f"{process} is still there"
        time.sleep(0.02)


def test_a_daemon_ends_with_the_command(tmp_path: Path) -> None:
    begun, place = start(tmp_path, "pass")
    begun.communicate(timeout=120)
    wait_for_end(daemon_of(place))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_daemon_ends_when_the_command_is_stopped(tmp_path: Path, number: signal.Signals) -> None:
    begun, place = start(tmp_path, "time.sleep(100)")
    daemon = daemon_of(place)
    time.sleep(0.3)
    begun.send_signal(number)
    begun.communicate(timeout=60)
    wait_for_end(daemon)


def test_a_stopped_keeper_ends_too(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text(
        "import os, signal\ndef gravity(q):\n    os.kill(os.getppid(), signal.SIGSTOP)\n    return [0.0, 0.0]"
    )
    began = time.monotonic()
    validate(path, ARM)
    assert time.monotonic() - began < 30.0


#: Tries what an isolated model may not do, and returns as gravity what it achieved.
TRIES = """
import os, pathlib, socket
def achieved(attempt):
    try:
        attempt()
    except Exception:
        return 0.0
    return 1.0
done = [
    achieved(lambda: open({folder!r} + "/written", "w")),
    achieved(lambda: (pathlib.Path.home() / "written").write_text("x")),
    achieved(lambda: socket.create_connection(("127.0.0.1", {port}), 1.0)),
    achieved(lambda: os.kill({parent}, 0)),
    achieved(lambda: os.listdir("/proc/{parent}")),
    achieved(lambda: os.unlink({folder!r} + "/other")),
    achieved(lambda: os.write({descriptor}, b"x")),
]
if os.environ.get("TMPDIR"):
    open(os.environ["TMPDIR"] + "/scratch", "w").write("x")
def gravity(q):
    if any(done):
        raise ValueError(done)
    return [0.0, 0.0]
"""


def has_bubblewrap() -> bool:
    """Tell whether bubblewrap works on this system."""
    return not containment._try_bubblewrap()


@pytest.fixture(params=[containment.NAMESPACES, containment.BUBBLEWRAP])
def means(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Have one of the two ways isolate a model; a system without it is skipped."""
    chosen = str(request.param)
    if not (can_isolate() if chosen == containment.NAMESPACES else has_bubblewrap()):
        pytest.skip(f"this system has no {chosen}")
    if chosen == containment.BUBBLEWRAP:
        monkeypatch.setattr(containment, "isolate", forbidden)
    return chosen


def forbidden() -> None:
    """Fail as where a system gives no namespaces."""
    raise containment.Unavailable("unshare: Operation not permitted")


def test_an_isolated_model_writes_nothing_and_reaches_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, means: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    path = tmp_path / "model.py"
    (tmp_path / "other").touch()
    with socket.create_server(("127.0.0.1", 0)) as server, open(tmp_path / "ours", "w") as ours:
        os.set_inheritable(ours.fileno(), True)
        path.write_text(
            TRIES.format(
                folder=str(tmp_path),
                port=server.getsockname()[1],
                parent=os.getpid(),
                descriptor=ours.fileno(),
            ),
            encoding="utf-8",
        )
        report = validate(path, ARM, isolate=True)
        assert [one.function for one in report.functions] == ["gravity"]
        assert (
            f"the model ran without network, other processes and files to write, by {means}" in report.text()
        )
        with pytest.raises(
            errors.ModelError, match=r"ValueError: \[1\.0, 1\.0, 1\.0, 1\.0, 1\.0, 1\.0, 1\.0\]"
        ):
            validate(path, ARM)


def test_an_isolated_model_and_its_daemon_end(tmp_path: Path, means: str) -> None:
    path = tmp_path / "model.py"
    text = "import os, time\nif not os.fork():\n    os.setsid()\n    os.fork()\n    time.sleep(301)\n"
    path.write_text(text + "def gravity(q):\n    os._exit(7)\n", encoding="utf-8")
    with pytest.raises(errors.ModelError, match="with exit code 7"):
        validate(path, ARM, isolate=True)
    assert not [x for x in Path("/proc").glob("[0-9]*/cmdline") if str(path) in x.read_text(errors="ignore")]


def test_isolated_models_are_named_as_others_are(tmp_path: Path, means: str) -> None:
    """What a process in isolation ends by, and the state at which it did, is what one outside says."""
    path = tmp_path / "model.py"
    text = "import os\nseen = []\ndef gravity(q):\n    seen.append(q)\n    if len(seen) == 5:\n"
    path.write_text(text + "        os.kill(os.getpid(), 9)\n    return [0.0, 0.0]\n", encoding="utf-8")
    said = []
    for isolate in (False, True):
        with pytest.raises(errors.ModelError, match="SIGKILL") as caught:
            validate(path, ARM, isolate=isolate)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_bubblewrap_runs_no_model_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_bubblewrap():
        pytest.skip("this system has no bubblewrap")
    monkeypatch.setattr(containment, "isolate", forbidden)
    with pytest.raises(errors.ParameterError, match="only bubblewrap works here, which runs models of files"):
        validate({"gravity": lambda q: q}, ARM, isolate=True)


def test_where_nothing_isolates_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(containment, "isolate", forbidden)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(
        errors.ParameterError,
        match=r"isolate.*unshare: Operation not permitted; bubblewrap: it is not installed",
    ):
        validate("paper", "anthropomorphic3", isolate=True)


def test_a_program_called_bwrap_that_does_nothing_of_the_kind_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bwrap").write_text("#!/bin/sh\necho 'bwrap: no permission' >&2\nexit 1\n")
    (tmp_path / "bwrap").chmod(0o755)
    monkeypatch.setattr(containment, "isolate", forbidden)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    with pytest.raises(errors.ParameterError, match="bubblewrap: no permission"):
        validate("paper", "anthropomorphic3", isolate=True)


#: Takes 300 MB in a child of its own.
TAKES = """
import os, time
def gravity(q):
    if not os.fork():
        kept = bytes(1) * (300 * 2**20)
        time.sleep(60)
    os.wait()
    return [0.0, 0.0]
"""


def test_memory_is_bounded_where_no_limit_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on macOS, whose kernel takes RLIMIT_AS and ignores it: stood in for by a limit that is not set."""
    monkeypatch.setattr(containment, "bounds_memory", lambda: False)
    monkeypatch.setattr(worker, "MEMORY", 200 * 2**20)
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    path = tmp_path / "model.py"
    path.write_text(TAKES, encoding="utf-8")
    began = time.monotonic()
    with pytest.raises(errors.ModelError, match=r"takes more than 0\.195312 GiB of memory"):
        validate(path, ARM, time_limit=50.0)
    assert time.monotonic() - began < 40.0
    path.write_text("def gravity(q):\n    return [0.0, 0.0]\n", encoding="utf-8")
    assert validate(path, ARM).functions


def test_a_model_that_shortens_the_counter_ends_nobody(tmp_path: Path) -> None:
    """The parent reads which call its process is at from a file that both have."""
    path = tmp_path / "model.py"
    path.write_text(
        "import contextlib, os\ndef gravity(q):\n    for k in range(3, 64):\n"
        "        with contextlib.suppress(OSError):\n            os.ftruncate(k, 0)\n"
        "    raise ValueError('done')\n"
    )
    with pytest.raises(errors.ModelError, match="ValueError: done"):
        validate(path, ARM)


def test_a_report_says_what_is_not_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "not bounded" not in validate("paper", "anthropomorphic3").text()
    monkeypatch.setattr(sys, "platform", "darwin")
    text = validate("paper", "anthropomorphic3").text()
    assert "the memory of the model is bounded by a look at it five times a second on this system" in text
    monkeypatch.setenv("PATH", "")
    text = validate("paper", "anthropomorphic3").text()
    assert "the memory of the model is not bounded on this system" in text
    assert "processes that the model starts in a session of their own are not ended" in text


def test_orphans_are_ended_without_proc(monkeypatch: pytest.MonkeyPatch) -> None:
    """A group ends where nothing tells of children, as on macOS."""
    reader, writer = os.pipe()
    if not (kept := os.fork()):
        monkeypatch.setattr(containment, "_children", list)

        def wait() -> None:
            os.write(writer, b"x")
            time.sleep(300)

        containment.keep(wait, worker.MEMORY)
    os.read(reader, 1)
    os.kill(kept, signal.SIGTERM)
    assert os.waitstatus_to_exitcode(os.waitpid(kept, 0)[1]) == 0


#: Answers as a process sends them.
OPENING: list[Any] = [True, [["gravity"], 2, False, "def gravity(q):\n    return q * 1.5\n", []]]
CALL: list[Any] = [[2], [0.0, 0.0], False, 1e-5]
CHANGE = ["sign", [2, 4, 2, 8], "q", "-q", "gravity", "", 3.0, ["gravity"]]
SOURCE = "def gravity(q):\n    return -q * 1.5\n"
REPAIRED: list[Any] = [True, [[CHANGE], SOURCE, 0, 1, 0, True, [[0, [[0, 1.0]]]], SOURCE, []]]
ODD: tuple[Any, ...] = (
    *(None, True, -1, 10**400, 1e308, float("nan"), float("inf"), "x", "\x1b[2J\n", "\ud800", [], {}),
    *([[]], ["gravity"], {"gravity": 1}, [1e999], "(" * 5000, 2**63, 64, [2**40], [-1], 0.5),
)


def altered(value: Any, draw: random.Random) -> Any:
    """Return a value with something odd somewhere in it."""
    if not isinstance(value, list) or not value or draw.random() < 0.15:
        return draw.choice(ODD)
    k = draw.randrange(len(value))
    if draw.random() < 0.1:
        return value[:k] + value[k + 1 :]
    return [*value[:k], altered(value[k], draw), *value[k + 1 :]]


def written(answer: Any, draw: random.Random) -> bytes:
    """Return an odd answer as bytes: odd data, no JSON, or another length than it says."""
    kind = draw.random()
    if kind < 0.8:
        text = json.dumps(altered(answer, draw)).encode()
        return struct.pack("!Q", len(text)) + text
    if kind < 0.9:
        text = draw.randbytes(40)
        return struct.pack("!Q", len(text)) + text
    return struct.pack("!Q", draw.choice([2**63, 2**40, 500])) + b"[" * 100


def hostile(seed: int) -> Any:
    """Return what serves in a model's place: all goes well for some answers, then one is odd."""

    def serve(line: Line, *_: Any) -> None:
        draw = random.Random(seed)
        good = draw.randrange(30)
        with contextlib.suppress(Exception):
            for k in range(200):
                name, given = "reading", [0]
                if k:
                    name, given = pickle.loads(line.receive(2**30))
                answer = OPENING if not k else [True, [CALL] * len(given)] if name else REPAIRED
                if k < good:
                    line.send(json.dumps(answer).encode())
                    continue
                line._end.sendall(written(answer, draw))
        time.sleep(0.2)
        os._exit(0)

    return serve


def outcome(seed: int, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return how a validation ends whose process answers oddly."""
    monkeypatch.setattr(worker, "_serve", hostile(seed))
    monkeypatch.setattr(worker, "_ARRIVES", 0.3)
    try:
        report = validate({"gravity": lambda q: q}, ARM, time_limit=0.3)
    except errors.ArmgpiError as error:
        return type(error).__name__ if "\n" not in str(error) else "several lines"
    assert "\x1b" not in report.text()
    assert report.html()
    return "report"


@pytest.mark.parametrize("seed", range(40))
def test_the_parent_survives_whatever_a_process_writes(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert outcome(seed, monkeypatch) in ("ModelError", "report")


@pytest.fixture
def line() -> Iterator[tuple[Line, socket.socket]]:
    ours, theirs = pair()
    yield ours, theirs._end
    ours.close()
    theirs.close()


def test_a_message_that_does_not_end_is_not_waited_for(line: tuple[Line, socket.socket]) -> None:
    ours, theirs = line
    theirs.sendall(struct.pack("!Q", 100) + b"x")
    with pytest.raises(ValueError, match="does not end"):
        ours.receive(1000, 1.0, 0.1)


def test_a_long_message_is_refused_before_it_is_read(line: tuple[Line, socket.socket]) -> None:
    ours, theirs = line
    theirs.sendall(struct.pack("!Q", 2**62))
    with pytest.raises(ValueError, match="a message of"):
        ours.receive(1000, 1.0, 0.1)


def test_nothing_is_sent_to_who_does_not_read(line: tuple[Line, socket.socket]) -> None:
    ours, _ = line
    with pytest.raises(OSError, match="timed out"):
        ours.send(bytes(2**24), 0.1)


def test_a_number_that_the_source_does_not_have_is_refused() -> None:
    source = "a = 1.0\nb = 2.0\n"

    def answered(place: int) -> Any:
        return [[], source, 0, 0, 0, True, [[place, [[0, 1.0]]]], "", []]

    found = worker._read_repaired(answered(1), source)
    assert found is not None
    assert found.standing == {1: {0: 1.0}}
    for place in (-1, 2):
        with pytest.raises(ValueError):  # noqa: PT011 (which the line to the model turns into its error)
            worker._read_repaired(answered(place), source)
