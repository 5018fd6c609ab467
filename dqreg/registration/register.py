"""The front door: from a scan and a target to the pose, how sure it is, and why."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, renamed
from dqreg.icp import Observer, run_graduated
from dqreg.icp.history import Iteration
from dqreg.icp.stopwatch import Deadline
from dqreg.registration.all_points import all_points_say_more, go_on
from dqreg.registration.assess import Outcome
from dqreg.registration.both import Both
from dqreg.registration.constraints import Known
from dqreg.registration.downsampling import Sides
from dqreg.registration.fallback import flips_of, mirror_gain, try_again
from dqreg.registration.initial_pose import Beginning, Searching, begin, read_start
from dqreg.registration.options import CONVERGENCE, Options, require_callable
from dqreg.registration.result import Registration
from dqreg.registration.scale import register_scaled
from dqreg.registration.target_file import bytes_of, load_target, save_target
from dqreg.registration.target_index import TargetIndex, index_target
from dqreg.registration.visibility import look_again
from dqreg.registration.visible_target import as_viewpoints
from dqreg.search import PairTable, Stage
from dqreg.solvers import Freedom

# Largest distance of a pair, in diagonals of the smaller of source and target.
REACH = 0.2


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
    convergence: float = CONVERGENCE,
    units: str = "check",
    dof: str | Freedom | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
    time_limit: float | None = None,
    scale: float | str = 1.0,
    viewpoint: ArrayLike | None = None,
    observe: Callable[[Iteration], object] | None = None,
    observe_search: Callable[[Stage], object] | None = None,
    keep_inputs: bool = True,
    tolerance: float | None = None,
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
    method : {"auto", "dq", "dq-points", "svd", "plane", "generalised"}
        Pose step: the dual-quaternion closed form on points and normals, on points alone, Arun's SVD, points to
        planes, or planes to planes. Auto takes "dq" until the basin is found and, for the last digits, "plane", or
        "generalised" from a start between clouds.
    max_distance : float, optional
        Largest distance of a pair, target units. Default: 0.2 of the smaller bounding-box diagonal.
    max_angle_deg : float
        Largest angle between normals of a pair once the pose is near.
    source_units, target_units : {"mm", "cm", "m", "inch", "ft"}, optional
        Length units. Where both are known and differ, the source is converted to the target's unit.
    effort : {"fast", "normal", "best"}
        How much a mesh is asked for the last digits: about 8,000 places, 25,000, or every point; of the first two, all
        points on the face of a place that was asked count as well. From a start between clouds of more than 18,000 or
        30,000 points, the means of about 6,000 or 10,000 cells stand for them
        (``settings["cell_size"]``), unless the points lie so much nearer to the surface than to each other that all of
        them say more; "best" has no cells.
    seed : int
        For whatever is drawn (samples of a mesh that is the source).
    accelerate : bool
        Whether Anderson acceleration extrapolates the steps.
    max_iterations : int
        Iterations at one width of the kernel at most.
    convergence : float
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
    scale : float or "solve"
        What source lengths are multiplied with, beside the conversion of units; nothing is ever scaled unasked.
        "solve" finds it: `Registration.scale` and `Registration.scale_sigma` then tell it and how sure it is. The
        pose stays rigid and is that of the scaled source, ``p_target = R (scale p_source) + t``; so is a start,
        but one for the source as it is will do. Not together with ``dof``, ``prior`` or ``viewpoint``.
    viewpoint : (3,) or (k, 3) array_like, optional
        Where the scanner stood, in source coordinates. Faces of a mesh that it cannot have seen (the inside of a thin
        wall, a part behind another) do not attract then, and deviations are from the others. Of a single one the
        signs of estimated normals are told too. What a file says of its viewpoint hides nothing unless given here.
    observe : callable, optional
        Called with each `Iteration`; returning False stops the run.
    observe_search : callable, optional
        Called with each `Stage` of the search for a start; returning False ends it.
    keep_inputs : bool
        Whether the result holds both sides, for `Registration.deviations`, pictures and reports. False where many
        results are kept.
    tolerance : float, optional
        Old name of ``convergence``, deprecated: a tolerance is the largest deviation allowed.

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
    convergence = renamed("tolerance", tolerance, "convergence", convergence, CONVERGENCE)
    del tolerance
    target = target.indexed if isinstance(target, Target) else target
    arguments, began = dict(locals()), time.perf_counter()
    options = Options(**{field.name: arguments[field.name] for field in dataclasses.fields(Options)})
    require_callable(observe=observe, observe_search=observe_search)
    if options.solves_scale:
        return register_scaled(register, arguments)
    T_start, viewpoints = read_start(start, prior, dof), as_viewpoints(viewpoint)
    timings: dict[str, float] = {}
    with _timed(timings, "read"):
        both = Both.read(source, target, options, source_units, target_units, viewpoints)
    with _timed(timings, "prepare"):
        sides = both.sides(options, started=T_start is not None)
        reach = max_distance or REACH * min(sides.surface.diagonal, sides.scan.diagonal)
    deadline = Deadline(began, time_limit)
    searching = Searching(sides.scan, both.target, options, reach, deadline, observe_search)
    with _timed(timings, "start"):
        begun = begin(T_start, searching, both.source.origin)
    watch = both.observer(observe)
    with _timed(timings, "register"):
        known = Known.of(dof, prior, begun.T_work, both.source.origin, both.target.origin)
        outcome = _run(both, sides, begun, known, options, reach, deadline, watch)
    alternatives = begun.alternatives
    if T_start is not None and outcome.found:
        with _timed(timings, "second try"):
            if method == "auto" and not known.anything:
                outcome, alternatives = try_again(outcome, begun.T_work, searching, watch, deadline)
            outcome = outcome.with_free_motions_of(begun.T_work)
            alternatives += flips_of(outcome, both.target.near_rotations)
    mirrored = mirror_gain(outcome, both.target)
    if viewpoints is not None:
        with _timed(timings, "viewpoint"):
            outcome = look_again(outcome, viewpoints, watch, deadline)
    settings = {
        **dataclasses.asdict(options),
        **both.settings(),
        "start": "search" if T_start is None else start if isinstance(start, str) else "given",
        "T_start": None if T_start is None else T_start.tolist(),
        "dof": None if dof is None else str(Freedom.parse(dof)),
        "prior": prior is not None,
        "viewpoint": None if viewpoints is None else viewpoints.tolist(),
        # Zero where all points have said more.
        "cell_size": sides.cell if outcome.scan is sides.scan else 0.0,
    }
    timings["total"] = time.perf_counter() - began
    return outcome.registration(alternatives, timings, settings, keep_inputs, mirrored)


def _run(
    both: Both,
    sides: Sides,
    begun: Beginning,
    known: Known,
    options: Options,
    reach: float,
    deadline: Deadline,
    watch: Observer | None,
) -> Outcome:
    """The loop, on cells of dense clouds first and on all points where they say more."""
    plan = options.plan(reach, known, begun.width, clouds=sides.even)
    run, mixture = run_graduated(sides.scan, sides.surface, begun.T_work, plan, deadline.watching(watch))
    if all_points_say_more(sides, run):
        sides, plan = both.whole(options), options.plan(reach, known)
        run, mixture = go_on(sides, plan, run, mixture, deadline.watching(watch))
    T, status = known.held(run.T_target_source), deadline.status(run.status)
    run = dataclasses.replace(run, T_target_source=T, status=status)
    return Outcome(run, mixture, sides.scan, sides.surface, both.source, both.target, plan, known, begun.searched)


@contextlib.contextmanager
def _timed(timings: dict[str, float], name: str) -> Iterator[None]:
    began = time.perf_counter()
    yield
    timings[name] = time.perf_counter() - began


@dataclasses.dataclass(frozen=True)
class Target:
    """A target prepared once and registered to often; safe to share between threads.

    Made by `prepare_target`, or read by `Target.load`.

    Attributes
    ----------
    indexed : TargetIndex
        Geometry in a frame of its own, and its surface.
    seconds : float
        Time that preparing it, or loading it, took.
    """

    indexed: TargetIndex
    seconds: float = dataclasses.field(default=0.0, compare=False)

    @property
    def pairs(self) -> PairTable:
        """Pairs of oriented points that the global search looks up; built when first needed."""
        return self.indexed.pairs

    @property
    def flips(self) -> FloatArray:
        """Rotations that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        return self.indexed.near_rotations

    @property
    def mirrors(self) -> FloatArray:
        """Reflections that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        return self.indexed.near_reflections

    def build_beside(self) -> threading.Thread:
        """Begin to build what a registration to a mesh asks for, in a thread of its own.

        Returns
        -------
        threading.Thread
            Running; to be joined before the rest is asked for.
        """
        return self.indexed.build_beside()

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
        """Read a target that `save` wrote; registrations to it give the same poses as to the one saved.

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
        return Target(load_target(path).build(), time.perf_counter() - began)

    def register(
        self,
        scan: Any,
        start: Any = None,
        *,
        time_limit: float | None = None,
        max_time: float | None = None,
        **options: Any,
    ) -> Registration:
        """Register a scan to this target; see `register` for the options.

        Parameters
        ----------
        scan : path, array or object
            Source.
        start : None, "identity" or (4, 4) array_like
            Where to begin. In tracking, the last pose: a start that explains the scan at once spares the coarse steps.
        time_limit : float, optional
            Seconds after which the best pose so far is returned.
        max_time : float, optional
            Old name of ``time_limit``, deprecated.
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
        time_limit = renamed("max_time", max_time, "time_limit", time_limit, None)
        return register(scan, self, start, time_limit=time_limit, **options)


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
    return Target(index_target(target).build(), time.perf_counter() - began)
