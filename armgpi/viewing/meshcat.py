"""The MeshCat page of an arm or a rollout: as one file, or served to this machine alone.

MeshCat's own server listens on all addresses without a password, so it is not used: the page holds MeshCat's
viewer and everything it shows, and :class:`Server` hands it out on the loopback address only.
"""

from __future__ import annotations

import json
import os
import threading
import webbrowser
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from armgpi.base import files
from armgpi.base.arrays import ArrayLike, as_joint_array, check_whole
from armgpi.base.escape import counted
from armgpi.errors import ArmgpiError, ParameterError, Remedy
from armgpi.robot.robot import Robot
from armgpi.viewing import page, scene

if TYPE_CHECKING:
    import xarray as xr

#: The only address that a page is served on.
LOOPBACK = "127.0.0.1"
#: First port tried when none is given, and how many after it.
_FIRST_PORT, _PORTS = 7070, 50
#: Longest time that a browser may leave unread what is sent, and time after which it hears from a live page
#: on which nothing moves [s].
_PATIENCE, _HEARTBEAT = 10.0, 5.0


class ServerError(ArmgpiError):
    """A page that cannot be served.

    Attributes:
        port: the port asked for.
    """

    def __init__(self, port: int, reason: str) -> None:
        """Say which port cannot be had and why."""
        self.port = port
        self.remedies = (Remedy("port"),)
        super().__init__(f"port {port} of {LOOPBACK} cannot be used: {reason}; choose another port")


def robot_page(*robots: Robot, frame: str | None = None, live: bool = False) -> str:
    """Return a page that shows a robot, or several side by side, with a slider for every joint.

    Args:
        robots: the arms, at least one.
        frame: the tool; the tip when not given.
        live: whether a :class:`Server` shall move the first one.

    Raises:
        ParameterError: without a robot, or when one is a batch.
    """
    if not robots:
        raise ParameterError("robots", robots, "at least one Robot")
    arms = [scene.build(robot, frame) for robot in robots]
    arrays = page.Arrays()
    data = {"arm": page.beside(arms, arrays), "clip": None, "live": live, "autoplay": False}
    findings = [finding for arm in arms for finding in arm.findings]
    return _fill_page(data, arrays, ", ".join(robot.name for robot in robots), findings)


def rollout_page(rollout: xr.Dataset, robot: Robot | None = None, *, frame: str | None = None) -> str:
    """Return a page that plays a rollout, or several at once.

    Args:
        rollout: the rollout(s).
        robot: the arm; the one that the rollout was made with when not given.
        frame: the tool; the tip when not given.

    Raises:
        RolloutError: when the robot is not found any more, or is another one.
    """
    arm = scene.build(scene.robot_of(rollout) if robot is None else robot, frame)
    clip = scene.clip(rollout, arm.robot)
    arrays = page.Arrays()
    data = {
        "arm": page.arm_data(arm, arrays),
        "clip": page.clip_data(clip, arrays),
        "live": False,
        "autoplay": True,
    }
    findings = list(arm.findings)
    if clip.left_out:
        findings.append(f"{counted(clip.left_out, 'further rollout')} not shown")
    return _fill_page(data, arrays, str(rollout.attrs.get("robot", arm.robot.name)), findings)


def write(html: str, path: str | PathLike[str]) -> Path:
    """Write a page to a file; it appears whole or not at all.

    Raises:
        RolloutError: when the file cannot be written.
    """
    return files.write(path, html)


