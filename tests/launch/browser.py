"""Headless Chromium for tests of pages: loads one, runs JavaScript in it, and takes pictures."""

import base64
import io
import itertools
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATH = next(filter(None, map(shutil.which, NAMES)), None)
NONE = "there is no Chromium: apt-get install chromium (Debian), and see that it is on the PATH"

_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
    # WebGL in software: there need be no GPU.
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--remote-debugging-port=0",
)  # fmt: skip
_SECONDS = 60.0


class Browser:
    """One page in a Chromium of its own.

    Attributes:
      problems: what went wrong in the page so far: errors on its console, exceptions.
      requests: addresses that it asked for.
    """

    def __init__(self, address: str, size: tuple[int, int] = (1280, 720), *, dark: bool = False):
        """Loads the address in a window of that many pixels, width and height.

        Args:
          dark: whether the person wants pages to be dark.
        """
        assert PATH
        self._folder = tempfile.TemporaryDirectory()
        words = [PATH, *_FLAGS, f"--user-data-dir={self._folder.name}", "about:blank"]
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(words, stdout=quiet, stderr=quiet)
        self._socket = connect(self._debugger(), max_size=None)
        self._numbers = itertools.count(1)
        self.problems: list[str] = []
        self.requests: list[str] = []
        for domain in ("Runtime", "Log", "Page", "Network"):
            self._ask(f"{domain}.enable")
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=size[0], height=size[1], deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._ask("Emulation.setEmulatedMedia", features=[scheme])
        self._ask("Page.navigate", url=address)

    def _debugger(self) -> str:
        port_file = Path(self._folder.name) / "DevToolsActivePort"
        end = time.monotonic() + _SECONDS
        while time.monotonic() < end:
            try:
                port = port_file.read_text().split()[0]
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                    return next(t for t in json.load(answer) if t["type"] == "page")[
                        "webSocketDebuggerUrl"
                    ]
            except (OSError, IndexError, StopIteration):
                time.sleep(0.1)
        raise TimeoutError(f"{PATH} did not start")

    def _ask(self, method: str, **values: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": values}))
        while True:
            told = json.loads(self._socket.recv(timeout=_SECONDS))
            if told.get("id") == number:
                assert "error" not in told, told
                return told["result"]
            self._note(told)

    def _note(self, told: dict[str, Any]) -> None:
        what, how = told.get("method"), told.get("params", {})
        if what == "Runtime.exceptionThrown":
            self.problems.append(json.dumps(how["exceptionDetails"]))
        elif what == "Log.entryAdded" and how["entry"]["level"] == "error":
            self.problems.append(how["entry"]["text"])
        elif what == "Runtime.consoleAPICalled" and how["type"] in ("error", "assert"):
            self.problems.append(json.dumps(how["args"]))
        elif what == "Network.requestWillBeSent":
            self.requests.append(how["request"]["url"])

    def run(self, script: str) -> Any:
        """What a JavaScript expression comes to."""
        told = self._ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in told, told
        return told["result"].get("value")

    def wait_for(self, script: str) -> None:
        """Waits until a JavaScript expression is true."""
        end = time.monotonic() + _SECONDS
        while not self.run(f"document.body && Boolean({script})"):
            assert time.monotonic() < end, f"never true: {script}; {self.problems}"
            time.sleep(0.2)

    def picture(self) -> np.ndarray:
        """What is to be seen, uint8 [height, width, 3]."""
        data = base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def mouse(self, kind: str, x: float, y: float, *, pressed: bool) -> None:
        """kind: mouseMoved, mousePressed or mouseReleased; the left button."""
        self._ask(
            "Input.dispatchMouseEvent",
            type=kind, x=x, y=y, button="left", buttons=int(pressed), clickCount=1,
        )  # fmt: skip

    def close(self) -> None:
        """Ends this Chromium."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(_SECONDS)
        self._folder.cleanup()
