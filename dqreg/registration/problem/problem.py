"""What a registration was asked: source and target, read, in one unit, each centred once; and the way back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_pose, departure, require_workable
from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.opening import describe
from dqreg.geometry.scan_measures import THINNED_POINTS
from dqreg.geometry.unit_check import require_same_units
from dqreg.icp.coarse_to_fine import COARSE_POINTS, NEAR_POINTS
from dqreg.icp.correspondences import moved_points
from dqreg.icp.history import Iteration
from dqreg.icp.stopwatch import Stopwatch
from dqreg.kernels.threads import Later
from dqreg.registration.options.constraints import PoseConstraints
from dqreg.registration.options.options import NO_VIEWPOINT, ORIGIN, Options
from dqreg.registration.problem.derived_values import Derived, Key
from dqreg.registration.problem.preparation import Begin, Prepared
from dqreg.registration.problem.source import CentredSource, centre_source, read_source, require_one_place
from dqreg.registration.problem.target_index import Building, Evening, TargetIndex, index_for, index_target
from dqreg.rigid import pose, single_pose
from dqreg.solvers.dof import Freedom

T = TypeVar("T")

# Largest distance of a correspondence, in diagonals of the smaller of source and target.
REACH = 0.2
# Points that are prepared, a second of the time limit: they take a quarter of it on a core of 2020.
IN_TIME = 1_000_000
FEWEST = 1_000
# Points of a source that is read beside the target: fewer take no longer than it takes to hand them over.
BESIDE_POINTS = 20_000


@dataclasses.dataclass(frozen=True, eq=False)
class SourceAndTarget:
    """Source and target, each centred, and poses between their frames and the caller's."""

    source: CentredSource  # The scan, in target units
    target: TargetIndex  # What it is registered to

    @staticmethod
    def read(
        source: Any,
        target: Any,
        source_units: str | None = None,
        target_units: str | None = None,
        seed: int = 0,
        scale: float = 1.0,
    ) -> SourceAndTarget:
        """Both from whatever `dqreg.register` takes."""
        index = index_target(target)
        units = source_units, target_units or index.units
        return SourceAndTarget(centre_source(source, *units, seed, scale), index)

    def kept(self) -> SourceAndTarget:
        """Itself, with all points moved: arrays that were given may be filled again from here on."""
        for geometry in (self.source.cloud, self.target.geometry):
            _ = geometry.points if isinstance(geometry, PointCloud) else None
        return self

    def to_centred(self, T_target_source: FloatArray) -> FloatArray:
        """Pose between the centred frames, from one between the caller's."""
        R, t = T_target_source[:3, :3], T_target_source[:3, 3]
        # The origins go into the translation first: large numbers cancel here once, not once a point.
        return single_pose.from_parts(R, R @ self.source.origin + t - self.target.origin)

    def to_caller(self, T_centred: FloatArray) -> FloatArray:
        """Inverse of `to_centred`."""
        R, t = T_centred[:3, :3], T_centred[:3, 3]
        return single_pose.from_parts(R, t + self.target.origin - R @ self.source.origin)

    def in_caller_frames(self, record: Iteration) -> Iteration:
        """A record of the loop with its pose between the caller's frames."""
        return record.at(self.to_caller(record.T_target_source))

    def history_in_caller_frames(self, history: tuple[Iteration, ...]) -> tuple[Iteration, ...]:
        """All records of a loop the same way, in a third of the time."""
        poses = np.array([record.T_target_source for record in history]).reshape(-1, 4, 4)
        poses[:, :3, 3] = poses[:, :3, 3] + self.target.origin - poses[:, :3, :3] @ self.source.origin
        return tuple(record.at(T) for record, T in zip(history, poses, strict=True))

    def observer(self, observe: Callable[[Iteration], object] | None) -> Callable[[Iteration], object] | None:
        """The caller's observer as one of the loop."""
        return None if observe is None else lambda record: observe(self.in_caller_frames(record))

    def visible_from(self, viewpoints: FloatArray, T_centred: FloatArray) -> TargetIndex:
        """The target with those faces alone that can be seen at a pose from viewpoints in the caller's source frame."""
        return self.target.visible_from(pose.apply(T_centred, self.source.centred(viewpoints)))

    def placed(self, T_target_source: FloatArray) -> FloatArray:
        """Points of the source under a pose between the caller's frames, in the centred target frame, (n, 3)."""
        return moved_points(self.to_centred(T_target_source), self.source.cloud.points)


