"""Datum alignments: the pose that lays measured features on nominal ones, one after the other (ISO 5459, 3-2-1)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.inspection.alignment.earlier_steps import with_kept
from dqreg.inspection.alignment.priors import inverse_within, prior_about
from dqreg.inspection.features import Feature
from dqreg.rigid import pose, single_pose, twist
from dqreg.rigid.twist import scaling_by
from dqreg.solvers import Freedom

# A motion is constrained by a datum from that share of its full effect on: less of it is the tilt of a hole that
# another datum leaves as it is.
MIN_EFFECT_SHARE = 0.1
# An axis meets a plane where its cosine to the normal is more than that.
MEETING_COS = 0.1
# Gauss-Newton steps for each datum, and the step, in radians and sizes, that ends them.
MAX_ROUNDS, CONVERGED_STEP = 60, 1e-15
# Step of the numerical derivatives of the pose by the features' parameters, in their standard deviations.
NUDGE_SIGMAS = 1e-3
# And of those by where the pose begins, in radians and sizes.
START_STEP = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class Datum:
    """A feature that was measured and the nominal one that it is laid on.

    Attributes
    ----------
    name : str
        Its letter.
    measured, nominal : Feature
        In the scan's frame and in the part's frame.
    """

    name: str
    measured: Feature
    nominal: Feature


@dataclasses.dataclass(frozen=True, eq=False)
class DatumAlignment:
    """The pose of a datum reference frame.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Maps the measured features onto the nominal ones.
    covariance : ndarray, (6, 6)
        Of the left increment about ``centre`` (rotation vector, then translation), from the features' covariances.
    centre : ndarray, (3,)
        Point of the first nominal feature.
    constrained : dict
        Number of degrees of freedom that each datum constrains, by name.
    """

    T_target_source: FloatArray
    covariance: FloatArray
    centre: FloatArray
    constrained: dict[str, int]


def align_datums(
    datums: Sequence[Datum],
    start: ArrayLike | None = None,
    *,
    dof: Freedom | str | None = None,
    prior: tuple[ArrayLike, ArrayLike] | None = None,
) -> DatumAlignment:
    """The pose of a datum reference frame A | B | C.

    The first datum is laid on its nominal feature with all motions, each further one with the motions that are left:
    first its direction, then its place. A plane, a hole and a slot are a 3-2-1 alignment as three planes are; a second
    hole takes the last rotation.

    Parameters
    ----------
    datums : sequence of Datum
        In their order of precedence.
    start : array_like, (4, 4), optional
        A pose near the answer: it tells which way round axes are. Default: the pose of the prior, else the identity.
    dof : Freedom or str, optional
        Degrees of freedom away from the start; the others keep it exactly.
    prior : (pose, covariance), optional
        A pose known beforehand, as in `PoseCost.prior` about the first nominal point: it decides the motions that the
        datums leave open.

    Returns
    -------
    DatumAlignment
        With the covariance that follows from those of the measured features.

    Raises
    ------
    InputError
        If there are no datums, or a measured feature is of another kind than its nominal one.
    DegenerateGeometryError
        If they leave a degree of freedom unconstrained; the message says which datum constrains how many.

    Examples
    --------
    >>> from dqreg.inspection import fit_feature, part_faces
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> a, b, c = (part_faces(part)[k].feature for k in (0, 2, 4))
    >>> T = twist.exp([0.1, 0.0, 0.05, 0.3, 0.2, 0.1])
    >>> found = align_datums([Datum(n, f.moved(T), f) for n, f in zip("ABC", (a, b, c))])
    >>> bool(np.abs(found.T_target_source @ T - np.eye(4)).max() < 1e-12), found.constrained
    (True, {'A': 3, 'B': 2, 'C': 1})
    """
    _check(datums)
    centre = datums[0].nominal.point
    known = None if prior is None else prior_about(prior, centre, np.zeros(3))
    if start is None and prior is not None:
        start = prior[0]
    freedom = Freedom.parse("all" if dof is None else dof)
    begin = np.eye(4) if start is None else as_pose(start, "start")
    T, constrained, left = _solved(datums, begin, freedom)
    total = sum(constrained.values())
    if left.shape[1] and known is None:
        held = ", ".join(f"{name} {number}" for name, number in constrained.items())
        count = {6: "six", 5: "five", 4: "four", 3: "three", 2: "two", 1: "one"}[freedom.count]
        raise DegenerateGeometryError(
            f"the datums constrain {total} of {count} degrees of freedom ({held}); add a datum whose direction or "
            "place the others leave open"
        )
    covariance = _covariance(datums, T, centre, freedom, begin)
    if known is not None:
        covariance = covariance + inverse_within(known.information(T, centre), left)
    found = DatumAlignment(T, covariance, centre, constrained)
    return found if freedom.count == 6 else with_kept(found, _kept(datums, T, centre, freedom, begin))


def _check(datums: Sequence[Datum]) -> None:
    if not datums:
        raise InputError("a datum alignment needs datums: at least one feature with its nominal one")
    for datum in datums:
        if datum.measured.kind != datum.nominal.kind:
            raise InputError(
                f"datum {datum.name}: a {datum.measured.kind} was measured where the nominal feature is a "
                f"{datum.nominal.kind}"
            )


def _solved(
    datums: Sequence[Datum], start: FloatArray, freedom: Freedom
) -> tuple[FloatArray, dict[str, int], FloatArray]:
    """The pose, the degrees of freedom that each datum constrains, and twists about the centre that none does."""
    centre = datums[0].nominal.point
    size = _size(datums)
    scale = scaling_by(1.0, size)
    T, free = start, np.eye(6)
    if freedom.count < 6:
        free = np.linalg.qr(freedom.twists(start, start, centre) / scale[:, None])[0]
    constrained: dict[str, int] = {}
    for datum in datums:
        before = free.shape[1]
        for residual in (_direction, _place):
            T, free = _laid(T, free, datum, datums[0], residual, centre, size)
        constrained[datum.name] = before - free.shape[1]
    if freedom.count < 6:
        # Steps along the motions that were free at the start leave the locked ones to second order.
        T = freedom.project(T, start)
    return T, constrained, free * scale[:, None]


def _size(datums: Sequence[Datum]) -> float:
    """How far the datums are apart: a length for the unit of translations."""
    centre = datums[0].nominal.point
    return max((float(np.linalg.norm(datum.nominal.point - centre)) for datum in datums[1:]), default=1.0) or 1.0


def _laid(
    T: FloatArray, free: FloatArray, datum: Datum, first: Datum, residual: object, centre: FloatArray, size: float
) -> tuple[FloatArray, FloatArray]:
    """One residual of a datum brought to its least along the free motions, and the motions that are free after it."""
    assert callable(residual)
    for _ in range(MAX_ROUNDS if free.shape[1] else 0):
        values, slopes = residual(T, datum, first, centre, size)
        _, strengths, motions = np.linalg.svd(slopes @ free, full_matrices=True)
        held = motions[: int(np.count_nonzero(strengths > MIN_EFFECT_SHARE))]
        if not len(held):
            return T, free
        step = free @ held.T @ np.linalg.lstsq(slopes @ free @ held.T, -values, rcond=None)[0]
        T = pose.about(twist.exp(np.r_[step[:3], size * step[3:]]), centre) @ T
        if np.abs(step).max() < CONVERGED_STEP:
            break
    if free.shape[1]:
        _, slopes = residual(T, datum, first, centre, size)
        _, strengths, motions = np.linalg.svd(slopes @ free, full_matrices=True)
        free = free @ motions[int(np.count_nonzero(strengths > MIN_EFFECT_SHARE)) :].T
    return T, free


Rows = tuple[FloatArray, FloatArray]


def _direction(T: FloatArray, datum: Datum, first: Datum, centre: FloatArray, size: float) -> Rows:
    """Difference of the axes, and its derivatives by a rotation (radians) and a translation (sizes)."""
    if datum.measured.kind == "sphere":
        return np.zeros(1), np.zeros((1, 6))
    axis, nominal = T[:3, :3] @ datum.measured.axis, datum.nominal.axis
    axis = -axis if axis @ nominal < 0.0 else axis
    # A rotation vector w turns an axis a by w x a.
    return axis - nominal, np.hstack([-single_pose.cross_matrix(*axis), np.zeros((3, 3))])


def _place(T: FloatArray, datum: Datum, first: Datum, centre: FloatArray, size: float) -> Rows:
    """Distance of the places, across what the shape leaves open, in sizes, and its derivatives."""
    measured, nominal = _point(datum.measured, first.measured), _point(datum.nominal, first.nominal)
    at = pose.apply(T, measured)
    axis, kind = datum.nominal.axis, datum.nominal.kind
    seen = np.eye(3)
    if kind == "plane":
        seen = np.outer(axis, axis)
    elif kind in ("line", "cylinder", "circle"):
        seen = np.eye(3) - np.outer(axis, axis)
    arm = (at - centre) / size
    return seen @ (at - nominal) / size, seen @ np.hstack([-single_pose.cross_matrix(*arm), np.eye(3)])


def _point(feature: Feature, first: Feature) -> FloatArray:
    """The place of a feature: of an axis, where it meets the first datum's plane; of a cone, its apex."""
    if feature.kind == "cone":
        along = feature.radius / np.tan(feature.half_angle)
        apex: FloatArray = feature.point - along * feature.axis
        return apex
    if feature.kind in ("line", "cylinder") and first.kind == "plane":
        slope = float(feature.axis @ first.axis)
        if abs(slope) > MEETING_COS:
            meets: FloatArray = feature.point + (first.point - feature.point) @ first.axis / slope * feature.axis
            return meets
    return feature.point


