from __future__ import annotations

import ctypes
import importlib
import platform
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest

from dqreg._open3d import APT_PACKAGES, explain, load_open3d
from dqreg.errors import DqregError, MissingDependencyError

CANNOT = "cannot open shared object file: No such file or directory"


@pytest.fixture
def closed_gate() -> Iterator[None]:
    """`dqreg._open3d` as in a fresh process; what it learns in the test is forgotten after it."""
    load_open3d.cache_clear()
    yield
    load_open3d.cache_clear()


def failing_import(monkeypatch: pytest.MonkeyPatch, **failures: BaseException) -> None:
    real = importlib.import_module

    def import_module(name: str, *arguments: Any) -> ModuleType:
        if name in failures:
            raise failures[name]
        return real(name, *arguments)

    monkeypatch.setattr(importlib, "import_module", import_module)


@pytest.mark.parametrize(("library", "package"), APT_PACKAGES.items())
def test_each_library_names_its_package(library: str, package: str) -> None:
    sentence = explain(ImportError(f"{library}: {CANNOT}"))
    expected = f"the system library {library} is missing; run: apt-get install {package}"
    assert sentence == f"Open3D cannot load: {expected}"


def test_an_unknown_library_is_searched_for() -> None:
    sentence = explain(OSError(f"libfoo-bar+x_1.so.12.3: {CANNOT}"))
    assert (
        "the system library libfoo-bar+x_1.so.12.3 is missing; run: apt-file search libfoo-bar+x_1.so.12.3" in sentence
    )


def test_a_missing_package_is_installed() -> None:
    sentence = explain(ModuleNotFoundError("No module named 'addict'", name="addict"))
    assert sentence == "Open3D cannot load: the Python package 'addict' is missing; run: pip install addict"


@pytest.mark.parametrize(("machine", "on_linux"), [("x86_64", True), ("aarch64", False)])
def test_the_missing_wheel_is_the_one_that_dqreg_wants(
    monkeypatch: pytest.MonkeyPatch, machine: str, on_linux: bool
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(platform, "machine", lambda: machine)
    sentence = explain(ModuleNotFoundError("No module named 'open3d'", name="open3d"))
    wheel = "open3d-cpu" if on_linux else "open3d"
    assert sentence == f"Open3D cannot load: the Python package '{wheel}' is missing; run: pip install {wheel}"


def test_a_part_of_a_package_is_mended_by_its_package() -> None:
    sentence = explain(ModuleNotFoundError("No module named 'open3d.cpu.pybind'", name="open3d.cpu.pybind"))
    assert "pip install --force-reinstall" in sentence


@pytest.mark.parametrize("error", [ImportError("something else"), OSError("wrong ELF class"), ModuleNotFoundError("?")])
def test_any_other_failure_is_quoted(error: BaseException) -> None:
    sentence = explain(error)
    assert sentence.startswith(f"Open3D cannot load: {error}; run: pip install --force-reinstall ")


@pytest.mark.usefixtures("closed_gate")
@pytest.mark.parametrize(
    "error",
    [
        ImportError(f"libGL.so.1: {CANNOT}"),
        OSError(f"libGL.so.1: {CANNOT}"),
        ModuleNotFoundError("No module named 'open3d'", name="open3d"),
        RuntimeError("Unable to cast Python instance"),
    ],
)
def test_the_gate_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    failing_import(monkeypatch, open3d=error)
    with pytest.raises(MissingDependencyError) as caught:
        load_open3d()
    assert str(caught.value) == explain(error)
    assert caught.value.__cause__ is error
    assert isinstance(caught.value, DqregError)


@pytest.mark.usefixtures("closed_gate")
def test_a_failure_is_not_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        failing_import(patch, open3d=ImportError("not yet"))
        with pytest.raises(MissingDependencyError):
            load_open3d()
    assert load_open3d().__name__ == "open3d"


@pytest.mark.usefixtures("closed_gate")
@pytest.mark.parametrize("error", [ImportError("gone"), OSError("wrong ELF class")])
def test_a_system_library_may_stand_in_for_the_wheel(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    load_open3d()
    load_open3d.cache_clear()
    failing_import(monkeypatch, libusb_package=error)
    assert load_open3d().__name__ == "open3d"


@pytest.mark.usefixtures("closed_gate")
def test_the_wheel_may_hold_no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    libusb_package = pytest.importorskip("libusb_package")
    opened: list[str] = []
    monkeypatch.setattr(libusb_package, "get_library_path", lambda: None)
    monkeypatch.setattr(ctypes, "CDLL", lambda name, **_: opened.append(name))
    assert load_open3d().__name__ == "open3d"
    assert opened == []


@pytest.mark.usefixtures("closed_gate")
def test_libusb_is_opened_for_all_before_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("libusb_package")
    order: list[str] = []
    real = importlib.import_module
    monkeypatch.setattr(ctypes, "CDLL", lambda name, mode: order.append(f"libusb {mode == ctypes.RTLD_GLOBAL}"))
    monkeypatch.setattr(importlib, "import_module", lambda name: (order.append(name), real(name))[1])
    load_open3d()
    assert order == ["libusb_package", "libusb True", "open3d"]


def test_open3d_is_loaded_once_and_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    open3d = load_open3d()
    assert open3d is load_open3d()
    assert open3d.utility.get_verbosity_level() == open3d.utility.VerbosityLevel.Error
    open3d.io.read_point_cloud("no_such_scan.pcd")
    assert capfd.readouterr() == ("", "")


def test_importing_the_gate_loads_nothing() -> None:
    code = "import sys, dqreg._open3d; sys.exit('open3d' in sys.modules or 'libusb_package' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


DRAWN = """
import sys
from dqreg._open3d import load_open3d
open3d = load_open3d()
assert not {"dash", "plotly", "IPython"} & set(sys.modules)
assert not hasattr(sys.modules["open3d.visualization.draw_plotly"], "__file__")
"""
CALLED = """
box = open3d.geometry.TriangleMesh.create_box()
figure = open3d.visualization.get_plotly_fig([box])
assert len(figure.data[0].i) == 12
"""
TAKEN = """
from open3d.visualization.draw_plotly import get_mesh_object
"""
AS_IF_FROM_THE_FIRST = """
module = sys.modules["open3d.visualization.draw_plotly"]
assert module.__file__ and module.__spec__.name == module.__name__
assert open3d.visualization.draw_plotly is module.draw_plotly
assert open3d.visualization.get_plotly_fig is module.get_plotly_fig
"""


@pytest.mark.parametrize("use", [CALLED, TAKEN], ids=["called", "taken"])
def test_what_draws_in_notebooks_is_loaded_when_it_is_used_and_then_as_open3d_does(use: str) -> None:
    found = subprocess.run([sys.executable, "-c", DRAWN + use + AS_IF_FROM_THE_FIRST], check=False, capture_output=True)
    assert found.returncode == 0, found.stderr.decode()