@dataclasses.dataclass(frozen=True, eq=False)
class Problem(SourceAndTarget):
    """What was asked, read and checked."""

    options: Options
    start: FloatArray | None  # (4, 4): Initial pose that was given, between the caller's frames
    viewpoints: FloatArray | None  # (k, 3): Where the scanner stood, in the caller's source frame
    units: tuple[str | None, str | None]  # Length units of source and target, where they are known
    asked: dict[str, Any]  # What a result repeats of it
    watch: Stopwatch
    whole: TargetIndex  # The target with all its points, where a time limit leaves time for some
    is_kept: bool  # Whether the caller has prepared the target, for others too
    _building: Building | None = dataclasses.field(default=None, repr=False, compare=False)
    _evening: Evening | None = dataclasses.field(default=None, repr=False, compare=False)
    derived: Derived = dataclasses.field(default_factory=Derived, init=False, repr=False, compare=False)

    @staticmethod
    def of(source: Any, target: Any, start: Any, options: Options, watch: Stopwatch) -> Problem:
        """Read source and target; a target that is not indexed is being built from here on."""
        T_start, viewpoints = read_start(start, options.prior, options.dof), as_viewpoints(options.viewpoint)
        if T_start is None and (options.search == "never" or not options.verdict):
            given, but = (
                ('search="never"', "allow a search") if options.verdict else ("verdict=False", "have it judged")
            )
            raise InputError(f"{given} leaves the pose to start=, and there is none: give start, or {but}")
        with watch.stage("read"):
            read = Later(lambda: read_source(source, options.seed), beside=_may_be_beside(source, target))
            index, chord = index_for(target, source, options.source_units)
            # What was prepared is built already, and clouds are built as they are asked.
            is_kept = index is getattr(target, "indexed", target)
            whole, index = index, index if is_kept else _target_in_time(index, options.time_limit)
            is_built = is_kept or index.kind == "cloud"
            building = None if is_built else index.build_beside(watch.deadline, judged=options.verdict)
            # A search sees all points first.
            cells = options.cells_from_a_stand if T_start is not None and index.kind == "cloud" else None
            evening = None if cells is None else index.begin_evened(cells)
            unit = options.target_units or index.units
            centred = read.result().centred(options.source_units, unit, float(options.scale))
            if viewpoints is not None:
                require_one_place(viewpoints, index.geometry)
                centred = centred.oriented_from(viewpoints)
            centred = centred.without_viewpoint if options.without_viewpoint else centred
            units = options.source_units or centred.cloud.units, unit
            if options.units == "check":
                require_same_units(centred.cloud, index.geometry, *units, index.spreads)
        asked = {
            **options.recorded,
            "source": describe(source),
            "target": index.name,
            **({} if chord is None else {"chord": chord}),
            "source_units": units[0],
            "target_units": units[1],
            "start": "search" if T_start is None else start if isinstance(start, str) else "given",
            "T_start": None if T_start is None else T_start.tolist(),
            "start_departure": _departure(start, options.prior, T_start),
            "dof": None if options.dof is None else str(options.freedom),
            "prior": options.prior is not None,
            "viewpoint": None if viewpoints is None else viewpoints.tolist(),
        }
        beside = building, evening
        return Problem(centred, index, options, T_start, viewpoints, units, asked, watch, whole, is_kept, *beside)

    def prepare(self, begin: Begin | None = None) -> Prepared:
        """Scan with normals and surface to ask; where an initial pose was given, two dense clouds are downsampled."""
        prepared = self.prepare_whole() if self.start is None else self._downsampled(begin) or self.prepare_whole()
        if self._building is not None:
            self._building.surface_is_ready.wait()
        return prepared

    def prepare_found(self, prepared: Prepared) -> Prepared:
        """The same for the loop once a search has ended, which sees all points: as where its pose had been given."""
        is_over = self.start is not None or self.watch.is_over
        return prepared if is_over else self._downsampled() or prepared

    def _downsampled(self, begin: Begin | None = None) -> Prepared | None:
        most, count = self.options.cells, self.options.cells_from_a_stand
        if count is None or self.target.kind != "cloud":
            return None
        prepared = Prepared.downsampled(
            self._in_time, self.target, count, begin if most is not None else None, self._evening
        )
        return prepared if most is not None or prepared.is_from_a_stand else None

    def begin(self, key: Key[T], make: Callable[[], T]) -> None:
        """Make ahead what will be asked for, beside the caller; under a time limit nothing is."""
        if self.options.time_limit is None:
            self.derived.begin(key, make)

    def await_target(self) -> None:
        """Wait for what is built of the target beside the loop, at most until the time is up."""
        if self._building is not None:
            self._building.join(self.watch.left)

    def prepare_whole(self) -> Prepared:
        """The same with all points."""
        cloud, fitted = self._in_time, self.options.fitted
        if self.start is not None and self.target.kind == "mesh" and self.options.method == "auto":
            # A start that is near needs no more; where it is not, the others are fitted then.
            is_bare = cloud.normals is None and cloud.viewpoint is None
            fitted = NEAR_POINTS if is_bare and 2 * COARSE_POINTS < len(cloud) <= THINNED_POINTS else fitted
        return Prepared.whole(cloud, self.target, fitted)

    def prepare_even(self) -> Prepared:
        """All points, with planes fitted at every point of the source, too."""
        return dataclasses.replace(Prepared.whole(self._in_time, self.target, None), even=True)

    @property
    def both_are_clouds(self) -> bool:
        """Whether source and target are two clouds that the method may compare by planes of each."""
        return self.options.cells_from_a_stand is not None and self.target.kind == "cloud"

    @cached_property
    def _in_time(self) -> PointCloud:
        """The source; of a large one so many points that a time limit leaves time for more than preparing them."""
        return _some_in_time(self.source.cloud, self.options.time_limit)

    def max_distance(self, prepared: Prepared) -> float:
        """Largest distance of a correspondence, target units."""
        return self.options.max_distance or self.reach(prepared)

    def reach(self, prepared: Prepared) -> float:
        """The same where none was given."""
        return REACH * min(prepared.surface.diagonal, prepared.scan.diagonal)

    def constraints(self, T_reference: FloatArray) -> PoseConstraints:
        """What was asked of the pose, between the centred frames; locked motions stay as they are in a reference."""
        options = self.options
        return PoseConstraints.centred(
            options.freedom, options.prior, T_reference, self.source.origin, self.target.origin
        )


