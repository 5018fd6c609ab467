from __future__ import annotations

import gc
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule

HERE = Path(__file__).parent

# Side by side, each worker takes one core: threads on top would only wait for each other.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One more than there are cores: tests that wait for processes and signals leave a core idle."""
    return (os.cpu_count() or 1) + 1


class Doctests:
    """They are looked for in files of the package that have some, and in no test: each name there takes its time."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
        found = yield
        if file_path.is_relative_to(HERE) or b">>>" not in file_path.read_bytes():
            return [each for each in found if not isinstance(each, DoctestModule)]
        return found


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Doctests())


def pytest_collection_finish() -> None:
    """What is there by now stays: whoever collects garbage later, as comparisons do, need not look through it."""
    gc.collect()
    gc.freeze()
    # Trees of syntax and Hypothesis's strategies are many small objects and no garbage.
    gc.set_threshold(20_000, 20, 20)


# Run by hand, with atheris; see its first lines.
collect_ignore = ["hostile/fuzz_readers.py"]


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a report with a sixteenth of their pixels: for laws about the rest, which takes less time."""
    monkeypatch.setattr("dqreg.report.page.PANEL_WIDTH", 190)
    monkeypatch.setattr("dqreg.report.page.PANEL_HEIGHT", 135)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real scans; the test is skipped where they are not."""
    beside = Path(__file__).parents[1].parent / "shared" / "data"
    folder = Path(os.environ.get("DQREG_DATA") or beside)
    if not folder.is_dir():
        pytest.skip("real scans are not here: set DQREG_DATA")
    return folder
