"""Twin of ``open3d.pipelines.registration`` for ICP: the same calls, names and figures, with dqreg's pose steps.

One line changes a script over::

    from open3d.pipelines import registration      # before
    from dqreg.compat import open3d as registration  # after

Open3D's own estimation and criteria objects are taken as well, so that even they need not be changed.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_pose
from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, as_geometry
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes
from dqreg.geometry.objects import recognise
from dqreg.icp import ESTIMATORS, Correspondences, Icp, Stopping, WithinDistance, find_correspondences
from dqreg.icp.history import Iteration
from dqreg.solvers.status import NO_POSE


@dataclasses.dataclass(frozen=True)
class Sides:
    """Source and target."""

    scan: Scan  # The source, every finite point of it, in the caller's order
    surface: CloudSurface  # The target
    # source_rows, target_rows: Rows that the finite points had in the caller's clouds
    source_rows: IntArray
    target_rows: IntArray
    source_count: int  # Points of the caller's source, finite or not


def read_sides(source: Any, target: Any, *, with_normals: bool) -> Sides:
    """Read both clouds."""
    moving, source_rows, count = _cloud(source, "source")
    standing, target_rows, _ = _cloud(target, "target")
    return Sides(_scan(moving, with_normals), CloudSurface(standing), source_rows, target_rows, count)


def _cloud(value: Any, name: str) -> tuple[PointCloud, IntArray, int]:
    geometry = as_geometry(value, name)
    if isinstance(geometry, Mesh):
        raise InputError(f"{name} is a mesh; this call is for two clouds, as in Open3D. Use dqreg.register for meshes")
    count = len(geometry) + geometry.dropped
    if not geometry.dropped or isinstance(value, PointCloud):
        return geometry, np.arange(len(geometry)), len(geometry)
    points, normals = _raw(value)
    finite = np.isfinite(points).all(axis=1)
    if normals is not None:
        finite &= np.isfinite(normals).all(axis=1) & normals.any(axis=1)
    return geometry, np.flatnonzero(finite), count


def _raw(value: Any) -> tuple[FloatArray, FloatArray | None]:
    found = recognise(value, "a cloud")
    assert not isinstance(found, Mesh)
    return found.points, found.normals


def _scan(cloud: PointCloud, with_normals: bool) -> Scan:
    count = len(cloud)
    normals, levers, residuals = np.zeros((count, 3)), np.zeros(count), np.full(count, np.nan)
    if with_normals:
        fits = fit_planes(NeighbourTree(cloud.points), cloud.points, cloud.points)
        known = np.asarray(np.isfinite(fits.normals).all(axis=1))
        fitted = np.where(known[:, None], fits.normals, 0.0)
        normals = fitted if cloud.normals is None else cloud.normals
        levers, residuals = np.where(known, fits.lever, 0.0), fits.residuals
    return Scan(
        points=cloud.points,
        normals=normals,
        levers=levers,
        residuals=residuals,
        fitted=np.arange(count) if with_normals else np.zeros(0, dtype=np.int64),
        oriented=with_normals and cloud.normals is not None,
        spacing=0.0,
        noise=0.0,
        total=count,
    )


__all__ = [
    "ICPConvergenceCriteria",
    "RegistrationResult",
    "TransformationEstimationDualQuaternion",
    "TransformationEstimationDualQuaternionNormals",
    "TransformationEstimationPointToPlane",
    "TransformationEstimationPointToPoint",
    "evaluate_registration",
    "registration_icp",
]

# A pose has six unknowns: fewer pairs than this fix none, whatever the step.
FEWEST_PAIRS = 3


@dataclasses.dataclass(frozen=True)
class ICPConvergenceCriteria:
    """When to stop: both changes below their limit (absolute ones, as in Open3D), or so many iterations."""

    relative_fitness: float = 1e-6
    relative_rmse: float = 1e-6
    max_iteration: int = 30

    def __post_init__(self) -> None:
        if not self.relative_fitness >= 0.0 or not self.relative_rmse >= 0.0 or self.max_iteration < 1:
            raise InputError(
                "relative_fitness and relative_rmse must be at least 0 and max_iteration at least 1; got "
                f"{self.relative_fitness!r}, {self.relative_rmse!r} and {self.max_iteration!r}"
            )


@dataclasses.dataclass(frozen=True)
class TransformationEstimationDualQuaternion:
    """Walker, Shao and Volz's closed form on points: the least squares of Open3D's point-to-point."""

    step: str = dataclasses.field(default="dq-points", init=False)


@dataclasses.dataclass(frozen=True)
class TransformationEstimationDualQuaternionNormals:
    """The same closed form on points and normals; normals that a cloud lacks are fitted to its neighbours."""

    step: str = dataclasses.field(default="dq", init=False)


@dataclasses.dataclass(frozen=True)
class TransformationEstimationPointToPlane:
    """Points to the target's tangent planes, solved to the end at each iteration."""

    step: str = dataclasses.field(default="plane", init=False)


