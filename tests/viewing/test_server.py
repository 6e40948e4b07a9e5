"""The page's server: on the loopback address alone, for requests that mean it, until it is closed."""

from __future__ import annotations

import http.client
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
import urllib.request
from pathlib import Path

import pytest
from pictured import box_mesh, package, run

import armgpi
from armgpi import Robot
from armgpi.cli import main, pictures
from armgpi.errors import ParameterError, Remedy
from armgpi.viewing import meshcat
from armgpi.viewing.meshcat import Server, ServerError

ARM = "anthropomorphic3"


def status(port: int, path: str = "/", host: str | None = None) -> int:
    """The answer's status."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    code = connection.getresponse().status
    connection.close()
    return code


def test_it_hands_out_the_page() -> None:
    with Server("<p>ü</p>", port=0) as server:
        assert server.url == f"http://127.0.0.1:{server.port}/"
        with urllib.request.urlopen(server.url) as answer:
            assert answer.read().decode() == "<p>ü</p>"
            assert answer.headers["X-Frame-Options"] == "DENY"
        assert status(server.port, "/etc/passwd") == 404
        assert status(server.port, "/../../etc/passwd") == 404
    with pytest.raises(OSError, match="refused"):
        status(server.port)


def other_addresses() -> list[str]:
    """Addresses of this machine other than 127.0.0.1."""
    found = {"127.0.0.2"} if sys.platform == "linux" else set()
    found |= {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    return sorted(found - {"127.0.0.1"})


def test_other_addresses_are_refused() -> None:
    with Server("page", port=0) as server:
        for address in other_addresses():
            with (
                pytest.raises(OSError, match="refused"),
                socket.create_connection((address, server.port), timeout=5),
            ):
                pass


@pytest.mark.parametrize("host", ["example.com", "192.168.0.1:80", "", "127.0.0.1.example.com"])
def test_requests_by_another_name_are_refused(host: str) -> None:
    with Server("page", port=0) as server:
        assert status(server.port, host=host) == 403
        assert status(server.port, "/live", host=host) == 403
        assert status(server.port, host=f"localhost:{server.port}") == 200


def test_a_port_that_is_taken() -> None:
    server = Server("page", port=0)
    with server, pytest.raises(ServerError, match=f"port {server.port} .*choose another") as caught:
        Server("page", port=server.port)
    assert caught.value.remedies == (Remedy("port"),)
    with Server("a") as first, Server("b") as second:
        assert first.port != second.port
    for port in (-1, 65536, True, 7070.5, "7070"):
        with pytest.raises(ParameterError, match="65535"):
            Server("page", port=port)


# The commands.


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["armgpi", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        return int(end.value.code or 0), capsys.readouterr().err

    return call


@pytest.fixture
def rollout(tmp_path: Path) -> Path:
    return armgpi.save(run(Robot.load(ARM), t_final=0.1), tmp_path / "rollout.nc")


@pytest.mark.slow
def test_pictures_of_a_run(cli, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    files = {
        "--plot": tmp_path / "a.svg",
        "--html": tmp_path / "new" / "a.html",
        "--report": tmp_path / "r.html",
    }
    options = [word for pair in files.items() for word in pair]
    code, err = cli("compare", ARM, "--t-final", "0.05", *options)
    assert code == 0
    for file in files.values():
        assert f"wrote {file}" in err
        assert file.stat().st_size > 10_000
    assert "controllers:" in files["--report"].read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", ARM, "--plot", "a.gif"], ".png"),
        (["run", ARM, "--html", "{folder}"], "is a folder"),
        (["run", ARM, "--report", "{file}/a.html"], "cannot be made"),
        (["view", "nosuch"], "no robot named 'nosuch'"),
        (["view", "none.nc"], "the file does not exist"),
        (["view", "{torn}"], "not a readable NetCDF"),
        (["view", "{rollout}", "--robot", "none.urdf"], "no such file"),
        (["view", "{rollout}", "--lock", "q1"], "--lock"),
        (["view", "{rollout}", "--frame", "hand", "-o", "{folder}/a.html"], "no frame named 'hand'"),
        (["view", ARM, "--robot", ARM], "--robot"),
        (["view", ARM, "--port", "99999"], "65535"),
        (["view", ARM, "--open"], "no display"),
        (["report", "none.nc"], "the file does not exist"),
        (["report", "{torn}"], "not a readable NetCDF"),
        (["report", "{rollout}", "-o", "{folder}"], "is a folder"),
        (["report", "{rollout}", "{other}", "-o", "{folder}/a.html"], "different joints"),
    ],
)
def test_bad_input_is_an_error_of_ours(  # type: ignore[no-untyped-def]
    arguments: list[str], said: str, cli, rollout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    (tmp_path / "file").write_text("")
    (tmp_path / "torn.nc").write_bytes(rollout.read_bytes()[:5000])
    places = {name: tmp_path / name for name in ("file",)}
    robot = Robot.load(package(tmp_path / "p", a_stl=box_mesh("stl")))
    other = armgpi.save(run(robot, t_final=0.02), tmp_path / "other.nc")
    places |= {"folder": tmp_path, "torn": tmp_path / "torn.nc", "rollout": rollout, "other": other}
    code, err = cli(*(word.format(**places) for word in arguments))
    assert code == 2
    assert err.splitlines()[-1].startswith("error: ")
    assert said in err
    assert "Traceback" not in err


def test_a_taken_port_is_an_error_of_ours(cli) -> None:  # type: ignore[no-untyped-def]
    with Server("page", port=0) as server:
        code, err = cli("view", ARM, "--port", server.port)
    assert code == 2
    assert str(server.port) in err


def test_a_report_finds_its_robot_and_its_experiment_file(cli, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    assert cli("run", ARM, "--t-final", "0.05", "--out", tmp_path)[0] == 0
    code, err = cli("report", tmp_path / "rollout.nc", "-o", tmp_path / "r.html", "--title", "Mine")
    assert code == 0
    assert f"wrote {tmp_path / 'r.html'}" in err
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<title>Mine</title>" in html
    assert "Experiment file" in html
    assert cli("view", tmp_path / "rollout.nc", "-o", tmp_path / "v.html")[0] == 0


# Only one of the two may look for the first free port: run side by side, the second would take the port
# that the first has just given back, and answer there.
@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [["view", ARM, "--port", "0"], ["run", ARM, "--t-final", "0.02", "--view"]]
)
def test_ctrl_c_stops_the_server(arguments: list[str]) -> None:
    program = subprocess.Popen(
        [sys.executable, "-m", "armgpi.cli", *arguments],
        env={**os.environ, "SSH_CONNECTION": "10.0.0.1 5000 10.0.0.2 22"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout is not None
    lines = iter(program.stdout.readline, "")
    url = next(line for line in lines if line.startswith("http")).split()[0]
    assert f"{url.split(':')[2].rstrip('/')}:127.0.0.1:" in next(lines)  # the ssh -L line
    with urllib.request.urlopen(url) as answer:
        assert b"armgpi-data" in answer.read()
    program.send_signal(signal.SIGINT)
    _, err = program.communicate(timeout=200)
    assert program.returncode == 0
    assert "stopped" in err
    assert "Traceback" not in err
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url)


def test_ctrl_c_before_the_server_waits(cli, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    def interrupted(port: int) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(pictures, "_ssh", interrupted)
    code, err = cli("view", ARM, "--port", "0")
    assert code == 0
    assert err.strip() == "stopped"


def test_a_live_page_is_moved_by_a_program() -> None:
    robot = Robot.load(ARM)
    with Server(meshcat.robot_page(robot, live=True), port=0) as server:
        connection = socket.create_connection(("127.0.0.1", server.port), timeout=60)
        connection.sendall(f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        received = connection.makefile()
        while received.readline().strip():
            pass
        server.show([0.1, 0.2, 0.3], robot)
        assert received.readline() == "data: [0.1, 0.2, 0.3]\n"
        connection.close()


def test_a_browser_that_reads_nothing_costs_no_memory_and_then_sees_the_newest_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(meshcat, "_HEARTBEAT", 0.05)
    monkeypatch.setattr(meshcat._Handler, "timeout", 0.5)
    robot = Robot.load(ARM)
    request = b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    before = threading.active_count()
    with Server(meshcat.robot_page(robot, live=True), port=0) as server:
        asleep = socket.create_connection(("127.0.0.1", server.port), timeout=60)
        asleep.sendall(request)
        server.show([0.0, 0.0, 0.0], robot)
        tracemalloc.start()
        for k in range(20_000):
            server.show([1e-4 * k, 0.0, 0.0], robot)
        kept, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert kept < 100_000  # 20,000 poses are a megabyte
        late = socket.create_connection(("127.0.0.1", server.port), timeout=60)
        with late, late.makefile() as received:
            late.sendall(request)
            assert next(line for line in received if line.startswith("data:")) == "data: [1.9999, 0.0, 0.0]\n"
        asleep.close()
        # The threads of those who are gone end, though nothing moves any more.
        for _ in range(1200):
            if threading.active_count() <= before + 1:
                break
            time.sleep(0.05)
        assert threading.active_count() <= before + 1


def test_a_page_goes_through_a_link_and_into_a_device(tmp_path: Path) -> None:
    link = tmp_path / "link.html"
    link.symlink_to("real.html")
    meshcat.write("page", link)
    assert link.is_symlink()
    assert (tmp_path / "real.html").read_text() == "page"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        meshcat.write("page", pipe)
        assert os.read(reader, 99) == b"page"
    finally:
        os.close(reader)
    assert pipe.is_fifo()