class Server:
    """Serves a page on 127.0.0.1, from a thread of its own, until it is closed.

    A context manager. Requests that name another host are refused, so that no page of another site reaches it
    by a name that leads here.

    Attributes:
        port: the port it listens on.
        url: where the page is.
    """

    def __init__(self, html: str, port: int | None = None) -> None:
        """Serve a page.

        Args:
            html: the page.
            port: where, 0 for any; when not given, the first free one from 7070 on, and any where the next
                ones are taken.

        Raises:
            ParameterError: when the port is no whole number from 0 to 65535.
            ServerError: when it is taken, or may not be used.
        """
        if port is not None:
            port = check_whole(port, "port", 0, 65535)
        ports = [port] if port is not None else [*range(_FIRST_PORT, _FIRST_PORT + _PORTS), 0]
        for candidate in ports:
            try:
                self._server = _Loopback(candidate, html.encode())
                break
            except OSError as error:
                reason = error.strerror or str(error)
        else:
            raise ServerError(ports[-1], reason)
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True, name="armgpi view")
        self._thread.start()

    def show(
        self,
        q: ArrayLike,
        robot: Robot,
        texts: Mapping[str, str] | None = None,
        counts: Mapping[str, int] | None = None,
    ) -> None:
        """Move the arm of a live page.

        Args:
            q: joint positions (n,) [rad or m].
            robot: the arm.
            texts: what else to say, each with its name.
            counts: a histogram: name -> how many.
        """
        configuration = as_joint_array(q, "q", robot.joint_names).tolist()
        said = {"q": configuration, "texts": dict(texts or {}), "counts": dict(counts or {})}
        self._server.latest.put(json.dumps(configuration if texts is None else said))

    def open(self) -> bool:
        """Open the page in a browser; False where there is none."""
        try:
            return webbrowser.open(self.url)
        except webbrowser.Error:
            return False

    def wait(self) -> None:
        """Serve until interrupted."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """Stop serving."""
        self._server.latest.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> Server:
        """Return the server, which runs already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop serving."""
        self.close()


class _Latest:
    """The newest configuration; older ones are dropped, so that a slow or dead browser costs no memory."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._text, self._count, self._closed = "", 0, False

    def put(self, text: str) -> None:
        """Replace the newest configuration, and wake those who wait for one."""
        with self._changed:
            self._text, self._count = text, self._count + 1
            self._changed.notify_all()

    def close(self) -> None:
        """Let nobody wait any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def after(self, seen: int) -> tuple[int, str]:
        """Wait for a newer one than the `seen`-th, for a while.

        Returns:
            Its number and text: no text when there was none, -1 when there will be none any more.
        """
        with self._changed:
            newer = self._changed.wait_for(lambda: self._closed or self._count > seen, _HEARTBEAT)
            if self._closed:
                return -1, ""
            return (self._count, self._text) if newer else (seen, "")


class _Loopback(ThreadingHTTPServer):
    """A server of one page, whose requests end with the program.

    Attributes:
        page: what it hands out.
        latest: the configuration that live pages show.
    """

    daemon_threads = True
    # On Windows this would let two programs share a port.
    allow_reuse_address = os.name == "posix"

    def __init__(self, port: int, page: bytes) -> None:
        self.page = page
        self.latest = _Latest()
        super().__init__((LOOPBACK, port), _Handler)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET for a server's page and for what moves it."""

    server: _Loopback
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Send the page, or configurations as they come; refuse requests that name another host."""
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        if host not in (LOOPBACK, "localhost"):
            self.send_error(403, "only for this machine")
        elif self.path == "/":
            self.send_response(200)
            self._headers("text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(self.server.page)))
            self.end_headers()
            self.wfile.write(self.server.page)
        elif self.path == "/live":
            self.send_response(200)
            self._headers("text/event-stream")
            self.end_headers()
            # Configurations as they come, until the page goes away or the server is closed.
            seen, text = self.server.latest.after(0)
            while seen >= 0:
                # A line that begins with a colon says nothing, and fails when the browser is gone.
                self.wfile.write(f"data: {text}\n\n".encode() if text else b":\n\n")
                self.wfile.flush()
                seen, text = self.server.latest.after(seen)
        else:
            self.send_error(404)

    def _headers(self, kind: str) -> None:
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("X-Frame-Options", "DENY")

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""

    def handle(self) -> None:
        """Answer; a browser that goes away is no error."""
        try:
            super().handle()
        except OSError:  # or that reads nothing for too long
            self.close_connection = True


def _fill_page(data: dict[str, Any], arrays: page.Arrays, title: str, findings: Any) -> str:
    """Return the page that shows a scene alone."""
    values = {"title": page.text(title), "findings": page.bullets(findings, "findings")}
    scripts = [page.meshcat_script(), page.asset("scene.js"), page.asset("view.js")]
    return page.fill("view.html", values, data, arrays, scripts)
