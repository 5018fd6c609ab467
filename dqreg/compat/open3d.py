"""Stand-in for ``open3d.pipelines.registration``: its ICP with dqreg's pose steps, all else handed on to Open3D.

One line changes a script over::

    from open3d.pipelines import registration      # before
    from dqreg.compat import open3d as registration  # after

`registration_icp`, `registration_generalized_icp`, `evaluate_registration` and
`get_information_matrix_from_point_clouds` are dqreg's; they take paths, arrays and tensor clouds as well, and a pose in
any form that `dqreg.register` takes. Normals that a method asks for and a cloud does not have are fitted to its
neighbours, where Open3D's point-to-plane raises. What dqreg does not do in them (estimation methods of Open3D alone, a
scale, given covariances) Open3D's own function does, with a warning that names it. Every other name (criteria,
estimation methods, robust kernels, RANSAC, pose graphs, ...) is Open3D's own object. They raise `InputError` where an
argument cannot be used: clouds that are not (n, 3), a distance that is not above 0, a pose that is not rigid, an
unknown method.

>>> cloud = np.random.default_rng(0).uniform(size=(500, 3))
>>> result = registration_icp(cloud + [0.01, 0, 0], cloud, 0.1)
>>> result.fitness, result.converged, (result.transformation[:3, 3].round(6) + 0.0).tolist()
(1.0, True, [-0.01, 0.0, 0.0])
>>> evaluate_registration(cloud, cloud, 0.1).fitness
1.0
"""

from __future__ import annotations

import dataclasses
import functools
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import (
    MAX_ROTATION_GAP,
    RIGID_TOLERANCE,
    FloatArray,
    IntArray,
    as_float,
    as_pose,
    pose_of,
    with_last_row,
)
from dqreg._open3d import load_open3d
from dqreg._statuses import NO_POSE
from dqreg.compat.estimation import (
    FEWEST_PAIRS,
    STEPS,
    Method,
    TransformationEstimationDualQuaternion,
    TransformationEstimationDualQuaternionNormals,
    read_method,
)
from dqreg.compat.sides import GivenClouds, is_empty, read_sides
from dqreg.errors import InputError
from dqreg.icp import Correspondences, Icp, Stopping, WithinDistance, find_correspondences
from dqreg.icp.history import Iteration
from dqreg.rigid._algebra import cross_matrix

__all__ = [
    "TransformationEstimationDualQuaternion",
    "TransformationEstimationDualQuaternionNormals",
    "evaluate_registration",
    "get_information_matrix_from_point_clouds",
    "registration_generalized_icp",
    "registration_icp",
]

# So many times what its columns are off a rotation in shape is their common length off 1: that is a scale.
SCALED_RATIO = 10.0


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    theirs = load_open3d().pipelines.registration
    if not hasattr(theirs, name):
        raise AttributeError(f"neither module {__name__!r} nor open3d.pipelines.registration has {name!r}")
    return getattr(theirs, name)


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in dir(load_open3d().pipelines.registration) if len(name) > 1)})


def registration_icp(
    source: Any,
    target: Any,
    max_correspondence_distance: float,
    init: ArrayLike | None = None,
    estimation_method: Any = None,
    criteria: Any = None,
) -> Any:
    """ICP with the call, the stopping rule and the figures of ``open3d.pipelines.registration.registration_icp``.

    Robust kernels of the method weigh the residuals that it minimises. Each step is solved to its minimum (Open3D
    takes one Gauss-Newton step). Target normals that point-to-plane lacks are fitted to the neighbours. The result is
    an Open3D ``RegistrationResult`` with ``converged`` and ``num_iterations`` beside; where nothing is found it holds
    the initial pose and zeros, as Open3D's does: `dqreg.register` says so instead.

    ``with_scaling=True``, `TransformationEstimationSymmetric`, `TransformationEstimationForColoredICP` and an initial
    pose with a scale are handed on to Open3D's function: clouds and result are Open3D's then.
    """
    if undone := _undone(estimation_method, init, "init"):
        return _handed_on(
            "registration_icp", undone, source, target, max_correspondence_distance,
            init=init, estimation_method=estimation_method, criteria=criteria,
        )  # fmt: skip
    return _icp(source, target, max_correspondence_distance, init, read_method(estimation_method), criteria)


