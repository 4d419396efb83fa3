# SPDX-License-Identifier: MIT
"""A page in headless Chromium, by the DevTools protocol over two pipes: no port, no package."""

import base64
import fcntl
import itertools
import json
import os
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any

SHOWN = """new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"""


class Browser:
    """One browser with one tab. `problems` has errors of the page and messages of its console,
    `requests` the addresses that it asked for.
    """

    def __init__(self, program: str, profile: Path) -> None:
        words = (
            f"--headless=new --no-sandbox --disable-gpu --no-first-run --user-data-dir={profile}"
        )
        words += " --disable-background-networking --disable-dev-shm-usage --remote-debugging-pipe"
        commands, self._write = os.pipe()
        self._read, answers = os.pipe()
        far = [fcntl.fcntl(one, fcntl.F_DUPFD, 100) for one in (commands, answers)]
        self._process = subprocess.Popen(  # it reads from file 3 and writes to file 4
            ["bash", "-c", f'exec "$@" 3<&{far[0]} 4>&{far[1]}', "bash", program, *words.split()],
            pass_fds=far,
            stderr=subprocess.DEVNULL,
        )
        for one in (commands, answers, *far):
            os.close(one)
        self._numbers, self._buffer = itertools.count(1), b""
        self._events: list[dict[str, Any]] = []
        self.problems: list[str] = []
        self.requests: list[str] = []
        self._session = ""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Network", "DOM", "Log"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> "Browser":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._write)
        os.close(self._read)
        self._process.kill()
        self._process.wait()

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            more = os.read(self._read, 1 << 20)
            assert more, "the browser has ended"
            self._buffer += more
        message, _, self._buffer = self._buffer.partition(b"\0")
        received: dict[str, Any] = json.loads(message)
        self._note(received.get("method", ""), received.get("params", {}))
        return received

    def _note(self, event: str, about: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.problems.append(str(about["exceptionDetails"]))
        if event == "Runtime.consoleAPICalled":
            self.problems.append(str(about["args"]))
        if event == "Log.entryAdded":
            self.problems.append(str(about["entry"]))
        if event == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])

    def call(self, method: str, **about: Any) -> dict[str, Any]:
        """Call a method of the protocol; return its result."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": about}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != number:
            self._events.append(answer)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def open(self, page: Path, width: int = 1280, dark: bool = False) -> None:
        """Load a page at a width in CSS pixels; one below 600 is that of a phone."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self._events.clear()
        self.call("Page.navigate", url=page.as_uri())
        while not any(one.get("method") == "Page.loadEventFired" for one in self._events):
            self._events.append(self._receive())
        self.settle()

    def settle(self) -> None:
        """Wait until the page has drawn what it was asked for."""
        self.run(SHOWN)

    def run(self, script: str) -> Any:
        """Return the value of an expression, or that of its promise."""
        words = {"awaitPromise": True, "returnByValue": True, "userGesture": True}
        answer = self.call("Runtime.evaluate", expression=script, **words)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press and release a key, such as ArrowRight."""
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Tab": 9}[key]
        for kind in ("keyDown", "keyUp"):
            words = {"type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code}
            self.call("Input.dispatchKeyEvent", **words)
        self.settle()

    def choose_file(self, selector: str, file: Path) -> None:
        """Give a file to an input of the page."""
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", nodeId=node, files=[str(file)])

    def picture(self, file: Path) -> None:
        """Write a picture of the whole page."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        file.write_bytes(base64.b64decode(data))
