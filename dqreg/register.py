"""The front door: from a scan and a target to the pose, how sure it is, and why."""

from __future__ import annotations

import contextlib
import dataclasses
import numbers
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from dqreg.answer import Outcome, for_caller, from_work, to_work
from dqreg.arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.geometry.prepare import Scan, prepare_scan
from dqreg.icp import COARSE, ESTIMATORS, Plan, Stopping, run_graduated
from dqreg.records import Alternative, Iteration
from dqreg.result import Registration
from dqreg.start import PairTable, search
from dqreg.target import CentredSource, IndexedTarget, centre_source, describe, index_target

# Points of the last level.
EFFORTS: dict[str, int | None] = {"fast": 20_000, "normal": 60_000, "best": None}
# Largest distance of a pair, in diagonals of the smaller of source and target.
REACH = 0.2


@dataclasses.dataclass(frozen=True)
class Target:
    """A target prepared once and registered to often; safe to share between threads.

    Made by `prepare_target`.
    """

    indexed: IndexedTarget

    @cached_property
    def pairs(self) -> PairTable:
        """What the search for a start looks up; built when first needed, the same whoever builds it."""
        return PairTable.of(self.indexed.geometry, self.indexed.surface)

    def register(self, scan: Any, start: Any = None, **options: Any) -> Registration:
        """Register a scan to this target; see `register` for the options.

        Parameters
        ----------
        scan : path, array or object
            Source.
        start : None, "identity" or (4, 4) array_like
            Where to begin.
        **options
            Keyword options of `register`.

        Returns
        -------
        Registration
            The answer.
        """
        return register(scan, self, start, **options)


def prepare_target(target: Any) -> Target:
    """Read a target and build its trees, to register many scans to it.

    Parameters
    ----------
    target : path, array, PointCloud, Mesh, Open3D or trimesh object
        A mesh or a cloud.

    Returns
    -------
    Target
        Pass it to `register` as the target, or call its own ``register``.

    Raises
    ------
    InputError
        If it cannot be read or used.

    Examples
    --------
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import bracket
    >>> prepare_target(Mesh(*bracket())).indexed.kind
    'mesh'
    """
    indexed = index_target(target)
    _ = indexed.surface
    return Target(indexed)


@dataclasses.dataclass(frozen=True)
class Options:
    """Checked options of one registration."""

    method: str
    max_distance: float | None
    max_angle_deg: float
    effort: str
    seed: int
    accelerate: bool
    max_iterations: int
    tolerance: float

    def __post_init__(self) -> None:
        known = ("auto", *ESTIMATORS)
        if self.method not in known:
            raise InputError(f"unknown method {self.method!r}; known are {', '.join(known)}")
        if self.effort not in EFFORTS:
            raise InputError(f"unknown effort {self.effort!r}; known are {', '.join(EFFORTS)}")
        for name in ("max_distance", "max_angle_deg", "max_iterations", "tolerance", "seed"):
            value = getattr(self, name)
            if not isinstance(value, numbers.Real) and (name, value) != ("max_distance", None):
                raise InputError(f"{name} must be a number; got {value!r}")
        if self.max_distance is not None and not 0.0 < self.max_distance < np.inf:
            raise InputError(f"max_distance must be a length above 0 in target units; got {self.max_distance!r}")
        if not 0.0 < self.max_angle_deg <= 90.0:
            raise InputError(f"max_angle_deg must be above 0 and at most 90; got {self.max_angle_deg!r}")
        if self.seed < 0:
            raise InputError(f"seed must be a whole number, 0 or more; got {self.seed!r}")
        if self.max_iterations < 1:
            raise InputError(f"max_iterations must be at least 1; got {self.max_iterations!r}")
        if not 0.0 < self.tolerance < 1.0:
            raise InputError(f"tolerance is a share of the target's size, above 0 and below 1; got {self.tolerance!r}")

    @property
    def fitted(self) -> int | None:
        """Points that need normals of their own: planes take the target's."""
        return COARSE if self.method == "auto" else EFFORTS[self.effort]

    def plan(self, reach: float) -> Plan:
        """Parts of the loop for a largest distance, target units."""
        return Plan(
            estimator=ESTIMATORS["dq" if self.method == "auto" else self.method],
            fine=ESTIMATORS["plane"] if self.method == "auto" else None,
            max_distance=reach,
            finest=EFFORTS[self.effort],
            max_angle_rad=float(np.deg2rad(self.max_angle_deg)),
            accelerate=self.accelerate,
            stopping=Stopping(tolerance=self.tolerance, iterations=self.max_iterations),
        )


