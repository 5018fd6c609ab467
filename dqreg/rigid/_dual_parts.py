"""Arithmetic of unit dual quaternions on stacks of their parts: real and dual, (..., 4) each, scalar first.

Equation numbers: Walker, Shao and Volz (1991). Their quaternions carry the scalar last, ours first; r4 and s4
are the scalars of the real and of the dual part.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, as_float, require_finite
from dqreg.errors import InputError
from dqreg.rigid._algebra import canonical_sign, multiply
from dqreg.rigid._operands import as_directions, as_triples
from dqreg.rigid.screw import DualNumber, Screw, plain

Parts = tuple[FloatArray, FloatArray]

# Far above the rounding of one operation, far below anything a careless caller gives.
UNIT_TOLERANCE = 1e-9
# Below it floating point has no relative precision to hold anyone to.
SMALLEST_NUMBER = float(np.finfo(np.float64).tiny)
# Half-angles below four rounding steps are noise of the real part, not a rotation.
_NO_TURN = 4.0 * float(np.finfo(np.float64).eps)
# (a cos(a) - sin(a)) / a^3 as a series in a^2, exact to rounding below the limit.
_SINC_SLOPE = tuple((-1.0) ** n * 2.0 * n / float(np.prod(np.arange(1.0, 2 * n + 2))) for n in range(1, 9))
_SERIES_RAD = 0.5


def constraint_residuals(real: FloatArray, dual: FloatArray) -> Parts:
    """``r . r - 1`` and ``r . s`` (eqs. 13-14), (...) each."""
    return _dot(real, real) - 1.0, _dot(real, dual)


def is_unit(real: FloatArray, dual: FloatArray) -> bool:
    """Whether the constraints hold everywhere."""
    unit_residual, perpendicular_residual = constraint_residuals(real, dual)
    return bool(
        # Written so that NaN fails; the dual part is a length, so its tolerance is relative.
        np.all(np.abs(unit_residual) <= UNIT_TOLERANCE) and np.all(np.abs(perpendicular_residual) <= _allowed(dual))
    )


def require_unit(real: FloatArray, dual: FloatArray) -> None:
    """Raise where the parts break the constraints."""
    if is_unit(real, dual):
        return
    unit_residual, perpendicular_residual = constraint_residuals(real, dual)
    off = ~(np.abs(unit_residual) <= UNIT_TOLERANCE)
    if off.any():
        raise InputError(
            f"the real part of a unit dual quaternion has norm 1; its square is off by {_worst(unit_residual):.3g}"
            f"{_where(off)} (allowed {UNIT_TOLERANCE:g}). Use from_array(..., normalize=True), or normalized(), "
            "if a scale is not meant"
        )
    off = ~(np.abs(perpendicular_residual) <= _allowed(dual))
    raise InputError(
        f"the parts of a unit dual quaternion are perpendicular; their product is {_worst(perpendicular_residual):.3g} "
        f"for a dual part with components up to {np.abs(dual).max():.3g}{_where(off)}"
    )


def onto_constraints(real: FloatArray, dual: FloatArray) -> Parts:
    """Our own results without their rounding, so that it does not pile up in long products."""
    # The translation does not depend on the part of `dual` along `real`. The second pass is for duals of rounding only.
    real = real / np.sqrt(_dot(real, real))[..., np.newaxis]
    for _ in range(2):
        dual = dual - _dot(real, dual)[..., np.newaxis] * real
    return real, dual


def product(a: Parts, b: Parts) -> Parts:
    """The product of any two (eq. 51): as motions, b followed by a."""
    return multiply(a[0], b[0]), multiply(a[0], b[1]) + multiply(a[1], b[0])


def with_translation(real: FloatArray, t: FloatArray) -> Parts:
    """Rotation and translation (eq. 25)."""
    # s = W(r) t with the translation quaternion (0, t) / 2.
    return onto_constraints(real, multiply(_pure(t / 2.0), real))


def translation(real: FloatArray, dual: FloatArray) -> FloatArray:
    """``t = 2 (r4 s - s4 r + r x s)``, (..., 3): the vector part of 2 dual real* (eqs. 19-20, 61-69)."""
    w, x, y, z = np.moveaxis(real, -1, 0)
    s0, s1, s2, s3 = np.moveaxis(dual, -1, 0)
    t = np.stack(
        [
            w * s1 - s0 * x + y * s3 - z * s2,
            w * s2 - s0 * y + z * s1 - x * s3,
            w * s3 - s0 * z + x * s2 - y * s1,
        ],
        axis=-1,
    )
    return np.asarray(2.0 * t)


def rotated(real: FloatArray, vectors: FloatArray) -> FloatArray:
    """``q v q*`` (..., 3) of unit quaternions: v + 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = np.moveaxis(real, -1, 0)
    a, b, c = np.moveaxis(vectors, -1, 0)
    # Twice the cross product, column by column: `np.cross` takes three times as long.
    d, e, f = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    columns = (a + w * d + (y * f - z * e), b + w * e + (z * d - x * f), c + w * f + (x * e - y * d))
    return np.stack(columns, axis=-1)