def registration_generalized_icp(
    source: Any,
    target: Any,
    max_correspondence_distance: float,
    init: ArrayLike | None = None,
    estimation_method: Any = None,
    criteria: Any = None,
) -> Any:
    """Generalised ICP with the call of ``open3d.pipelines.registration.registration_generalized_icp``.

    Discs stand on the normals of both clouds; those that are missing are fitted to the neighbours. Clouds with
    covariances of their own are handed on to Open3D's function, as is an initial pose with a scale.
    """
    undone = _undone(estimation_method, init, "init")
    if any(getattr(cloud, "has_covariances", bool)() for cloud in (source, target)):
        undone = "generalised ICP with covariances that a cloud holds"
    if undone:
        return _handed_on(
            "registration_generalized_icp", undone, source, target, max_correspondence_distance,
            init=init, estimation_method=estimation_method, criteria=criteria,
        )  # fmt: skip
    method = read_method(estimation_method, "generalised")
    return _icp(source, target, max_correspondence_distance, init, method, criteria)


def evaluate_registration(
    source: Any, target: Any, max_correspondence_distance: float, transformation: ArrayLike | None = None
) -> Any:
    """Fitness, error and correspondences of a pose, as ``open3d.pipelines.registration.evaluate_registration``."""
    if undone := _undone(None, transformation, "transformation"):
        return _handed_on(
            "evaluate_registration", undone, source, target, max_correspondence_distance, transformation=transformation
        )
    reach = _reach(max_correspondence_distance)
    T = np.eye(4) if transformation is None else as_pose(transformation, "transformation")
    if is_empty(source) or is_empty(target):
        return _result(T)
    sides = read_sides(source, target, with_normals=False)
    return _figures(sides, find_correspondences(sides.scan, sides.surface, T), reach)


def get_information_matrix_from_point_clouds(
    source: Any, target: Any, max_correspondence_distance: float, transformation: ArrayLike
) -> FloatArray:
    """Information of a pose by the count and the places of its correspondences, (6, 6), as Open3D's.

    It knows neither noise nor the surface: sliding along a plane counts as much as leaving it. For a pose graph,
    `Registration.information_in` says more.
    """
    name = "get_information_matrix_from_point_clouds"
    if undone := _undone(None, transformation, "transformation"):
        return np.asarray(
            _handed_on(name, undone, source, target, max_correspondence_distance, transformation=transformation)
        )
    reach, T = _reach(max_correspondence_distance), as_pose(transformation, "transformation")
    if is_empty(source) or is_empty(target):
        return np.zeros((6, 6))
    sides = read_sides(source, target, with_normals=False)
    pairs = find_correspondences(sides.scan, sides.surface, T)
    q = pairs.closest.points[pairs.distances <= reach]
    J = np.concatenate([-cross_matrix(q), np.broadcast_to(np.eye(3), (len(q), 3, 3))], axis=2)
    return np.asarray(np.einsum("kij,kil->jl", J, J))


def _undone(method: Any, T: ArrayLike | None, name: str) -> str:
    """What a call asks for that Open3D does and dqreg does not; empty where there is nothing."""
    kind = type(method).__name__
    if getattr(method, "with_scaling", False):
        return f"{kind}(with_scaling=True)"
    if isinstance(method, load_open3d().pipelines.registration.TransformationEstimation) and kind not in STEPS:
        return kind
    return "a pose with a scale" if T is not None and _is_scaled(T, name) else ""


def _is_scaled(value: ArrayLike, name: str) -> bool:
    """Whether a matrix is a rotation times a scale; what is rounded, sheared or no matrix at all is not."""
    T = with_last_row(as_float(pose_of(value), name))
    if T.shape != (4, 4) or not np.isfinite(T).all() or not 0.0 < np.linalg.det(T[:3, :3]) < np.inf:
        return False
    square = T[:3, :3].T @ T[:3, :3]
    scale = float(np.trace(square) / 3.0)
    off = float(np.abs(square / scale - np.eye(3)).max())
    return off <= MAX_ROTATION_GAP and abs(scale - 1.0) > max(SCALED_RATIO * off, RIGID_TOLERANCE)


