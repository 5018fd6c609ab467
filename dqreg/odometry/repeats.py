"""Places where a frame is like itself, and could have been seen as well: one period on in a hall of columns."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.geometry import Scan
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp import Alignment
from dqreg.kernels.threads import Later
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.rivals import ComparedFrame, shift_between
from dqreg.odometry.self_similarity import CONTRADICTED_SHARE, ROUGH_SHARE, FrameView, behind_faces, self_similar_shifts
from dqreg.rigid import pose
from dqreg.solvers.motion_words import Vector, direction_words
from dqreg.trust.records import Alternative

# Share of a frame's points whose normals the map has to know, for those of its own to be needless.
MIN_KNOWN_NORMAL_SHARE = 2.0 / 3.0
# Voxels that the refinement of a place one period on may move it, and such places that are named.
MAX_REFINEMENT_CELLS, MAX_NAMED_POSES = 3.0, 2


def like_itself(
    place: ComparedFrame, search: FrameSearch, frame: DownsampledFrame, view: FrameView, similar: Later[FloatArray]
) -> ComparedFrame:
    """The same with places where the frame is like itself.

    Those are asked for where nothing else excludes them: without times, frames may be missing, and constant velocity
    does not.
    """
    if not place.aligned.found or place.rivals:
        return place
    scan, shifts = with_met_normals(frame, place.aligned), similar.result()
    if not any(_could_repeat(scan, view, shift) for shift in shifts):
        return place
    # Rare, and worth normals of its own.
    own = frame.fitted
    shifts = shifts if scan is own else similar_shifts(search, own)
    return dataclasses.replace(place, rivals=_repeated(search, own, place.aligned, view, shifts))


def with_met_normals(frame: DownsampledFrame, aligned: Alignment) -> Scan:
    """A frame with the normals of the planes that it met, which cost nothing; with its own where too few met any."""
    met = aligned.pairs.closest.normals
    if len(met) != len(frame.seen) or np.count_nonzero(nonzero_rows(met)) < MIN_KNOWN_NORMAL_SHARE * len(met):
        return frame.fitted
    return dataclasses.replace(frame.scan, normals=product(met, aligned.T_target_source[:3, :3]))


def similar_shifts(search: FrameSearch, scan: Scan) -> FloatArray:
    """Shifts that put a frame onto itself, (k, 3)."""
    return self_similar_shifts(scan.points, scan.normals, search.lengths.voxel_size, 0.5 * search.lengths.reach)


def _could_repeat(scan: Scan, view: FrameView, shift: FloatArray) -> bool:
    """Whether a frame could have been seen at the end of a shift as well."""
    step = pose.from_parts(np.eye(3), shift)
    return not behind_faces(scan.points, scan.normals, shift) and view.repeats(scan, step, ROUGH_SHARE)


def _repeated(
    search: FrameSearch, scan: Scan, aligned: Alignment, view: FrameView, shifts: FloatArray
) -> tuple[Alternative, ...]:
    """Poses where the frame is like itself: what stands there was seen here, and nothing where it looked through."""
    cell, least, T = search.lengths.voxel_size, 0.5 * search.lengths.reach, aligned.T_target_source
    found: list[Alternative] = []
    for shift in shifts:
        if not _could_repeat(scan, view, shift):
            continue
        step = pose.from_parts(np.eye(3), shift)
        # Known to a cell: begun farther off, a frame that overlaps by little would slide along what does not hold it.
        run = search.settle(scan, T @ step, aligned)
        if not run.found:
            continue
        there = run.T_target_source
        away, known = shift_between(there, T), [aligned.T_target_source, *(other.T_target_source for other in found)]
        if (
            shift_between(there, T @ step) > MAX_REFINEMENT_CELLS * cell
            or min(shift_between(there, other) for other in known) < least
        ):
            continue
        if view.repeats(scan, pose.inverse(T) @ there, CONTRADICTED_SHARE):
            rms = np.sqrt(np.mean(search.surface.distances(pose.apply(there, scan.points)) ** 2))
            words = f"{away:.3g} along {direction_words(_axis(there[:3, 3] - T[:3, 3]))}"
            found.append(Alternative(there, float(rms), words=words))
        if len(found) == MAX_NAMED_POSES:
            break
    return tuple(found)


def _axis(step: FloatArray) -> Vector:
    x, y, z = (step / np.linalg.norm(step)).tolist()
    return x, y, z
