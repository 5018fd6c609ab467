"""The front door: from a scan and a target to the pose, how sure it is, and why."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg.answer import Outcome, for_caller, from_work, to_work
from dqreg.arrays import FloatArray, as_pose
from dqreg.deadline import Deadline
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.geometry.prepare import Scan, prepare_scan
from dqreg.geometry.unit_mistake import require_same_units
from dqreg.icp import run_graduated, width_floor
from dqreg.known import Known
from dqreg.options import Options
from dqreg.records import Alternative, Iteration
from dqreg.result import Registration
from dqreg.second_try import try_again
from dqreg.solvers import Freedom
from dqreg.start import Candidate, PairTable, Stage, search
from dqreg.start.flips import flipped, near_flips
from dqreg.target import CentredSource, IndexedTarget, centre_source, describe, index_target
from dqreg.target_file import bytes_of, load_target, save_target

# Largest distance of a pair, in diagonals of the smaller of source and target.
REACH = 0.2
# How near the search for a start comes, in diagonals of the target.
FOUND = 5e-3


@dataclasses.dataclass(frozen=True)
class Target:
    """A target prepared once and registered to often; safe to share between threads.

    Made by `prepare_target`, or read by `Target.load`.

    Attributes
    ----------
    indexed : IndexedTarget
        Geometry in a frame of its own, and its surface.
    seconds : float
        Time that preparing it, or loading it, took.
    """

    indexed: IndexedTarget
    seconds: float = dataclasses.field(default=0.0, compare=False)

    @cached_property
    def pairs(self) -> PairTable:
        """What the search for a start looks up; built when first needed, the same whoever builds it."""
        return PairTable.of(self.indexed.geometry, self.indexed.surface)

    @cached_property
    def flips(self) -> FloatArray:
        """Turns that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        geometry = self.indexed.geometry
        return near_flips(geometry, self.indexed.surface) if isinstance(geometry, Mesh) else np.zeros((0, 4, 4))

    @property
    def nbytes(self) -> int:
        """Memory that it takes, in bytes: its arrays, and an estimate for Open3D's trees, good to a fifth."""
        return bytes_of(self.indexed)

    def save(self, path: str | Path) -> None:
        """Write it to a file, to be read by `Target.load`: arrays and a JSON header in an NPZ archive, no pickle.

        Parameters
        ----------
        path : str or Path
            File to write, as it is named.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        save_target(self.indexed, path)

    @staticmethod
    def load(path: str | Path) -> Target:
        """Read a target that `save` wrote; registrations to it give the same bytes.

        Parameters
        ----------
        path : str or Path
            File to read.

        Returns
        -------
        Target
            Ready, with the trees built again.

        Raises
        ------
        InputError
            If the file is missing, damaged, or no prepared target.
        """
        began = time.perf_counter()
        return _built(load_target(path), began)

    def register(self, scan: Any, start: Any = None, *, max_time: float | None = None, **options: Any) -> Registration:
        """Register a scan to this target; see `register` for the options.

        Parameters
        ----------
        scan : path, array or object
            Source.
        start : None, "identity" or (4, 4) array_like
            Where to begin. In tracking, the last pose: a start that explains the scan at once spares the coarse steps.
        max_time : float, optional
            Seconds after which the best pose so far is returned; another name of ``time_limit``.
        **options
            Keyword options of `register`.

        Returns
        -------
        Registration
            The answer.

        Raises
        ------
        InputError
            If ``max_time`` and ``time_limit`` are both given, and where `register` does.
        """
        if max_time is not None:
            if options.get("time_limit") is not None:
                raise InputError("max_time and time_limit are two names of one limit; give one of them")
            options["time_limit"] = max_time
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
    began = time.perf_counter()
    return _built(index_target(target), began)


def _built(indexed: IndexedTarget, began: float) -> Target:
    indexed.build()
    prepared = Target(indexed)
    _ = prepared.flips
    object.__setattr__(prepared, "seconds", time.perf_counter() - began)
    return prepared


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
    units: str = "check",
    dof: str | Freedom | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
    time_limit: float | None = None,
    observe: Callable[[Iteration], object] | None = None,
    observe_search: Callable[[Stage], object] | None = None,
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
        None finds the pose from nothing. A matrix is ``T_target_source``, right to about 15 degrees and a tenth of
        the part's size.
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
        Points of the last level: 20,000, 60,000, all; not drawn evenly but where they say most.
    seed : int
        For whatever is drawn (samples of a mesh that is the source).
    accelerate : bool
        Whether Anderson acceleration extrapolates the steps.
    max_iterations : int
        Iterations at one width of the kernel at most.
    tolerance : float
        The last level ends once a step moves the points by less than this share of the target's diagonal, or by less
        than a tenth of what noise and number of the points leave open.
    units : {"check", "ignore"}
        Whether sizes and spacings that differ like mm and inches are refused where a unit is not known.
    dof : str or Freedom, optional
        Motions that the pose may take from the start, like ``"rz tx ty"``; all others are locked exactly. See
        `Freedom.parse`. Needs a start or a prior.
    prior : tuple of ((4, 4), (6, 6)), optional
        Pose known beforehand and its covariance, in the frame of `Registration.covariance` (about the middle of the
        target's bounding box). It is the start where none is given.
    time_limit : float, optional
        Seconds after which the best pose so far is returned, with a verdict that says so.
    observe : callable, optional
        Called with each `Iteration`; returning False stops the run.
    observe_search : callable, optional
        Called with each `Stage` of the search for a start; returning False ends it.
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
    UnitsError
        If the sizes look like a mistake of units.

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
    options = Options(
        method, max_distance, max_angle_deg, effort, seed, accelerate, max_iterations, tolerance, units, time_limit
    )
    _require_callable(observe=observe, observe_search=observe_search)
    T_start = _read_start(start, prior, dof)
    prepared = target if isinstance(target, Target) else Target(index_target(target))
    indexed = prepared.indexed
    centred = centre_source(source, source_units, target_units or indexed.units, np.random.default_rng(seed))
    named = source_units or centred.cloud.units, target_units or indexed.units
    if units == "check" and None in named:
        require_same_units(centred.cloud, indexed.geometry, *named, indexed.spreads)
    timings = {"read": time.perf_counter() - began}
    with _timed(timings, "prepare"):
        surface = indexed.surface
        scan = prepare_scan(centred.cloud, options.fitted)
        reach = max_distance or REACH * min(surface.diagonal, scan.diagonal)
    deadline = Deadline(began, time_limit)
    with _timed(timings, "start"):
        begin = _begin(T_start, scan, prepared, centred, options, reach, deadline, observe_search)
    with _timed(timings, "register"):
        known = Known.of(dof, prior, begin.T_work, centred.origin, indexed.origin)
        plan = options.plan(reach, known, begin.width)
        watch = deadline.watching(_observer(observe, centred, indexed))
        run, mixture = run_graduated(scan, surface, begin.T_work, plan, watch)
        run = dataclasses.replace(
            run, T_target_source=known.held(run.T_target_source), status=deadline.status(run.status)
        )
    outcome = Outcome(run, mixture, scan, centred, indexed, plan, known, begin.searched)
    alternatives = begin.alternatives
    if T_start is not None and outcome.found:
        with _timed(timings, "second try"):
            if method == "auto" and not known.anything:
                outcome, alternatives = try_again(
                    outcome,
                    begin.T_work,
                    lambda: _searched(scan, prepared, options, reach, deadline, observe_search),
                    FOUND * surface.diagonal,
                    _observer(observe, centred, indexed),
                    deadline,
                )
            alternatives += _flips_of(outcome, prepared)
    settings = {
        **dataclasses.asdict(options),
        "source": describe(source),
        "target": indexed.name,
        "start": "search" if T_start is None else start if isinstance(start, str) else "given",
        "T_start": None if T_start is None else T_start.tolist(),
        "dof": None if dof is None else str(Freedom.parse(dof)),
        "prior": prior is not None,
        "source_units": named[0],
        "target_units": named[1],
    }
    timings["total"] = time.perf_counter() - began
    return outcome.registration(alternatives, timings, settings, keep_inputs)


def _flips_of(outcome: Outcome, prepared: Target) -> tuple[Alternative, ...]:
    scan, surface = outcome.scan, prepared.indexed.surface
    limit, floor = 0.25 * outcome.plan.max_distance, width_floor(scan, surface)
    found = flipped(outcome.run.T_target_source, prepared.flips, scan, surface, limit, floor)
    return tuple(Alternative(from_work(T, prepared.indexed.origin, outcome.source.origin), rms) for T, rms in found)


def _observer(
    observe: Callable[[Iteration], object] | None, centred: CentredSource, indexed: IndexedTarget
) -> Callable[[Iteration], object] | None:
    if observe is None:
        return None
    told = observe
    return lambda record: told(for_caller(record, indexed.origin, centred.origin))


def _require_callable(**observers: Any) -> None:
    for name, observer in observers.items():
        if observer is not None and not callable(observer):
            raise InputError(f"{name} must be a function of one record, or None; got {observer!r:.80}")


@contextlib.contextmanager
def _timed(timings: dict[str, float], name: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - began


def _read_start(start: Any, prior: Any, dof: Any) -> FloatArray | None:
    if start is None and isinstance(prior, tuple) and len(prior) == 2:
        return as_pose(prior[0], "prior[0]")
    if start is None:
        if dof is not None:
            raise InputError(f"dof={str(dof)!r} locks motions of a start, and there is none: give start, or a prior")
        return None
    if isinstance(start, str):
        if start != "identity":
            raise InputError(f'start must be None, "identity" or a 4x4 pose T_target_source; got {start!r}')
        return np.eye(4)
    return as_pose(start, "start")


@dataclasses.dataclass(frozen=True)
class _Begin:
    """Where to begin, between the centred frames, and what the search for it knows."""

    T_work: FloatArray
    width: float | None = None
    alternatives: tuple[Alternative, ...] = ()
    searched: str = ""


def _begin(
    T_start: FloatArray | None,
    scan: Scan,
    prepared: Target,
    centred: CentredSource,
    options: Options,
    reach: float,
    deadline: Deadline,
    observe: Callable[[Stage], object] | None,
) -> _Begin:
    indexed = prepared.indexed
    if T_start is not None:
        return _Begin(to_work(T_start, indexed.origin, centred.origin))
    found = _searched(scan, prepared, options, reach, deadline, observe)
    if not found:
        return _Begin(np.eye(4), searched="judged")
    others = tuple(
        Alternative(from_work(c.T_target_source, indexed.origin, centred.origin), c.rms, c.symmetry) for c in found[1:]
    )
    # The search has looked at the whole of both sides: what is left is to come near.
    width = FOUND * prepared.indexed.surface.diagonal if found[0].stage == "judged" else None
    return _Begin(found[0].T_target_source, width, others, found[0].stage)


def _searched(
    scan: Scan,
    prepared: Target,
    options: Options,
    reach: float,
    deadline: Deadline,
    observe: Callable[[Stage], object] | None,
) -> tuple[Candidate, ...]:
    return search(
        scan,
        prepared.indexed.surface,
        prepared.indexed.geometry,
        options.plan(reach, Known()),
        prepared.pairs,
        np.random.default_rng(options.seed),
        time_limit=deadline.left,
        observe=observe,
    )