@dataclasses.dataclass(frozen=True)
class TransformationEstimationPointToPoint:
    """Open3D's name for least squares between points: solved by the dual-quaternion closed form."""

    with_scaling: bool = False
    step: str = dataclasses.field(default="dq-points", init=False)


# What Open3D's own objects ask for.
FOREIGN = {"TransformationEstimationPointToPoint": "dq-points", "TransformationEstimationPointToPlane": "plane"}


@dataclasses.dataclass(frozen=True, eq=False)
class RegistrationResult:
    """What Open3D's result holds, under the same names."""

    # (4, 4): T_target_source; all NaN where no pose was found (Open3D returns where it began)
    transformation: FloatArray
    fitness: float  # Share of the source's points with a target point within the distance
    inlier_rmse: float  # Root mean square distance of those; NaN where there are none (Open3D says 0)
    correspondence_set: np.ndarray[Any, np.dtype[np.int32]]  # (k, 2): Their rows in source and target
    converged: bool = False  # Whether the criteria were met
    num_iterations: int = 0  # Steps taken


def registration_icp(
    source: Any,
    target: Any,
    max_correspondence_distance: float,
    init: ArrayLike | None = None,
    estimation_method: Any = None,
    criteria: Any = None,
) -> RegistrationResult:
    """ICP with the call, the stopping rule and the figures of ``open3d.pipelines.registration.registration_icp``."""
    step, limits, reach = _step(estimation_method), _criteria(criteria), _reach(max_correspondence_distance)
    T = np.eye(4) if init is None else as_pose(init, "init")
    sides = read_sides(source, target, with_normals=step == "dq")
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
        ESTIMATORS[step],
        rejectors=(WithinDistance(reach),),
        stopping=Stopping(convergence=-1.0, iterations=most, patience=most),
        accelerate=False,
        fewest=FEWEST_PAIRS,
    )
    run = icp.run(sides.scan, sides.surface, T, goes_on)
    lost = run.status in NO_POSE
    steps = len(run.history) - (0 if lost else 1)
    result = dataclasses.replace(_figures(sides, run.pairs, reach), num_iterations=steps)
    if lost and steps < limits.max_iteration:
        return dataclasses.replace(result, transformation=np.full((4, 4), np.nan))
    return dataclasses.replace(result, converged=run.status == "stopped by observer")


def evaluate_registration(
    source: Any, target: Any, max_correspondence_distance: float, transformation: ArrayLike | None = None
) -> RegistrationResult:
    """Fitness, error and correspondences of a pose, as ``open3d.pipelines.registration.evaluate_registration``."""
    reach = _reach(max_correspondence_distance)
    T = np.eye(4) if transformation is None else as_pose(transformation, "transformation")
    sides = read_sides(source, target, with_normals=False)
    return _figures(sides, find_correspondences(sides.scan, sides.surface, T), reach)


def _figures(sides: Sides, pairs: Correspondences, reach: float) -> RegistrationResult:
    near = pairs.distances <= reach
    distances = pairs.distances[near]
    rows: IntArray = np.column_stack([sides.source_rows[near], sides.target_rows[pairs.closest.elements[near]]])
    return RegistrationResult(
        transformation=pairs.T_target_source,
        fitness=len(distances) / sides.source_count,
        inlier_rmse=float(np.sqrt(np.mean(distances**2))) if len(distances) else np.nan,
        correspondence_set=rows.astype(np.int32).reshape(-1, 2),
    )


def _step(method: Any) -> str:
    if method is None:
        return "dq-points"
    if getattr(method, "with_scaling", False):
        raise InputError("with_scaling=True asks for a scale; dqreg solves for proper motions only. Scale the source")
    own = getattr(method, "step", None) if type(method).__module__ == __name__ else FOREIGN.get(type(method).__name__)
    if own is None:
        names = [name for name in __all__ if name.startswith("TransformationEstimation")]
        raise InputError(f"unknown estimation method {type(method).__name__}; known are {', '.join(names)}")
    return str(own)


def _criteria(criteria: Any) -> ICPConvergenceCriteria:
    if criteria is None:
        return ICPConvergenceCriteria()
    try:
        return ICPConvergenceCriteria(
            float(criteria.relative_fitness), float(criteria.relative_rmse), int(criteria.max_iteration)
        )
    except AttributeError as error:
        raise InputError(f"criteria must be an ICPConvergenceCriteria; got {type(criteria).__name__}") from error


def _reach(value: Any) -> float:
    if not isinstance(value, (int, float, np.floating, np.integer)) or not 0.0 < value < np.inf:
        raise InputError(f"max_correspondence_distance must be a length above 0; got {value!r}")
    return float(value)