def _covariance(
    datums: Sequence[Datum], T: FloatArray, centre: FloatArray, freedom: Freedom, start: FloatArray
) -> FloatArray:
    """First order: the pose's change by each parameter of each measured feature, one at a time."""
    total = np.zeros((6, 6))
    for k, datum in enumerate(datums):
        spread = datum.measured.covariance
        values, vectors = np.linalg.eigh(spread)
        for value, vector in zip(values, vectors.T, strict=True):
            if value <= 0.0:
                continue
            nudge = NUDGE_SIGMAS * float(np.sqrt(value)) * vector
            other = [*datums[:k], dataclasses.replace(datum, measured=datum.measured.nudged(nudge)), *datums[k + 1 :]]
            moved, *_ = _solved(other, T if freedom.count == 6 else start, freedom)
            change = twist.log(pose.about(moved @ pose.inverse(T), -centre)) / NUDGE_SIGMAS
            total += np.outer(change, change)
    return total


def _kept(
    datums: Sequence[Datum], T: FloatArray, centre: FloatArray, freedom: Freedom, start: FloatArray
) -> FloatArray:
    """How the pose follows a twist of its start about the centre, (6, 6): to first order, one motion at a time."""
    scale = START_STEP * scaling_by(1.0, _size(datums))
    found = np.zeros((6, 6))
    for k, step in enumerate(np.diag(scale)):
        moved, *_ = _solved(datums, pose.about(twist.exp(step), centre) @ start, freedom)
        found[:, k] = twist.log(pose.about(moved @ pose.inverse(T), -centre)) / scale[k]
    return found
