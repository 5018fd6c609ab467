"""A page as a file: HTML, or PDF as the Chromium, Chrome or Edge of this computer prints it."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from dqreg.errors import InputError, MissingDependencyError
from dqreg.files.atomic import require_writable, write_atomically

# The browser to use where it is not on the path, or not the one on it.
VARIABLE = "DQREG_BROWSER"
# The paper of a PDF where it is not A4.
PAPER, PAPERS = "DQREG_PAPER", ("a4", "letter")
NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge",
    "microsoft-edge-stable", "brave-browser",
)  # fmt: skip
# Where macOS and Windows keep them, off the path.
PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
# The page is drawn by the processor alone: a computer without a display prints the same.
FLAGS = (
    "--headless=new", "--no-first-run", "--no-pdf-header-footer", "--disable-extensions", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--virtual-time-budget=20000",
)  # fmt: skip
MAX_PRINT_SECONDS = 180.0


def paper() -> str:
    """Size of the paper, from the environment."""
    name = os.environ.get(PAPER, "").lower() or "a4"
    if name not in PAPERS:
        raise InputError(f"{PAPER} must be {' or '.join(PAPERS)}; got {name!r:.60}")
    return name


def page_path(path: str | os.PathLike[str]) -> Path:
    """Path of a page that can be written; asked before the work. It ends in .html, .htm, .pdf, or in nothing."""
    goal = require_writable(path)
    ending = goal.suffix.lower()
    if ending not in ("", ".html", ".htm", ".pdf"):
        raise InputError(f"cannot write {goal}: a report ends in .html or .pdf; got {ending!r}")
    if ending == ".pdf":
        browser()
        paper()
    return goal


def write_page(path: str | os.PathLike[str], html: str) -> Path:
    """Write a page, whole or not at all; one that ends in .pdf is printed."""
    goal = page_path(path)
    write_atomically(goal, page_content(goal, html))
    return goal


def page_content(path: Path, html: str) -> str | bytes:
    """What a file of that name holds: the page itself, or the page in print."""
    return to_pdf(html) if path.suffix.lower() == ".pdf" else html


def browser() -> str:
    """The browser that prints; `MissingDependencyError` where there is none."""
    given = os.environ.get(VARIABLE)
    if given:
        found = shutil.which(given)
        if found is None:
            raise MissingDependencyError(f"{VARIABLE} names no program that can be run: {given!r}")
        return found
    for name in (*NAMES, *PLACES):
        found = shutil.which(name)
        if found is not None:
            return found
    raise MissingDependencyError(
        f"a PDF is printed by Chromium, Chrome or Edge, and none is found; install one, name it in {VARIABLE}, or "
        "write the report as .html and print that from a browser"
    )


def to_pdf(html: str) -> bytes:
    """The page in print."""
    program = browser()
    with tempfile.TemporaryDirectory(prefix="dqreg-", ignore_cleanup_errors=True) as folder:
        page, printed = Path(folder) / "page.html", Path(folder) / "page.pdf"
        # The last rule counts; what is laid out by the width of the paper is so by this one.
        html = html.replace("</head>", f"<style>@page {{ size: {paper()}; }}</style></head>", 1)
        page.write_text(html, encoding="utf-8", errors="backslashreplace")
        # A browser of the administrator refuses to start in its sandbox.
        flags = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        command = [
            program,
            *FLAGS,
            *flags,
            f"--user-data-dir={folder}/profile",
            f"--print-to-pdf={printed}",
            page.as_uri(),
        ]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=MAX_PRINT_SECONDS, check=False
            )
            why = f"exit code {done.returncode}"
        except subprocess.TimeoutExpired:
            why = f"no answer within {MAX_PRINT_SECONDS:g} s"
        except OSError as error:
            why = error.strerror or str(error)
        try:
            found = printed.read_bytes()
        except OSError:
            found = b""
    if not found.startswith(b"%PDF"):
        raise MissingDependencyError(
            f"{program} printed no PDF ({why}); name another browser in {VARIABLE}, or write the report as .html and "
            "print that"
        )
    return found
