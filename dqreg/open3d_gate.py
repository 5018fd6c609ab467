"""The one door to Open3D: its shared libraries are made ready first, and a failure says what is missing."""

from __future__ import annotations

import ctypes
import functools
import importlib
import re
from types import ModuleType

from dqreg.errors import MissingDependencyError

# Debian and Ubuntu packages that hold the system libraries which Open3D's Linux wheels need.
APT_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libudev.so.1": "libudev1",
    "libstdc++.so.6": "libstdc++6",
}


@functools.cache
def load_open3d() -> ModuleType:
    """Open3D, imported once, quiet, with the libraries it needs loaded before it.

    Returns
    -------
    module
        ``open3d``.

    Raises
    ------
    MissingDependencyError
        If the package or one of its shared libraries is absent; the message names it and the command that brings it.

    Examples
    --------
    >>> load_open3d().__name__
    'open3d'
    """
    _preload_libusb()
    try:
        open3d = importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise MissingDependencyError(explain(error)) from error
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def explain(error: BaseException) -> str:
    """Say what keeps Open3D from loading and which command mends it.

    Parameters
    ----------
    error : BaseException
        What importing Open3D raised.

    Returns
    -------
    str
        One sentence with the missing part and the command.

    Examples
    --------
    >>> explain(ImportError("libGL.so.1: cannot open shared object file: No such file or directory"))
    'Open3D cannot load: the system library libGL.so.1 is missing; run: apt-get install libgl1'
    """
    library = re.search(r"(lib[\w+.-]+\.so[.\d]*): cannot open shared object", str(error))
    if library:
        name = library.group(1)
        package = APT_PACKAGES.get(name)
        remedy = f"apt-get install {package}" if package else f"apt-file search {name}, then install that package"
        return f"Open3D cannot load: the system library {name} is missing; run: {remedy}"
    if isinstance(error, ModuleNotFoundError):
        return f"Open3D cannot load: the Python package {error.name!r} is missing; run: pip install {error.name}"
    return f"Open3D cannot load: {error}; run: pip install --force-reinstall dqreg"


def _preload_libusb() -> None:
    # The wheel libusb-package carries a library of the same SONAME; once loaded for all, Open3D's own look-up finds it.
    try:
        libusb_package = importlib.import_module("libusb_package")
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        return  # the system may have libusb itself; if not, Open3D's own error names it