def _may_be_beside(source: Any, target: Any) -> bool:
    """Whether a source may be read beside the target: arrays alone, as what else there is may have state of its own."""
    return type(source) is type(target) is np.ndarray and source.size > 3 * BESIDE_POINTS


def _some_in_time(cloud: PointCloud, limit: float | None) -> PointCloud:
    """A cloud; of a large one so many points that a time limit leaves time for more than preparing them."""
    most = np.inf if limit is None else max(IN_TIME * limit, FEWEST)
    return cloud if len(cloud) <= most else cloud._taken(sample_rows(len(cloud), int(most)))


def _target_in_time(index: TargetIndex, limit: float | None) -> TargetIndex:
    """A target that is not prepared, the same way; in the same frame."""
    if not isinstance(index.geometry, PointCloud):
        return index
    some = _some_in_time(index.geometry, limit)
    return index if some is index.geometry else dataclasses.replace(index, geometry=some)


def read_start(start: Any, prior: Any, dof: Any) -> FloatArray | None:
    """The initial pose, as a caller may give it."""
    if start is None and isinstance(prior, tuple) and len(prior) == 2:
        return as_pose(prior[0], "prior[0]")
    if start is None:
        if dof is not None:
            # Words that mean nothing are named first.
            Freedom.parse(dof)
            raise InputError(f"dof={str(dof)!r} locks motions of a start, and there is none: give start, or a prior")
        return None
    if isinstance(start, str):
        if start != "identity":
            meant = "; did you mean None?" if start.lower() == "none" else ""
            raise InputError(f'start must be None, "identity" or a 4x4 pose T_target_source; got {start!r:.60}{meant}')
        return np.eye(4)
    return as_pose(start, "start")


def _departure(start: Any, prior: Any, T_start: FloatArray | None) -> float | None:
    """How far the rotation that was given lay from the one it was projected to."""
    if T_start is None or isinstance(start, str):
        return None
    return departure(prior[0] if start is None else start, T_start)


def as_viewpoints(value: Any) -> FloatArray | None:
    """Viewpoints of the scanner, checked."""
    if isinstance(value, str) and value not in (ORIGIN, NO_VIEWPOINT):
        raise InputError(f'viewpoint must be a place, "{ORIGIN}" or "{NO_VIEWPOINT}"; got {value!r:.60}')
    if value is None or (isinstance(value, str) and value == NO_VIEWPOINT):
        return None
    places = np.zeros(3) if isinstance(value, str) else as_float(value, "viewpoint")
    if places.ndim not in (1, 2) or places.shape[-1] != 3 or not places.size:
        raise InputError(
            f"viewpoint must be the place of the scanner in source coordinates, (3,), or several, (k, 3), or "
            f'"{ORIGIN}" or "{NO_VIEWPOINT}"; got shape {places.shape}'
        )
    if not np.isfinite(places).all():
        raise InputError(f"viewpoint must hold finite numbers; got {places.tolist()}")
    places = np.atleast_2d(places)
    require_workable(np.vstack([places, np.zeros(3)]), "the coordinates of the viewpoint")
    return places