def exp(twist: ArrayLike) -> Parts:
    """Screw motions of twists (..., 6): the exponential of ``(0, w/2) + eps (0, v/2)``."""
    numbers = as_float(twist, "twist")
    if numbers.shape[-1:] != (6,):
        raise InputError(f"twist must hold six numbers, rotation first, then translation; got {numbers.shape}")
    require_finite(numbers, "twist")
    h, g = numbers[..., :3] / 2.0, numbers[..., 3:] / 2.0
    angle = np.sqrt(_dot(h, h))
    sinc, along = np.sinc(angle / np.pi), _dot(h, g)
    # The derivative of cos(|h|) + sinc(|h|) h along g.
    dual = _join(-sinc * along, sinc[..., np.newaxis] * g + (_sinc_slope(angle) * along)[..., np.newaxis] * h)
    return onto_constraints(_join(np.cos(angle), sinc[..., np.newaxis] * h), dual)


def log(real: FloatArray, dual: FloatArray, shorter_turn: bool = True) -> FloatArray:
    """Twists (..., 6) of unit dual quaternions; of both signs that of the smaller rotation, or of the one given."""
    if shorter_turn:
        sign = canonical_sign(real)[..., np.newaxis]
        real, dual = sign * real, sign * dual
    r4, r, s4, s = real[..., 0], real[..., 1:], dual[..., 0], dual[..., 1:]
    sine = np.sqrt(_dot(r, r))
    angle = np.arctan2(sine, r4)
    sinc = np.sinc(angle / np.pi)
    full = (sine <= _NO_TURN) & (r4 < 0.0)  # minus one: a full turn, about the line along which it moves
    sinc = np.where(full, 1.0, sinc)[..., np.newaxis]
    h = r / sinc
    # Both s . n and s4 hold the shift along the axis; weighed by cosine and sine, they divide by nothing.
    along = r4 * _dot(s, h) - angle * sine * s4
    g = (s - (_sinc_slope(angle) * along)[..., np.newaxis] * h) / sinc
    if full.any():
        shift = np.linalg.norm(s, axis=-1, keepdims=True)
        line = np.where(shift > 0.0, -s / np.where(shift > 0.0, shift, 1.0), [1.0, 0.0, 0.0])
        h, g = np.where(full[..., np.newaxis], np.pi * line, h), np.where(full[..., np.newaxis], -s, g)
    return np.concatenate([2.0 * h, 2.0 * g], axis=-1)


def from_screw(axis: ArrayLike, angle: ArrayLike, distance: ArrayLike, point: ArrayLike) -> Parts:
    """Real and dual part of a screw: sine and cosine of half the dual angle (eqs. 8-12)."""
    n, p = as_directions(axis, "axis"), as_triples(point, "point")
    theta, d = as_float(angle, "angle"), as_float(distance, "distance")
    for name, value in (("angle", theta), ("distance", d), ("point", p)):
        require_finite(value, name)
    half = DualNumber(theta / 2.0, d / 2.0)  # half of eq. 10
    sine, cosine = half.sin(), half.cos()
    moment = np.cross(p, n)  # dual part of the line's dual vector, eqs. 9 and 60
    sine_real, sine_dual = (np.asarray(value)[..., np.newaxis] for value in (sine.real, sine.dual))
    real = _join(np.asarray(cosine.real), sine_real * n)
    dual = _join(np.asarray(cosine.dual), sine_dual * n + sine_real * moment)
    # A single axis with several distances: every part takes the shape of them all.
    both = np.broadcast_arrays(real, dual)
    return both[0].copy(), both[1].copy()


