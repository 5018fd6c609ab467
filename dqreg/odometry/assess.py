"""What is said of a frame: information from its last correspondences, covariance, verdict."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, product
from dqreg.geometry.vector_rows import nonzero_rows, row_dots
from dqreg.icp import NO_POSE, Alignment
from dqreg.kernels.threads import as_plain
from dqreg.odometry.follow import SPURIOUS_INFORMATION_RATIO
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapPlanes
from dqreg.odometry.prediction import Prediction, contradiction, held_directions, held_notes
from dqreg.odometry.rivals import ComparedFrame
from dqreg.registration.assessment.assess import Uncertainty
from dqreg.registration.result.empty_results import unmeasured, without_pose
from dqreg.registration.result.result import Registration
from dqreg.rigid import single_pose, twist
from dqreg.rigid.single_pose import orthonormal
from dqreg.solvers.row_sums import MotionSums
from dqreg.trust import Evidence, Information, information_of, judge
from dqreg.trust.code_sets import PLACE_UNKNOWN
from dqreg.trust.records import Reason, Verdict

# Fraction of inliers below which there is no pose to speak of: a frame of another place reaches 0.3.
LOST_FRACTION = 1.0 / 3.0
TINY = float(np.finfo(float).tiny)


def frame_result(
    place: ComparedFrame,
    information: Information | None,
    frame: DownsampledFrame,
    usual: float,
    notes: tuple[Reason, ...],
    settings: dict[str, Any],
    prediction: Prediction | None = None,
) -> Registration:
    """The answer for one frame; with a prediction that has a covariance, both are weighed."""
    run = place.aligned
    if run.status not in NO_POSE and not run.inlier_fraction >= LOST_FRACTION:
        words = (
            f"no pose: only {100 * run.inlier_fraction:.0f} % of the points are inliers at the best one; the next is "
            "sought from the last trusted frame on, and where frames stay lost prediction= tells the way since, "
            "relocalise looks everywhere in the map, and reset begins a new one"
        )
        return without_pose((Reason(words, "lost"), *notes), run.status, settings)
    uncertainty = None if information is None else Uncertainty.of(information)
    T = orthonormal(run.T_target_source)
    doubts = place.doubts
    if uncertainty is not None and prediction is not None and prediction.information is not None:
        doubts = (*doubts, *contradiction(T, uncertainty.directions, prediction, settings["near"]))
        T, weighed = _with_prediction(T, uncertainty, prediction, frame.reach, settings["reach"])
        held = held_notes(uncertainty.directions, weighed.directions)
        notes, uncertainty = (*held, *notes), weighed
    verdict = judge(_evidence(place, usual, uncertainty, settings["near"]))
    for doubt in doubts:
        verdict = verdict.doubted(doubt)
    reasons = (*verdict.reasons, *notes)
    if uncertainty is None:
        return without_pose(reasons, run.status, settings)
    return Registration(
        T_target_source=T,
        verdict=verdict.saying(verdict.level, reasons),
        status=run.status,
        covariance=uncertainty.covariance,
        observability=uncertainty.directions,
        alternatives=place.rivals,
        history=run.history,
        rms=run.rms,
        inlier_fraction=run.inlier_fraction,
        timings={},
        settings={**settings, "centre": T[:3, 3].tolist(), "width": run.mixture.scale},
        partial_information=uncertainty.partial_information,
    )


def _evidence(place: ComparedFrame, usual: float, uncertainty: Uncertainty | None, max_distance: float) -> Evidence:
    """What a frame gives the verdict to judge by."""
    run = place.aligned
    return Evidence(
        status=run.status,
        found=run.found,
        inliers=float(run.weights.sum()),
        share_near=run.inlier_fraction,
        near=np.inf,
        usual=usual,
        width=run.mixture.scale,
        max_distance=max_distance,
        directions=uncertainty.directions if uncertainty else (),
        # Not measured: a map has no smooth patches, and a scene no shape that a frame could depart from.
        patches=0,
        patches_off=0.0,
        strays=0.0,
        normals_apart=0.0,
        expected=0.0,
        alternatives=place.rivals,
        looked_through=place.looked_through,
    )


def _with_prediction(
    T: FloatArray, uncertainty: Uncertainty, prediction: Prediction, lever: float, reach: float
) -> tuple[FloatArray, Uncertainty]:
    """The pose weighed with a prediction: it decides what the frame leaves free."""
    partial = uncertainty.partial_information
    if partial is None:
        partial = np.asarray(np.linalg.pinv(uncertainty.covariance, hermitian=True), dtype=np.float64)
    T, covariance = prediction.fused(T, partial)
    return T, Uncertainty(covariance, held_directions(uncertainty.directions, covariance, lever, reach))


def information_of_place(place: ComparedFrame, reach: float) -> Information | None:
    """Information of a frame where it was placed, which nothing changes that was seen there; None without a pose."""
    run = place.aligned
    if not run.found or not run.inlier_fraction >= LOST_FRACTION:
        return None
    return information_at(run, reach, place.axis if place.is_free else None)


def information_at(run: Alignment, reach: float, free_axis: FloatArray | None = None) -> Information:
    """Information of the six motions about the sensor.

    A wall that lies two centimetres off in the map shifts all of its points the same way; taken as independent, they
    would promise a tenth of a millimetre. So the scatter is estimated from patch to patch.
    """
    from dqreg.kernels.steps.plane_steps import weigh_by_roughness

    T, pairs = run.T_target_source, run.pairs
    points, normals = single_pose.apply(T, pairs.scan.points), pairs.closest.normals
    along = row_dots(points - pairs.closest.points, normals)
    weights = np.where(nonzero_rows(normals), run.weights, 0.0)
    if isinstance(pairs.closest, MapPlanes):
        weigh_by_roughness(weights, as_plain(pairs.closest.roughness), run.mixture.scale)
    centre = T[:3, 3]
    matches = points, normals, along, weights, reach, centre
    variances = pairs.closest.variances
    noise = weights if variances is None else weights * np.minimum(variances, 1.0)
    found = information_of(*matches, patchwise=True)
    information = _without_spurious(found, (points - centre) / reach, normals, noise)
    if free_axis is None and not information.free.any():
        return information
    if free_axis is not None:
        information = _without(information, np.concatenate([np.zeros(3), free_axis]))
    twists = information.vectors[:, ~information.free] / twist.scaling_by(reach)[:, None]
    if not twists.shape[1]:
        return information
    # What is free now was not when the scatter was estimated.
    scatter = information_of(*matches, patchwise=True, allowed=twists).scatter
    return dataclasses.replace(information, scatter=scatter)


def _without_spurious(
    information: Information, arms: FloatArray, normals: FloatArray, noise: FloatArray
) -> Information:
    """Information with the motions free that only the noise of the normals constrains."""
    spurious = across_normals(information.vectors, arms, normals, 0.5 * noise) / max(information.weight, TINY)
    values = np.where(information.values < SPURIOUS_INFORMATION_RATIO * spurious, 0.0, information.values)
    order = np.argsort(values, kind="stable")
    return dataclasses.replace(
        information,
        values=values[order],
        vectors=information.vectors[:, order],
        carriers=information.carriers[order],
    )


def across_normals(motions: FloatArray, arms: FloatArray, normals: FloatArray, weights: FloatArray) -> FloatArray:
    """Weighted sum of what motions, (6, k) one a column, move points by across their normals, squared: (k,).

    All of each motion less what goes along the normal: quadratic forms, from sums over the points.
    """
    none, all_rows = np.zeros(len(arms)), np.zeros(1, dtype=np.int64)
    along = MotionSums.of(arms, normals, normals, none, weights, np.zeros(3), 1.0, all_rows, np.eye(6)).information()
    weighed = arms * weights[:, None]
    second, whole = product(weighed.T, arms), float(weights.sum()) * np.eye(6)
    whole[:3, :3] = np.trace(second) * np.eye(3) - second
    whole[:3, 3:] = single_pose.cross_matrix(*np.einsum("ij->j", weighed))
    whole[3:, :3] = whole[:3, 3:].T
    across = whole - along
    return np.asarray(np.einsum("ik,ij,jk->k", motions, across, motions))


def _without(information: Information, motion: FloatArray) -> Information:
    """Information with one motion free, a unit vector (6,)."""
    kept = np.eye(6) - np.outer(motion, motion)
    full = kept @ (information.vectors * information.values) @ information.vectors.T @ kept
    values, vectors = np.linalg.eigh(full)
    # Rounding must not hold what is free; the points that carry a motion are those of the motions that it is made of.
    values[0], overlap = 0.0, (vectors.T @ information.vectors) ** 2
    return dataclasses.replace(
        information, values=np.maximum(values, 0.0), vectors=vectors, carriers=overlap @ information.carriers
    )


class MapLink:
    """Whether the map hangs on a frame that was not accepted."""

    def __init__(self, *, is_held: bool = False) -> None:
        # That frame; for good, or until a frame fits that cannot have slid.
        self._frame: int | None = None
        self._for_good = False
        self.is_held = is_held  # Whether the last frame that entered left no motion free; the first one was not asked

    @staticmethod
    def hanging_on(number: int) -> MapLink:
        """Of a map that hangs on a frame for good."""
        link = MapLink()
        link._frame, link._for_good = number, True
        return link

    def slides(self, result: Registration) -> bool:
        """Whether a frame leaves a motion free where the one before left none: the map is better off without it.

        One of a few points, or of the ground alone: all that hang on it would be doubted. A corridor goes on for longer
        than such frames are kept out.
        """
        return self.is_held and "unconstrained" in result.verdict.codes

    def linked(self, result: Registration, place: ComparedFrame, number: int, *, merged: bool) -> Registration:
        """The result of a frame, doubted where it hangs on an earlier one that was not accepted."""
        accepted = result.verdict.level == "accepted"
        if self._frame is not None and not self._for_good and accepted and not place.is_weak:
            self._frame = None
        before, unknown = self._frame, PLACE_UNKNOWN.intersection(result.verdict.codes)
        # One that slides and stays out is as good as none.
        if unknown and (merged or not self.slides(result)):
            self._for_good = self._for_good or merged
            self._frame = number if before is None and (merged or place.is_weak) else before
        if merged:
            self.is_held = "unconstrained" not in result.verdict.codes
        if before is None:
            return result
        words = (
            f"frame {before} was not accepted, and this pose hangs on it: it may be right against the frames since and "
            "wrong against those before; relocalise tells, or reset begins anew; prediction= with its covariance at "
            "such a frame prevents it"
        )
        return dataclasses.replace(result, verdict=result.verdict.doubted(Reason(words, "untrusted_map")))


def first_frame(T_map_frame: FloatArray, notes: tuple[Reason, ...], settings: dict[str, Any]) -> Registration:
    """Result of the frame that the map begins with."""
    reason = Reason("the first frame: its pose defines the frame of the map", "first_frame")
    return unmeasured(T_map_frame, Verdict("accepted", (reason, *notes)), "first frame", 0.0, settings)
