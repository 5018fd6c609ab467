"""A studio that runs as a user starts it, and a browser in front of it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.report.browser import CHROMIUM

ROOT = Path(__file__).parents[2]
BRACKET = ROOT / "datasets_synth" / "bracket"
# The drawing without a graphics card, as on a build machine.
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
DESK, PHONE = {"width": 1280, "height": 860}, {"width": 390, "height": 844}
# Pictures of the documentation are written where this names a folder.
PICTURES = os.environ.get("DQREG_PICTURES")
WAIT = 240_000


@contextlib.contextmanager
def running(*words: str | Path) -> Iterator[str]:
    """`dqreg studio` as a process of its own; its address."""
    command = [sys.executable, "-m", "dqreg", "studio", "--no-browser", "--quiet", *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), process.stderr and process.stderr.read()
        yield address
    finally:
        process.send_signal(signal.SIGINT)
        try:
            _, words = process.communicate(timeout=60)
            # Ctrl-C is how it ends: no error to its user.
            assert (process.returncode, words) == (0, "")
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise


@contextlib.contextmanager
def browsing() -> Iterator[Any]:
    """A headless Chromium."""
    if CHROMIUM is None:
        pytest.skip("no Chromium to open the studio with")
    playwright = pytest.importorskip("playwright.sync_api", reason="the page is driven with playwright")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(browser: Any, address: str, size: dict[str, int] = DESK, **options: Any) -> Iterator[Any]:
    """The page, ready to be used; whatever it complains of fails the test at the end."""
    context = browser.new_context(viewport=size, **options)
    page = context.new_page()
    page.set_default_timeout(WAIT)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None
    )
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    page.wait_for_selector("body[data-ready]")
    page.complaints = complaints
    yield page
    origin = address.split("/")[2]
    assert [url for url in asked if origin not in url and not url.startswith(("data:", "blob:"))] == []
    # Refusals of the server are sentences on the page; the browser's own line about them is none of ours.
    assert [words for words in complaints if "status of 4" not in words and "status of 5" not in words] == []
    context.close()


def said(page: Any) -> str:
    """The sentence at the foot of the page."""
    return str(page.inner_text("#said"))


def busy_over(page: Any) -> None:
    """Wait until nothing runs."""
    page.wait_for_selector("#busy", state="detached")


def drop(page: Any, *files: Path, on: str = "#main3d") -> None:
    """Files dropped on an element, as from a file manager."""
    import base64

    known = [{"name": file.name, "data": base64.b64encode(file.read_bytes()).decode()} for file in files]
    page.evaluate(
        """([files, on]) => {
          const carried = new DataTransfer();
          const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
          for (const {name, data} of files) carried.items.add(new File([bytes(data)], name));
          const options = {dataTransfer: carried, bubbles: true, cancelable: true};
          document.querySelector(on).dispatchEvent(new DragEvent("drop", options));
        }""",
        [known, on],
    )


def click_at(page: Any, stage: str, point: Any, side: str) -> None:
    """Click the place of the canvas where a point of a side is drawn."""
    x, y = page.evaluate(
        """([stage, point, side]) => {
          const view = stage === "main" ? studio.stage : studio.second;
          const {middle, size} = studio.results[side].frame, rect = view.canvas.getBoundingClientRect();
          const [x, y] = view.toScreen(point.map((v, k) => (v - middle[k]) / size));
          return [rect.left + x, rect.top + y];
        }""",
        [stage, list(map(float, point)), side],
    )
    page.mouse.click(x, y)


def keep_picture(page: Any, name: str) -> None:
    """A screenshot, where the documentation wants it."""
    page.wait_for_timeout(400)
    if PICTURES:
        page.screenshot(path=str(Path(PICTURES) / f"{name}.png"))
