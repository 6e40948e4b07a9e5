"""A headless Chromium for tests of pages, spoken to over a pipe (the DevTools protocol).

No port is opened and no package needed. What the page writes to the console and what it asks the network for
are kept, so that tests can say that there was neither an error nor a request.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    # Whatever a page asks for elsewhere is not found.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
PATIENCE = 60.0
#: Starts a program with two descriptors as its 3 and 4 (a shell cannot do it for those above 9).
_LAUNCH = """
import os, sys
for number, descriptor in (1, 1000), (2, 1001):
    os.dup2(int(sys.argv[number]), descriptor)
for descriptor, wanted in (1000, 3), (1001, 4):
    os.dup2(descriptor, wanted)
    os.close(descriptor)
os.execv(sys.argv[3], sys.argv[3:])
"""


def program() -> str | None:
    """Return a browser that is installed."""
    return next((found for name in PROGRAMS if (found := shutil.which(name))), None)


class Page:
    """A page in the browser.

    Attributes:
        errors: what went wrong: exceptions, and errors on the console.
        requests: addresses asked for.
    """

    def __init__(self, browser: Browser, session: str) -> None:
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._browser = browser
        self._session = session

    def eval(self, code: str) -> Any:
        """Return the value of an expression; of a promise, what it becomes."""
        answer = self.call("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise AssertionError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def wait(self, condition: str, patience: float = PATIENCE) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + patience
        while not self.eval(f"Boolean({condition})"):
            if time.monotonic() > end:
                raise AssertionError(f"still not so: {condition}; errors: {self.errors}")
            time.sleep(0.05)

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol."""
        return self._browser.call(method, parameters, self._session)

    def screenshot(self, path: Path | None = None) -> bytes:
        """Return the page as it looks, PNG."""
        image = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(image)
        return image

    def key(self, key: str, code: str | None = None, text: str = "") -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            extra = {"text": text} if text and kind == "keyDown" else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code or key, **extra)

    def size(self, width: int, height: int, mobile: bool = False) -> None:
        """Set the size of the window."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )


class Browser:
    """A browser that runs until it is closed."""

    def __init__(self, size: tuple[int, int] = (1000, 700)) -> None:
        found = program()
        assert found is not None
        self._size = size
        self._folder = tempfile.mkdtemp(prefix="armgpi-browser-")
        to_child, self._send = os.pipe()
        self._receive, from_child = os.pipe()
        command = [found, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={self._folder}", "about:blank"]
        # The browser reads from descriptor 3 and writes to 4.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCH, str(to_child), str(from_child), *command],
            pass_fds=(to_child, from_child),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(to_child)
        os.close(from_child)
        self._count = 0
        self._answers: dict[int, queue.Queue[Any]] = {}
        self._pages: dict[str, Page] = {}
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, daemon=True).start()

    def open(self, address: str | Path, ready: str = "document.readyState === 'complete'") -> Page:
        """Open a page and wait until it is ready."""
        url = address.resolve().as_uri() if isinstance(address, Path) else address
        target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        page = self._pages[session] = Page(self, session)
        for domain in ("Page", "Runtime", "Network", "Log"):
            page.call(f"{domain}.enable")
        page.size(*self._size)
        page.call("Page.navigate", url=url)
        page.wait(f"location.href !== 'about:blank' && ({ready})")
        return page

    def call(self, method: str, parameters: dict[str, Any] | None = None, session: str | None = None) -> Any:
        """Call a method of the protocol and return its answer."""
        with self._lock:
            self._count += 1
            number = self._count
            self._answers[number] = queue.Queue()
            message = {"id": number, "method": method, "params": parameters or {}}
            if session is not None:
                message["sessionId"] = session
            content = json.dumps(message).encode() + b"\0"
            while content:
                content = content[os.write(self._send, content) :]
        answer = self._answers[number].get(timeout=PATIENCE)
        del self._answers[number]
        if "error" in answer:
            raise AssertionError(f"{method}: {answer['error']}")
        return answer["result"]

    def close(self) -> None:
        """End the browser and remove its folder."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._send)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _listen(self) -> None:
        """Hand answers to who waits for them, and keep what pages did wrong or asked for."""
        rest = b""
        while block := os.read(self._receive, 1 << 20):
            *messages, rest = (rest + block).split(b"\0")
            for message in map(json.loads, messages):
                if "id" in message:
                    self._answers[message["id"]].put(message)
                elif (page := self._pages.get(message.get("sessionId", ""))) is not None:
                    self._note(page, message["method"], message["params"])
        os.close(self._receive)

    @staticmethod
    def _note(page: Page, method: str, event: dict[str, Any]) -> None:
        """Keep an event of a page."""
        if method == "Runtime.exceptionThrown":
            details = event["exceptionDetails"]
            page.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and event["type"] in ("error", "assert"):
            page.errors.append(" ".join(str(x.get("value", x.get("description"))) for x in event["args"]))
        elif method == "Log.entryAdded" and event["entry"]["level"] == "error":
            page.errors.append(event["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            page.requests.append(event["request"]["url"])
