"""The one door to Open3D: its shared libraries are made ready first, and a failure says what is missing."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import os
import platform
import re
import signal
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from dqreg.errors import InputError, MissingDependencyError

# Debian and Ubuntu packages that hold the system libraries which Open3D's Linux wheels need.
APT_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libidn2.so.0": "libidn2-0",
    "libudev.so.1": "libudev1",
    "libstdc++.so.6": "libstdc++6",
}

# Open3D's module of plots for notebooks, and what its package takes from it.
PLOTS = "open3d.visualization.draw_plotly"
PLOT_FUNCTIONS = ("get_plotly_fig", "draw_plotly", "draw_plotly_server")


@functools.cache
def load_open3d() -> ModuleType:
    """Open3D, imported once, quiet, with the libraries it needs loaded before it."""
    try:
        os.getcwd()  # noqa: PTH109 - asked, not used
    except FileNotFoundError:
        # A library below it would end the whole process.
        raise InputError("the working folder was deleted; change to another one") from None
    _preload_libusb()
    # Its web viewer writes three lines into every notebook, and nothing here uses it.
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    try:
        with _uninterrupted(), _plots_deferred():
            open3d = importlib.import_module("open3d")
    except Exception as error:
        # A wheel that does not fit NumPy or the system fails in its own ways; each means that there is no Open3D.
        raise MissingDependencyError(explain(error)) from error
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    # Its pool of threads, unlike BLAS, OpenMP and our own kernels, does not look there by itself.
    asked = os.environ.get("OMP_NUM_THREADS", "")
    if asked.isdecimal() and int(asked) > 0 and hasattr(open3d.utility, "set_max_threads"):
        open3d.utility.set_max_threads(min(int(asked), os.cpu_count() or 1))
    return open3d


def explain(error: BaseException) -> str:
    """Say what keeps Open3D from loading and which command mends it."""
    library = re.search(r"(lib[\w+.-]+\.so[.\d]*): cannot open shared object", str(error))
    if library:
        name = library.group(1)
        package = APT_PACKAGES.get(name)
        remedy = f"apt-get install {package}" if package else f"apt-file search {name}, then install that package"
        return f"Open3D cannot load: the system library {name} is missing; run: {remedy}"
    missing = (error.name or "") if isinstance(error, ModuleNotFoundError) else ""
    # A part of Open3D that is missing is no package of its own: the wheel is damaged.
    if missing and not missing.startswith("open3d."):
        package = _wheel() if missing == "open3d" else missing.partition(".")[0]
        return f"Open3D cannot load: the Python package {package!r} is missing; run: pip install {package}"
    return f"Open3D cannot load: {error}; run: pip install --force-reinstall {_wheel()}"


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    # Ctrl-C in the middle of Open3D's own start looks like a broken wheel; it is delivered right after.
    if "open3d" in sys.modules or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _plots_deferred() -> Iterator[None]:
    # For three functions that draw in notebooks Open3D loads Dash, Plotly and IPython: half of the time of its start
    # and 40 MB in each process. They are loaded when one of the three is first called.
    if PLOTS in sys.modules or "open3d" in sys.modules:
        yield
        return
    standing = _LatePlots(PLOTS)
    sys.modules[PLOTS] = standing
    try:
        yield
    except BaseException:
        if sys.modules.get(PLOTS) is standing:
            del sys.modules[PLOTS]
        raise


class _LatePlots(ModuleType):
    """Stands for Open3D's module of plots until something of it is used."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        for function in PLOT_FUNCTIONS:
            setattr(self, function, functools.partial(self._call, function))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._load(), name)

    def _call(self, function: str, *args: Any, **options: Any) -> Any:
        return getattr(self._load(), function)(*args, **options)

    def _load(self) -> ModuleType:
        if sys.modules.get(PLOTS) is self:
            del sys.modules[PLOTS]
        loaded = importlib.import_module(PLOTS)
        # As if it had been loaded from the first: the functions of the package are those of the module.
        package = importlib.import_module(PLOTS.rpartition(".")[0])
        for function in PLOT_FUNCTIONS:
            setattr(package, function, getattr(loaded, function))
        return loaded


def _wheel() -> str:
    # The same choice as in pyproject.toml: the two wheels unpack into one folder and must not meet.
    on_linux = sys.platform == "linux" and platform.machine() == "x86_64"
    return "open3d-cpu" if on_linux else "open3d"


def _preload_libusb() -> None:
    # The wheel libusb-package carries a library of the same SONAME; once loaded for all, Open3D's own look-up finds it.
    try:
        libusb_package = importlib.import_module("libusb_package")
        path = libusb_package.get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        return  # the system may have libusb itself; if not, Open3D's own error names it