def _handed_on(name: str, undone: str, source: Any, target: Any, reach: Any, **options: Any) -> Any:
    """What Open3D's own function of that name gives."""
    open3d = load_open3d()
    for cloud, side in ((source, "source"), (target, "target")):
        if not isinstance(cloud, open3d.geometry.PointCloud):
            raise InputError(f"{undone} is left to Open3D, whose {side} is a PointCloud; got {type(cloud).__name__}")
    warnings.warn(f"{undone} is not of dqreg: Open3D's own {name} does it", UserWarning, stacklevel=3)
    for key in ("init", "transformation"):
        if options.get(key) is not None:
            options[key] = with_last_row(as_float(pose_of(options[key]), key))
    given = {key: value for key, value in options.items() if value is not None}
    return getattr(open3d.pipelines.registration, name)(source, target, _reach(reach), **given)


def _icp(source: Any, target: Any, reach: Any, init: ArrayLike | None, method: Method, criteria: Any) -> Any:
    limits, reach = _criteria(criteria), _reach(reach)
    T = np.eye(4) if init is None else as_pose(init, "init")
    if is_empty(source) or is_empty(target):
        return _result(T)
    sides = read_sides(source, target, with_normals=method.with_normals)
    records: list[Iteration] = []

    def goes_on(record: Iteration) -> object:
        # The figures of a record are those before its step.
        records.append(record)
        before = records[-2] if len(records) > 1 else None
        met = (
            before is not None
            and abs(before.pairs - record.pairs) / sides.source_count < limits.relative_fitness
            and abs(before.rms - record.rms) < limits.relative_rmse
        )
        return not met

    # One iteration more than steps, for the figures after the last one; Open3D's criteria end it, and no other.
    most = limits.max_iteration + 1
    icp = Icp(
        method.estimator,
        rejectors=(WithinDistance(reach),),
        stopping=Stopping(convergence=-1.0, iterations=most, patience=most),
        accelerate=False,
        fewest=FEWEST_PAIRS,
    )
    run = icp.run(sides.scan, sides.surface, T, goes_on)
    steps = len(run.history) - (0 if run.status in NO_POSE else 1)
    result = _figures(sides, run.pairs, reach)
    result.num_iterations, result.converged = steps, run.status == "stopped by observer"
    return result


def _figures(sides: GivenClouds, pairs: Correspondences, reach: float) -> Any:
    near = pairs.distances <= reach
    distances = pairs.distances[near]
    rows: IntArray = np.column_stack([sides.source_rows[near], sides.target_rows[pairs.closest.elements[near]]])
    rmse = float(np.sqrt(np.mean(distances**2))) if len(distances) else 0.0
    return _result(pairs.T_target_source, len(distances) / sides.source_count, rmse, rows)


@functools.cache
def _result_class() -> Any:
    base = load_open3d().pipelines.registration.RegistrationResult

    def line(self: Any) -> str:
        pairs, ended = len(self.correspondence_set), "converged" if self.converged else "not converged"
        return (
            f"RegistrationResult(fitness={self.fitness:.4g}, inlier_rmse={self.inlier_rmse:.4g}, {pairs} "
            f"correspondences, {ended} after {self.num_iterations} iterations)"
        )

    return type("RegistrationResult", (base,), {"converged": False, "num_iterations": 0, "__repr__": line})


def _result(T: FloatArray, fitness: float = 0.0, rmse: float = 0.0, rows: IntArray | None = None) -> Any:
    result = _result_class()()
    result.transformation, result.fitness, result.inlier_rmse = T, fitness, rmse
    if rows is not None:
        result.correspondence_set = load_open3d().utility.Vector2iVector(rows.astype(np.int32).reshape(-1, 2))
    return result


@dataclasses.dataclass(frozen=True)
class _Criteria:
    relative_fitness: float = 1e-6
    relative_rmse: float = 1e-6
    max_iteration: int = 30


def _criteria(criteria: Any) -> _Criteria:
    if criteria is None:
        return _Criteria()
    try:
        found = _Criteria(float(criteria.relative_fitness), float(criteria.relative_rmse), int(criteria.max_iteration))
    except AttributeError as error:
        raise InputError(f"criteria must be an ICPConvergenceCriteria; got {type(criteria).__name__}") from error
    if found.max_iteration < 0:
        raise InputError(f"max_iteration must be at least 0; got {found.max_iteration}")
    return found


def _reach(value: Any) -> float:
    if not isinstance(value, (int, float, np.floating, np.integer)) or not 0.0 < value < np.inf:
        raise InputError(f"max_correspondence_distance must be a length above 0; got {value!r}")
    return float(value)