def register(
    source: Any,
    target: Any,
    start: Any = None,
    *,
    method: str = "auto",
    max_distance: float | None = None,
    max_angle_deg: float = 60.0,
    source_units: str | None = None,
    target_units: str | None = None,
    effort: str = "normal",
    seed: int = 0,
    accelerate: bool = True,
    max_iterations: int = 100,
    tolerance: float = 1e-7,
    observe: Callable[[Iteration], object] | None = None,
    keep_inputs: bool = True,
) -> Registration:
    """Pose that puts the source on the target.

    Parameters
    ----------
    source : path, (n, 3) array, PointCloud, Open3D or trimesh object
        The scan, which moves. A mesh is sampled on its surface.
    target : path, (n, 3) array, PointCloud, Mesh, Open3D or trimesh object, or Target
        The part or the other scan, which stands. A mesh is used as it is, never sampled.
    start : None, "identity" or (4, 4) array_like
        None tries centre on centre with the principal axes in all proper turns. A matrix is ``T_target_source``.
    method : {"auto", "dq", "dq-points", "svd", "plane"}
        Pose step: the dual-quaternion closed form on points and normals, on points alone, Arun's SVD, or points to
        planes. Auto takes "dq" until the basin is found and "plane" for the last digits.
    max_distance : float, optional
        Largest distance of a pair, target units. Default: 0.2 of the smaller bounding-box diagonal.
    max_angle_deg : float
        Largest angle between normals of a pair once the pose is near.
    source_units, target_units : {"mm", "cm", "m", "inch", "ft"}, optional
        Length units. Where both are known and differ, the source is converted to the target's unit.
    effort : {"fast", "normal", "best"}
        Points of the last level: 20,000, 100,000, all.
    seed : int
        For whatever is drawn (samples of a mesh that is the source).
    accelerate : bool
        Whether Anderson acceleration extrapolates the steps.
    max_iterations : int
        Iterations at one width of the kernel at most.
    tolerance : float
        The last level ends once a step moves the points by less than this share of the target's diagonal, or by less
        than a tenth of what noise and number of the points leave open.
    observe : callable, optional
        Called with each `Iteration`; returning False stops the run.
    keep_inputs : bool
        Whether the result holds both sides, for `Registration.deviations`, pictures and reports. False where many
        results are kept.

    Returns
    -------
    Registration
        Pose, verdict and evidence. Look at ``verdict.level`` before the pose.

    Raises
    ------
    InputError
        If an argument or a file cannot be used; the message says what to do.
    DegenerateGeometryError
        If all points of one side lie on a line.

    Examples
    --------
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import bracket
    >>> part = Mesh(*bracket())
    >>> moved = part.vertices + [1.0, -2.0, 0.5]
    >>> result = register(Mesh(moved, part.faces), part, start="identity", effort="fast")
    >>> result.verdict.level, result.T_target_source[:3, 3].round(6).tolist()
    ('accepted', [-1.0, 2.0, -0.5])
    """
    began = time.perf_counter()
    options = Options(method, max_distance, max_angle_deg, effort, seed, accelerate, max_iterations, tolerance)
    T_start = _read_start(start)
    prepared = target if isinstance(target, Target) else Target(index_target(target))
    indexed = prepared.indexed
    centred = centre_source(source, source_units, target_units or indexed.units, np.random.default_rng(seed))
    timings = {"read": time.perf_counter() - began}
    with _timed(timings, "prepare"):
        surface = indexed.surface
        scan = prepare_scan(centred.cloud, options.fitted)
        plan = options.plan(max_distance or REACH * min(surface.diagonal, scan.diagonal))
    with _timed(timings, "start"):
        T_work, alternatives = _begin(T_start, scan, prepared, centred, plan, seed)
    with _timed(timings, "register"):
        run, mixture = run_graduated(scan, surface, T_work, plan, _observer(observe, centred, indexed))
    settings = {
        **dataclasses.asdict(options),
        "source": describe(source),
        "target": indexed.name,
        "start": "search" if start is None else "identity" if isinstance(start, str) else "given",
        "source_units": source_units or centred.cloud.units,
        "target_units": target_units or indexed.units,
    }
    timings["total"] = time.perf_counter() - began
    outcome = Outcome(run, mixture, scan, centred, indexed, plan)
    return outcome.registration(alternatives, timings, settings, keep_inputs)


def _observer(
    observe: Callable[[Iteration], object] | None, centred: CentredSource, indexed: IndexedTarget
) -> Callable[[Iteration], object] | None:
    if observe is None:
        return None
    told = observe
    return lambda record: told(for_caller(record, indexed.origin, centred.origin))


@contextlib.contextmanager
def _timed(timings: dict[str, float], name: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - began


def _read_start(start: Any) -> FloatArray | None:
    if start is None:
        return None
    if isinstance(start, str):
        if start != "identity":
            raise InputError(f'start must be None, "identity" or a 4x4 pose T_target_source; got {start!r}')
        return np.eye(4)
    return as_pose(start, "start")


def _begin(
    T_start: FloatArray | None, scan: Scan, prepared: Target, centred: CentredSource, plan: Plan, seed: int
) -> tuple[FloatArray, tuple[Alternative, ...]]:
    """Start pose between the two centred frames, and other poses as good."""
    indexed = prepared.indexed
    if T_start is not None:
        return to_work(T_start, indexed.origin, centred.origin), ()
    found = search(scan, indexed.surface, indexed.geometry, plan, prepared.pairs, np.random.default_rng(seed))
    if not found:
        return np.eye(4), ()
    others = tuple(Alternative(from_work(c.T_target_source, indexed.origin, centred.origin), c.rms) for c in found[1:])
    return found[0].T_target_source, others