def as_screw(real: FloatArray, dual: FloatArray) -> Screw:
    """Screw of a unit dual quaternion (appendix 3, eqs. 70-75, two of them corrected).

    Eq. 12 reads ``s = (d/2) cos(theta/2) n + sin(theta/2) m`` with the moment ``m = p x n``, and ``s4 = -(d/2)
    sin(theta/2)``.

    - Eq. 70 prints ``d = 2 s4 / sin(theta/2)``; by eq. 12 the sign is wrong, ``d = -2 s4 / sin(theta/2)``. As n is
      perpendicular to m, eq. 71 times n gives ``s . n = (d/2) cos(theta/2)`` too. The two are weighed by sine and
      cosine, ``d = 2 (cos(theta/2) s . n - sin(theta/2) s4)``, which divides by nothing.
    - Eqs. 71-73 then give m. Eq. 74 adds any multiple of n to a particular solution (not to a vector of the
      null space, as printed). Eq. 75 as printed is no solution, since it does not contain m. Two that are:
      ``(0, -m3, m2) / n1``, which solves ``p x n = m`` row by row with p1 = 0 and fails for n1 = 0; and
      ``n x m = p - (n . p) n``, the point nearest the origin, which never fails and is returned.

    Without a rotation there is no line: a pure translation has the axis ``t / |t|`` through the origin and the distance
    ``|t|``, the identity the axis x and the distance 0.
    """
    sign = canonical_sign(real)[..., np.newaxis]
    real, dual = sign * real, sign * dual
    r4, r, s4, s = real[..., 0], real[..., 1:], dual[..., 0], dual[..., 1:]
    # By the largest component first: squares of a shift of 1e-154 have no digits left.
    largest = np.abs(s).max(axis=-1)
    shift = s / np.where(largest > 0.0, largest, 1.0)[..., np.newaxis]
    sine, over = np.sqrt(_dot(r, r)), np.linalg.norm(shift, axis=-1)
    slides, half_shift = sine <= _NO_TURN, largest * over
    still = slides & (largest == 0.0)
    length = np.where(slides, np.where(still, 1.0, over), sine)[..., np.newaxis]
    n = np.where(still[..., np.newaxis], [1.0, 0.0, 0.0], np.where(slides[..., np.newaxis], shift, r) / length)
    half_distance = np.where(slides, half_shift, r4 * _dot(s, n) - sine * s4)
    # n x s / sin(theta/2) is n x m: the part of s along n drops out.
    point = np.where(slides[..., np.newaxis], 0.0, np.cross(n, s) / length)
    return Screw(n, plain(np.where(slides, 0.0, 2.0 * np.arctan2(sine, r4))), plain(2.0 * half_distance), point)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _join(scalar: FloatArray, vector: FloatArray) -> FloatArray:
    scalar = np.broadcast_to(scalar, vector.shape[:-1]) if scalar.shape != vector.shape[:-1] else scalar
    return np.concatenate([scalar[..., np.newaxis], vector], axis=-1)


def _pure(v: FloatArray) -> FloatArray:
    return _join(np.zeros(v.shape[:-1]), v)


def _sinc_slope(angle: FloatArray) -> FloatArray:
    """``(a cos(a) - sin(a)) / a^3``, the slope of sin(a) / a over a."""
    square = angle * angle
    small = angle < _SERIES_RAD
    series = np.polynomial.polynomial.polyval(np.where(small, square, 0.0), _SINC_SLOPE)
    large = np.where(small, 1.0, angle)
    return np.where(small, series, (large * np.cos(large) - np.sin(large)) / large**3)


def _allowed(dual: FloatArray) -> FloatArray:
    # The largest component, as a norm would square numbers of 1e-160 away.
    return np.asarray(UNIT_TOLERANCE * np.max(np.abs(dual), axis=-1) + SMALLEST_NUMBER)


def _worst(residual: FloatArray) -> float:
    flat = residual.ravel()
    return float(flat[np.argmax(np.where(np.isnan(flat), np.inf, np.abs(flat)))])


def _where(off: BoolArray) -> str:
    return f", the first at {tuple(int(i) for i in np.argwhere(off)[0])}" if off.ndim else ""
