"""A headless Chromium, driven over its own pipe: no library, no port, no network."""

from __future__ import annotations

import base64
import io
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
FLAGS = ("--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--disable-dev-shm-usage", "--no-first-run",
         "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-extensions", "--disable-sync",
         "--disable-background-networking", "--disable-component-update", "--hide-scrollbars")  # fmt: skip

# Seconds after which a browser hangs: drawing without a graphics card it had none to spare on a machine of eight loads.
PATIENCE = 120.0
# Frames after which an element rests at last.
STILL = 200

# Chromium reads commands from descriptor 3 and answers on 4; a shell cannot hand over numbers above 9.
HAND_OVER = """
import os, sys
there, back = (os.dup2(int(fd), spare) for fd, spare in zip(sys.argv[1:3], (100, 101)))
os.dup2(there, 3); os.dup2(back, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    def __init__(self, profile: Path) -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        assert CHROMIUM is not None
        self.process = subprocess.Popen(
            [sys.executable, "-ISc", HAND_OVER, str(theirs_in), str(theirs_out), CHROMIUM, *FLAGS,
             f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._in, self._out, self._buffer, self._number = ours_in, ours_out, b"", 0
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.page(f"{domain}.enable")

    def close(self) -> None:
        try:
            self.call("Browser.close")
        finally:
            self.process.wait(timeout=20)
            os.close(self._in)
            os.close(self._out)

    def call(self, method: str, session: str | None = None, **params: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next(PATIENCE)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def page(self, method: str, **params: Any) -> dict[str, Any]:
        return self.call(method, self._session, **params)

    def _next(self, seconds: float) -> dict[str, Any]:
        end = time.monotonic() + seconds
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], max(0.0, end - time.monotonic()))
            part = os.read(self._in, 1 << 20) if ready else b""
            if not part:
                raise RuntimeError("chromium does not answer")
            self._buffer += part
        head, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(head)

    def open(self, path: Path, width: int, height: int, *, dark: bool = False, phone: bool = False) -> None:
        self.page("Emulation.setDeviceMetricsOverride", width=width, height=height, mobile=phone,
                  deviceScaleFactor=2 if phone else 1)  # fmt: skip
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.page("Emulation.setEmulatedMedia", features=scheme)
        self.events.clear()
        self.page("Page.navigate", url=path.absolute().as_uri())
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._next(PATIENCE))
        self.settle()

    def settle(self) -> None:
        """Wait until two frames are drawn."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def run(self, script: str) -> Any:
        found = self.page("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"])
        return found["result"].get("value")

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, scrolled into the middle of the window, where it rests there."""
        place, before = f"document.querySelector({json.dumps(selector)})", None
        for _ in range(STILL):
            self.run(f"{place}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
            rect = self.run(f"(r => [r.left, r.top, r.width, r.height])({place}.getBoundingClientRect())")
            # The page scrolls smoothly to what was clicked, for many frames: until then the place is not where it was.
            if rect == before:
                break
            before = rect
            self.settle()
        return tuple(rect)

    def click(self, selector: str) -> None:
        """A real click of the mouse in the middle of an element."""
        left, top, width, height = self.box(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.page("Input.dispatchMouseEvent", type=kind, x=left + width / 2, y=top + height / 2, button="left",
                      clickCount=1)  # fmt: skip
        self.settle()

    def drag(self, selector: str, dx: float, dy: float) -> None:
        left, top, width, height = self.box(selector)
        x, y = left + width / 2, top + height / 2
        for kind, at in (
            ("mousePressed", (x, y)),
            ("mouseMoved", (x + dx, y + dy)),
            ("mouseReleased", (x + dx, y + dy)),
        ):
            self.page("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=1, clickCount=1)
        self.settle()

    def image(self, selector: str) -> np.ndarray:
        """Pixels of an element as they are seen, (h, w, 3)."""
        from PIL import Image

        left, top, width, height = self.box(selector)
        self.settle()
        png = self.page("Page.captureScreenshot", format="png")["data"]
        seen = np.asarray(Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB"))
        ratio = self.run("devicePixelRatio")
        rows, columns = (
            slice(int(max(top, 0) * ratio), int((top + height) * ratio)),
            slice(int(left * ratio), int((left + width) * ratio)),
        )
        return seen[rows, columns]

    def image_once(self, holds: Callable[[np.ndarray], bool], selector: str, seconds: float = 20.0) -> np.ndarray:
        """The first image for which something holds, or the last one: a frame within the page draws in its own time."""
        end = time.monotonic() + seconds
        while not holds(image := self.image(selector)) and time.monotonic() < end:
            time.sleep(0.05)
        return image

    def whole(self) -> bytes:
        """The whole page as a PNG."""
        return base64.b64decode(self.page("Page.captureScreenshot", format="png", captureBeyondViewport=True)["data"])

    def pdf(self) -> bytes:
        return base64.b64decode(self.page("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])

    def complaints(self) -> list[str]:
        """Errors and warnings of the console, of scripts, and of the network."""
        said = []
        for event in self.events:
            kind, params = event.get("method"), event.get("params", {})
            if kind == "Runtime.exceptionThrown":
                said.append(str(params["exceptionDetails"]))
            elif kind == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning"):
                said.append(str(params["args"]))
            elif kind == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                said.append(params["entry"]["text"])
        return said

    def fetched(self) -> list[str]:
        """Addresses that were asked for, but for the file itself and what stands in it."""
        asked = (
            event["params"]["request"]["url"]
            for event in self.events
            if event.get("method") == "Network.requestWillBeSent"
        )
        return [url for url in asked if not url.startswith(("file:", "data:"))]
