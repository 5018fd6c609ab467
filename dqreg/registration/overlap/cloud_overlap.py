"""What is left between two clouds at the pose of a fit, and where the faces end in common: begun beside the loop."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import replaced
from dqreg.geometry import PointCloud, Surface
from dqreg.kernels.threads import TimeUpError, until
from dqreg.registration.fit.fit import Fit
from dqreg.registration.overlap.common_faces import OVERLAP, begin_sampling, on_common_faces, overlap_at, overlap_of
from dqreg.registration.overlap.free_space import begin_free_space, met_at
from dqreg.registration.problem.derived_values import Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import Problem
from dqreg.trust import Evidence
from dqreg.trust.common_planes import CommonPlanes
from dqreg.trust.strain import Strain

SHAPES: Key[tuple[Strain, float, float]] = Key()
PLANES: Key[CommonPlanes | None] = Key()


def have_planes_alone(fit: Fit) -> bool:
    """Whether two clouds have hardly more than planes in common: other places fit these as well."""
    if not fit.found or fit.is_late or not fit.between_clouds:
        return False
    planes = planes_of(fit)
    return planes is not None and planes.are_all


def evidence_between_clouds(fit: Fit, covariance: FloatArray) -> Evidence:
    """The agreement, of two clouds with what is left between them; as it is where hardly a face is on both."""
    target = fit.target.geometry
    if not fit.found or fit.is_late or not isinstance(target, PointCloud):
        return fit.agreement
    (moves, _, overlap), planes = overlap_of(fit), planes_of(fit)
    if overlap is None:
        return fit.agreement
    size = fit.prepared.surface.diagonal
    # From the last on that was begun beside the caller, who is at the first.
    strain, deformation, waviness = fit.derived.once(SHAPES, lambda: overlap.shapes(size))
    faces_apart, opposed_edges = overlap.apart(size, covariance), planes.opposed_edges() if planes else np.nan
    ends_apart, rims_shared, closed_hole = _ends_of_faces(fit, planes, size)
    return replaced(
        fit.agreement,
        faces_apart=faces_apart,
        opposed_edges=opposed_edges,
        ends_apart=ends_apart,
        closed_hole=closed_hole,
        rims_shared=rims_shared,
        rims_elsewhere=planes.rims_elsewhere(size) if planes and planes.are_a_corner else (np.nan, 0.0),
        largest_plane=planes.largest if planes and planes.are_a_corner else np.nan,
        deformation=deformation,
        waviness=waviness,
        stretch=strain.value if strain.is_strained else 0.0,
        stretched_along=strain.along,
        bend=strain.bend if strain.is_bent else 0.0,
        _common=len(overlap.points) / len(moves.some[0]),
    )


def _ends_of_faces(fit: Fit, planes: CommonPlanes | None, size: float) -> tuple[float, float, float]:
    """Ends of faces that lie apart, rims that are shared, and the largest closed hole; NaN for what is not asked.

    Fields of view, shadows and gaps between rings end faces too. Where rays are known that end nowhere on what the
    other scanner saw, those that went on beside an edge tell of it: what they passed through is all that lies apart.
    """
    if planes is None or not planes.are_all:
        return np.nan, np.nan, np.nan
    met = None if planes.are_a_corner else met_at(fit)
    if met is not None and met.agree:
        return float(met.through[0]), np.nan, 0.0
    return *planes.ends_and_rims(), planes.closed_hole(size)


def planes_of(fit: Fit) -> CommonPlanes | None:
    """The planes that two clouds have in common at the pose of a fit; None for none."""

    def found() -> CommonPlanes | None:
        moves, stands, overlap = overlap_of(fit)
        if overlap is None:
            return None
        size = fit.prepared.surface.diagonal
        return CommonPlanes.of(overlap.on_no_edge, moves, stands, fit.T_target_source, size)

    return fit.derived.once(PLANES, found)


def prepared_to_judge(problem: Problem) -> Prepared:
    """Scan and surface for the loop, with the evidence on them begun."""
    prepared = problem.prepare(lambda surface, is_whole: begin_evidence(problem, surface, is_whole=is_whole))
    if prepared.cell_size > 0.0:
        # Whatever has not begun by now.
        begin_evidence(problem, prepared.surface, is_whole=prepared.is_whole)
    return prepared


def begun_to_judge(fit: Fit) -> Fit:
    """The fit brought together on what both clouds show, with the evidence on it begun."""
    begin_judging(fit)
    with suppress(TimeUpError), until(fit.problem.watch.deadline):
        fit = on_common_faces(fit)
        begin_comparing(fit)
    return fit


def begin_evidence(problem: Problem, surface: Surface, *, is_whole: bool) -> None:
    """Make what the evidence on a pose between two dense clouds will ask of them beside the loop, whatever the pose.

    The scan may be whole, where the target alone is so dense.
    """
    target = problem.target.geometry
    if isinstance(target, PointCloud):
        begin_sampling(problem, surface, target, is_whole=is_whole)
        begin_free_space(problem, target)


def begin_judging(fit: Fit) -> None:
    """Make what the evidence on a fit will ask first, beside what else is asked of it."""
    target = fit.target.geometry
    if fit.found and _is_worth_it(fit.prepared) and isinstance(target, PointCloud):
        # First what is asked first.
        fit.begin_information()
        fit.begin_agreement()
        fit.begin(OVERLAP, lambda: overlap_at(fit))


def begin_comparing(fit: Fit) -> None:
    """Make what takes longest of the evidence on two clouds, at a pose that will hardly change, beside the rest.

    Of many small steps nothing is: two threads that take turns at them take longer than one.
    """
    if not fit.found or fit.is_late or not _is_worth_it(fit.prepared) or fit.problem.options.time_limit is not None:
        return
    if not fit.between_clouds:
        return
    if (planes := planes_of(fit)) is not None:
        planes.begin()


def _is_worth_it(prepared: Prepared) -> bool:
    """Whether it pays to use another thread: of two dense clouds. Below, handing over costs more than it saves."""
    return prepared.cell_size > 0.0
