"""`dqreg.solvers.hand_eye` (AX = XB) and `robot_world_hand_eye` (AX = YB): a sensor on a robot, calibrated.

The first estimate is in closed form, by dual quaternions (Daniilidis 1999); Gauss-Newton steps then reach the maximum
of the likelihood, which gives the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_float, require_finite
from dqreg._records import lock, one_line
from dqreg.errors import InputError
from dqreg.rigid import pose, quaternion
from dqreg.rigid._operands import as_rigid_poses
from dqreg.solvers.hand_eye_model import HandEyeEstimate, HandEyeNoise, estimate
from dqreg.solvers.hand_eye_start import require_axes, starts

# Rounds of estimating the noise from the residuals and X with that noise; they settle in three or four.
NOISE_ROUNDS = 8
SETTLED_LOG_RATIO = 1e-3
# Noise that stands for none: the rounding of a unit, of angles and of the largest length.
ROUNDING_NOISE = 1e-16
# Degrees of freedom of residuals that stand for none.
MIN_FREEDOM = 1e-3
# Stations up to which every two of them are a motion for the first estimate.
MAX_PAIRED_STATIONS = 30


@dataclass(frozen=True, eq=False)
class HandEyeFit:
    """Result of `hand_eye`.

    Attributes
    ----------
    X : ndarray, (4, 4)
        The transform with ``A X = X B``: T_hand_eye for motions A of the hand and B of the eye.
    covariance : ndarray, (6, 6)
        Of the left increment of X about its own origin ``X[:3, 3]``, rotation vector in radians first, then
        translation: ``X_true = pose.about(exp(e), X[:3, 3]) @ X``. Where the noise is estimated, it is that of
        Student's t; NaN where two degrees of freedom or fewer are left for it.
    rotation_residuals : ndarray, (n,)
        Angle in radians between each B and what A and X predict of it.
    translation_residuals : ndarray, (n,)
        Distance of their translations.
    sigma_rotation, sigma_translation : float
        Noise of B, a component, in radians and lengths: as given, or from the residuals.

    Examples
    --------
    >>> HandEyeFit(np.eye(4), np.zeros((6, 6)), np.zeros(3), np.zeros(3), 0.0, 0.0).X[3].tolist()
    [0.0, 0.0, 0.0, 1.0]
    """

    __repr__ = one_line
    X: FloatArray
    covariance: FloatArray
    rotation_residuals: FloatArray
    translation_residuals: FloatArray
    sigma_rotation: float
    sigma_translation: float

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True, eq=False)
class RobotWorldFit(HandEyeFit):
    """Result of `robot_world_hand_eye`.

    Attributes
    ----------
    Y : ndarray, (4, 4)
        The other transform of ``A X = Y B``; its covariance are the last six rows and columns of ``covariance``,
        (12, 12), of the left increments of X and of Y, each about its own origin.
    """

    __repr__ = one_line
    Y: FloatArray


def hand_eye(
    A: ArrayLike, B: ArrayLike, *, sigma_A: ArrayLike | None = None, sigma_B: ArrayLike | None = None
) -> HandEyeFit:
    """Transform X with ``A X = X B`` for motions of a hand and of the sensor that is fixed to it.

    Parameters
    ----------
    A, B : array_like, (n, 4, 4)
        Motions, from two stations each: ``A = inverse(T_base_hand_1) @ T_base_hand_2`` and
        ``B = T_eye1_target @ inverse(T_eye2_target)``, where X is T_hand_eye. At least two with axes that are not
        parallel. Where several motions share a station, `robot_world_hand_eye` is the better model: it takes the
        stations themselves.
    sigma_A, sigma_B : array_like, (2,), optional
        Noise of the rotations (radians) and of the translations (lengths), a component, the same for all motions.
        Where neither is given, A is exact and the noise of B is estimated from the residuals; else the side that is not
        given is exact.

    Returns
    -------
    HandEyeFit

    Raises
    ------
    InputError
        If a shape, a pose or a number is wrong.
    DegenerateGeometryError
        If the motions leave X open: one motion only, no rotation, or parallel axes, within the noise.

    Notes
    -----
    With noise of both sides B is compared with what A predicts of it, each residual weighed by the noise of B and by
    that of A as it arrives there. The maximum of this likelihood is sought from two closed forms, and the higher taken.

    Examples
    --------
    >>> X = pose.exp([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    >>> B = np.array([pose.exp([1.0, 0, 0, 0, 1, 0]), pose.exp([0, 1.0, 0, 2, 0, 0]), pose.exp([0, 0.5, 1.0, 0, 0, 1])])
    >>> bool(np.allclose(hand_eye(X @ B @ pose.inverse(X), B).X, X, rtol=0, atol=1e-12))
    True
    """
    a, b = _read(A, B)
    given = _read_noise(sigma_A, sigma_B)
    require_axes(a)
    found = starts(a, b)
    best = _most_likely(a, b, [(X, None) for X in found], given)
    require_axes(a, _noise_of(best[1], given))
    return HandEyeFit(best[0].X, *_results(*best, given))


def robot_world_hand_eye(
    A: ArrayLike, B: ArrayLike, *, sigma_A: ArrayLike | None = None, sigma_B: ArrayLike | None = None
) -> RobotWorldFit:
    """Transforms X and Y with ``A X = Y B`` for the stations of a robot and what a sensor measures there.

    Sensor on the hand, target fixed: ``robot_world_hand_eye(inverse(T_base_hand), T_eye_target)`` gives T_base_target
    as X and T_hand_eye as Y. Sensor fixed, target on the hand: ``robot_world_hand_eye(T_base_hand, T_eye_target)``
    gives T_hand_target as X and T_base_eye as Y.

    Parameters
    ----------
    A, B : array_like, (n, 4, 4)
        Poses at n >= 3 stations. B is what is measured, as it is measured: the noise of its rotation and of its
        translation are taken as independent.
    sigma_A, sigma_B : array_like, (2,), optional
        As in `hand_eye`, of the poses.

    Returns
    -------
    RobotWorldFit

    Raises
    ------
    InputError
        If a shape, a pose or a number is wrong.
    DegenerateGeometryError
        As `hand_eye`, for the motions between the stations.

    Examples
    --------
    >>> X, Y = pose.exp([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]), pose.exp([0, 0, 1.0, 5.0, 0, 0])
    >>> A = np.array([pose.exp(e) for e in ([0, 0, 0, 0, 0, 0], [1.0, 0, 0, 1, 0, 0], [0, 1.0, 0, 0, 2, 0])])
    >>> bool(np.allclose(robot_world_hand_eye(A, pose.inverse(Y) @ A @ X).Y, Y, rtol=0, atol=1e-12))
    True
    """
    a, b = _read(A, B)
    given = _read_noise(sigma_A, sigma_B)
    i, j = _pairs(len(a))
    motions = pose.inverse(a[j]) @ a[i], pose.inverse(b[j]) @ b[i]
    require_axes(motions[0])
    found = [(X, _middle(a @ X @ pose.inverse(b))) for X in starts(*motions)]
    best = _most_likely(a, b, found, given)
    require_axes(motions[0], _noise_of(best[1], given))
    return RobotWorldFit(best[0].X, *_results(*best, given), best[0].Y)


def _read(A: ArrayLike, B: ArrayLike) -> tuple[FloatArray, FloatArray]:
    a, b = as_rigid_poses(A, "A"), as_rigid_poses(B, "B")
    if a.ndim != 3 or a.shape != b.shape:
        raise InputError(f"A and B must both have shape (n, 4, 4); got {a.shape} and {b.shape}")
    return a, b


def _read_noise(sigma_A: ArrayLike | None, sigma_B: ArrayLike | None) -> HandEyeNoise | None:
    if sigma_A is None and sigma_B is None:
        return None
    pairs = []
    for name, value in (("sigma_A", sigma_A), ("sigma_B", sigma_B)):
        pair = np.zeros(2) if value is None else as_float(value, name)
        require_finite(pair, name)
        if pair.shape != (2,) or pair.min() < 0.0:
            raise InputError(f"{name} must be two numbers of 0 or more, radians and a length; got {value!r}")
        pairs.append(pair)
    total = pairs[0] + pairs[1]
    if not total.min() > 0.0:
        raise InputError(f"the noise of rotations and that of translations must be above 0 in A or in B; got {total}")
    return HandEyeNoise(*map(float, (*pairs[0], *pairs[1])))


def _pairs(count: int) -> tuple[IntArray, IntArray]:
    if count <= MAX_PAIRED_STATIONS:
        return (both := np.argwhere(np.tri(count, k=-1) > 0))[:, 1], both[:, 0]
    first = np.arange(count)
    return np.tile(first, 3), np.concatenate([np.roll(first, k) for k in (1, count // 3, count // 2)])


def _middle(poses: FloatArray) -> FloatArray:
    q = quaternion.from_matrix(poses[:, :3, :3])
    # The mean of quaternions whatever their signs: the main axis of their spread.
    mean = np.linalg.eigh(q.T @ q)[1][:, 3]
    return pose.from_parts(quaternion.to_matrix(mean), poses[:, :3, 3].mean(axis=0))


def _most_likely(
    A: FloatArray, B: FloatArray, found: Sequence[tuple[FloatArray, FloatArray | None]], given: HandEyeNoise | None
) -> tuple[HandEyeEstimate, HandEyeNoise]:
    length = float(np.abs(np.concatenate([A[:, :3, 3], B[:, :3, 3]])).max()) or 1.0
    noise = given or HandEyeNoise(0.0, 0.0, 1.0, length)
    ends = [estimate(A, B, X, Y, noise) for X, Y in found]
    best = min(ends, key=lambda end: end.cost)
    if given is not None:
        return best, given
    Y = None if found[0][1] is None else best.Y
    for _ in range(NOISE_ROUNDS):
        before = noise
        squares = [float(np.square(r).sum()) for r in (best.rotations, best.translations)]
        rotation, shift = (np.sqrt(s / max(left, MIN_FREEDOM)) for s, left in zip(squares, best.left, strict=True))
        noise = replace(noise, turn_b=max(rotation, ROUNDING_NOISE), shift_b=max(shift, ROUNDING_NOISE * length))
        best = estimate(A, B, best.X, None if Y is None else best.Y, noise)
        change = [noise.turn_b / before.turn_b, noise.shift_b / before.shift_b]
        if np.abs(np.log(change)).max() < SETTLED_LOG_RATIO:
            break
    return best, noise


def _noise_of(noise: HandEyeNoise, given: HandEyeNoise | None) -> float:
    # Noise of a rotation vector between two stations, or of a motion; estimated noise of exact data is rounding.
    return float(np.hypot(noise.turn_a, noise.turn_b)) if given else noise.turn_b


def _results(
    best: HandEyeEstimate, noise: HandEyeNoise, given: HandEyeNoise | None
) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
    information = best.information
    if given is None:
        # Estimated noise is uncertain itself: the errors follow Student's t, with a variance larger by v / (v - 2).
        left = np.array(best.left)
        shrunk = np.repeat(np.sqrt(np.maximum(1.0 - 2.0 / np.maximum(left, MIN_FREEDOM), 0.0)), 3)
        J = best.jacobian * shrunk[:, None]
        information = np.einsum("nij,nik->jk", J, J)
    scale = np.sqrt(best.information.diagonal())
    covariance = np.linalg.pinv(information / scale / scale[:, None], hermitian=True) / scale / scale[:, None]
    if given is None and min(best.left) <= 2.0:
        covariance = np.full_like(covariance, np.nan)
    residuals = (np.linalg.norm(r, axis=1) for r in (best.rotations, best.translations))
    return covariance, *residuals, noise.turn_b, noise.shift_b
