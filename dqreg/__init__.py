"""Registers scans to CAD meshes and clouds.

The dual-quaternion closed form of Walker, Shao and Volz (1991), for matched points and directions, inside an ICP loop
whose correspondences are exact: closest points on triangles for meshes, nearest neighbours for clouds.

>>> import dqreg
>>> fit = dqreg.solve([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [2, 0, 0], [1, 1, 0]])
>>> fit.T_target_source[:3, 3].round(12).tolist()
[1.0, 0.0, 0.0]
"""

from __future__ import annotations

import importlib

from dqreg import errors

# Every type checker takes this name for true; `typing` itself is a third of what this file costs.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from dqreg import compare as compare
    from dqreg import compat as compat
    from dqreg import files as files
    from dqreg import geometry as geometry
    from dqreg import inspection as inspection
    from dqreg import multiway as multiway
    from dqreg import odometry as odometry
    from dqreg import registration as registration
    from dqreg import rigid as rigid
    from dqreg import solvers as solvers
    from dqreg import synth as synth
    from dqreg import trust as trust
    from dqreg.errors import DegenerateGeometryError, DqregError, InputError, MissingDependencyError, UnitsError
    from dqreg.geometry import Mesh, PointCloud
    from dqreg.multiway import Multiway, register_many
    from dqreg.odometry import Odometry
    from dqreg.registration.register import register
    from dqreg.registration.result.result import Registration
    from dqreg.registration.target import Target, prepare_target
    from dqreg.rigid import DualQuaternion, Trajectory, quaternion
    from dqreg.solvers import Freedom, PoseCost, likelihood_weights, solve, solve_many

__all__ = [
    "DegenerateGeometryError",
    "DqregError",
    "DualQuaternion",
    "Freedom",
    "InputError",
    "Mesh",
    "MissingDependencyError",
    "Multiway",
    "Odometry",
    "PointCloud",
    "PoseCost",
    "Registration",
    "Target",
    "Trajectory",
    "UnitsError",
    "likelihood_weights",
    "prepare_target",
    "quaternion",
    "register",
    "register_many",
    "solve",
    "solve_many",
    "solvers",
]

__version__ = "0.1.0"

# Rooms that `import dqreg` alone makes reachable.
_ROOMS = (
    "compare",
    "compat",
    "errors",
    "files",
    "geometry",
    "inspection",
    "multiway",
    "odometry",
    "registration",
    "rigid",
    "solvers",
    "synth",
    "trust",
)
# Where each public name lives. It is imported at its first use: SciPy takes a third of a second.
_HOMES = {
    "DegenerateGeometryError": "dqreg.errors",
    "DqregError": "dqreg.errors",
    "DualQuaternion": "dqreg.rigid",
    "Freedom": "dqreg.solvers",
    "InputError": "dqreg.errors",
    "Mesh": "dqreg.geometry",
    "MissingDependencyError": "dqreg.errors",
    "Multiway": "dqreg.multiway",
    "Odometry": "dqreg.odometry",
    "PointCloud": "dqreg.geometry",
    "PoseCost": "dqreg.solvers",
    "Registration": "dqreg.registration.result.result",
    "Target": "dqreg.registration.target",
    "Trajectory": "dqreg.rigid",
    "UnitsError": "dqreg.errors",
    "likelihood_weights": "dqreg.solvers",
    "prepare_target": "dqreg.registration.target",
    "quaternion": "dqreg.rigid",
    "register": "dqreg.registration.register",
    "register_many": "dqreg.multiway",
    "solve": "dqreg.solvers",
    "solve_many": "dqreg.solvers",
}
# Old places of public names, which still have them, with a warning: the room where each was, and where it lives now.
_MOVED = {
    "dqreg.trust": dict.fromkeys(
        ("Band", "Bands", "Deviations", "Place", "Summary", "colours_of", "measure_deviations", "why_unsigned"),
        "dqreg.inspection",
    )
}


if not TYPE_CHECKING:
    # Hidden from type checkers, to whom it would say that any name exists.
    def __getattr__(name: str) -> object:
        if name in _ROOMS:
            return importlib.import_module(f"{__name__}.{name}")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}{_hint(name)}")
        found = getattr(importlib.import_module(_HOMES[name]), name)
        globals()[name] = found
        return found


def _moved(room: str, name: str) -> object:
    home = _MOVED[room][name]
    errors.warn_of_old_name(f"{room}.{name}", f"{home}.{name}")
    return getattr(importlib.import_module(home), name)


# No room looks upward: they are handed what finds their old names.
errors.MOVED.update({(room, name): _moved for room, names in _MOVED.items() for name in names})


def __dir__() -> list[str]:
    # What this file itself needs is no name of the package.
    return sorted({*__all__, *_ROOMS, *(name for name in globals() if name.startswith("__"))})


def _hint(name: str) -> str:
    from dqreg.errors import did_you_mean

    return did_you_mean(name, () if name.startswith("__") else (*__all__, *_ROOMS))
