"""The front door: from a scan and a target to the pose, how sure it is, and why."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from numpy.typing import ArrayLike

from dqreg._arrays import renamed
from dqreg.icp.history import Iteration
from dqreg.icp.stopwatch import Stopwatch
from dqreg.registration.options.options import CONVERGENCE, Effort, Method, Options, Search, Units
from dqreg.registration.pipeline import align
from dqreg.registration.problem.problem import Problem
from dqreg.registration.result.log import logged
from dqreg.registration.result.result import Registration
from dqreg.registration.scale import align_with_scale
from dqreg.search import Stage
from dqreg.solvers import Freedom
from dqreg.trust.evidence import Clutter


def register(
    source: Any,
    target: Any,
    start: Any = None,
    *,
    method: Method = "auto",
    max_distance: float | None = None,
    max_angle_deg: float = 60.0,
    source_units: str | None = None,
    target_units: str | None = None,
    effort: Effort = "normal",
    seed: int = 0,
    accelerate: bool = True,
    max_iterations: int = 100,
    convergence: float = CONVERGENCE,
    units: Units = "check",
    dof: str | Freedom | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
    time_limit: float | None = None,
    scale: float | Literal["solve"] = 1.0,
    viewpoint: ArrayLike | str | None = None,
    search: Search = "doubt",
    clutter: Clutter = "allowed",
    expected_deviation: float | None = None,
    observe: Callable[[Iteration], object] | None = None,
    observe_search: Callable[[Stage], object] | None = None,
    keep_inputs: bool = True,
    verdict: bool = True,
    tolerance: float | None = None,
) -> Registration:
    """Pose that puts the source on the target.

    Parameters
    ----------
    source : path, (n, 3) array, PointCloud or object of another library (see `geometry.as_geometry`)
        The scan, which moves. A mesh is sampled on its surface.
    target : path, array, (vertices, faces), PointCloud, Mesh, object of another library, or Target
        The part or the other scan, which stands. A mesh is used as it is, never sampled.
    start : None, "identity" or (4, 4) array_like
        Initial pose. None searches for it; a matrix is ``T_target_source``, right to about 15 degrees and 5 % of
        the part's size. Rounded numbers are projected to the nearest rotation (``settings["start_departure"]`` away).
    method : {"auto", "dq", "dq-points", "svd", "plane", "generalised"}
        Pose step: the dual-quaternion closed form on points and normals, on points alone, Arun's SVD, point-to-plane,
        or plane-to-plane. Auto takes "dq" until the basin is found, then "plane", or "generalised" between clouds with
        an initial pose.
    max_distance : float, optional
        Largest distance of a correspondence, target units. Default: 0.2 of the smaller bounding-box diagonal.
    max_angle_deg : float
        Largest angle between the normals of a correspondence once the pose is near.
    source_units, target_units : {"um", "mm", "cm", "m", "inch", "ft"}, optional
        Length units. Where both are known and differ, the source is converted to the target's unit.
    effort : {"fast", "normal", "best"}
        Closest-point queries of the last stage on a mesh: about 8,000, 25,000, or as many as it takes to ask about all
        points; those on the face of a query enter the cost with it. With an initial pose, clouds of more than 18,000 or
        30,000 points are downsampled to about 6,000 or 10,000 cells (``settings["cell_size"]``), their means moved to
        the surface of their neighbours, unless they lie so near to it that all points improve the pose ("fast": much,
        where their noise is small); "best" has no cells, but 15,000 where a sensor saw them from its stand (a LiDAR, a
        depth camera), where all points say less.
    seed : int
        For whatever is drawn (samples of a mesh that is the source).
    accelerate : bool
        Whether Anderson acceleration extrapolates the steps.
    max_iterations : int
        Iterations at one kernel scale at most.
    convergence : float
        The last level ends once a step moves the points by less than this share of the target's diagonal, or by less
        than 0.6 of what noise and number of the points leave open.
    units : {"check", "ignore"}
        Whether sizes and spacings that differ like mm and inches are refused where a unit is not known.
    dof : str or Freedom, optional
        Degrees of freedom from the initial pose, like ``"rz tx ty"``; all others are locked exactly. See
        `Freedom.parse`. Needs ``start`` or ``prior``.
    prior : tuple of ((4, 4), (6, 6) or (6,)), optional
        Pose known beforehand and its covariance, or its six variances (radians and target units, squared), in the frame
        of `Registration.covariance` (about the middle of the target's bounding box). It is the initial pose where none
        is given.
    time_limit : float, optional
        Seconds after which the best pose so far is returned, with a verdict that says so.
    scale : float or "solve"
        What source lengths are multiplied with, beside the conversion of units; nothing is ever scaled unasked.
        "solve" estimates it, see `Registration.scale` and `Registration.scale_sigma`. The pose stays rigid and is that
        of the scaled source, ``p_target = R (scale p_source) + t``; so is ``start``, but one for the unscaled source
        will do. Not together with ``dof``, ``prior`` or ``viewpoint``.
    viewpoint : (3,) or (k, 3) array_like, "origin" or "none", optional
        Where the scanner stood, in source coordinates. Faces of a mesh that it cannot have seen (the inside of a thin
        wall, a part behind another) are ignored then, in deviations too. A single one also orients estimated normals,
        and what the scanner looked through from there speaks against a pose; between clouds only that. A viewpoint in
        the file hides nothing unless it is given here; with "none" it is not used at all.
    search : {"never", "doubt", "always"}
        Whether a global search may run beside an initial pose: not at all (a loop at a fixed rate), where the pose is
        in doubt and no ``method``, ``dof`` or ``prior`` is given, or in any case. Places near the pose (symmetries,
        periods, turns of a ring) are compared with "never" too.
    clutter : {"allowed", "none"}
        Whether the scan may show other objects; with "none", every point off the target speaks against the pose.
    expected_deviation : float, optional
        Largest deviation of the part from a target that is a mesh, in target units, as of a casting: what is no larger
        does not speak against the pose. Default: 0.0005 of the target's size; a part that deviates by more is not told
        from another part, or from a wrong pose, and the verdict is "suspect". Two clouds are compared as they are.
    observe : callable, optional
        Called with each `Iteration`; returning False stops the run.
    observe_search : callable, optional
        Called with each `Stage` of a global search; returning False ends it.
    keep_inputs : bool
        Whether the result holds source and target, for `Registration.deviations`, pictures and reports.
    verdict : bool
        Whether the pose is judged. With False the result is where the loop ends from ``start``, with its covariance, in
        about half of the time: nothing is searched for, no evidence is gathered, and the verdict is "suspect" with the
        code "not_judged". For a caller who has a test of its own, as a filter with a gate has.
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
        If all points of source or target lie on a line.
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
    options = Options(
        method=method,
        max_distance=max_distance,
        max_angle_deg=max_angle_deg,
        effort=effort,
        seed=seed,
        accelerate=accelerate,
        max_iterations=max_iterations,
        convergence=renamed("tolerance", tolerance, "convergence", convergence, CONVERGENCE),
        units=units,
        time_limit=time_limit,
        scale=scale,
        source_units=source_units,
        target_units=target_units,
        dof=dof,
        prior=prior,
        viewpoint=viewpoint,
        search=search,
        clutter=clutter,
        expected_deviation=expected_deviation,
        observe=observe,
        observe_search=observe_search,
        keep_inputs=keep_inputs,
        verdict=verdict,
    )
    if options.solves_scale:
        return logged(align_with_scale(source, target, start, options))
    return logged(align(Problem.of(source, target, start, options, Stopwatch(options.time_limit))))
