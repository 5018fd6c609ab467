"""One cost for points, planes, lines and directions: a quadratic form of the pose, additive over features.

With ``y = (vec R, t, 1)``, R row by row, every feature costs ``y^T M y``:

=========  ==============================  ====================
feature    cost                            A
=========  ==============================  ====================
point      ``w |R p + t - q|^2``           identity
plane      ``w (n . (R p + t - q))^2``     ``n^T``
line       ``w |A (R p + t - q)|^2``       ``I - d d^T``
direction  ``w |R m - n|^2``               (t does not enter)
=========  ==============================  ====================

so one 13x13 matrix holds any number of them. Coordinates are taken relative to an origin on either side, because the
squares of far-away coordinates would swallow the residuals.

Exact first and second derivatives of a quadratic form of the pose, by its motions.

`derivatives` are by left twists about the target origin of the form: ``T = about(exp(twist), origin) @ T0``.
`split_derivatives` are by a rotation about any point and a translation after it: the same to first order, and cheaper.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import one_line
from dqreg.rigid import pose
from dqreg.solvers.moments import Moments, scaled

# Rows built in one step: 13 numbers each stay in the second-level cache.
CHUNK_ROWS = 4096
# Rows of a Jacobian that are written in one go.
JACOBIAN_ROWS = 16_384


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticForm:
    """Matrix of the cost, relative to an origin on either side."""

    # (13, 13): Symmetric; acts on (R row by row, t, 1) with t relative to the origins: ``t + R c_source - c_target``
    matrix: FloatArray
    # origin_source, origin_target: (3,): What was subtracted from the coordinates
    origin_source: FloatArray
    origin_target: FloatArray
    # Sums over the features where all are points and directions: of narrow ones they hold more digits than the matrix
    moments: Moments | None = None

    __repr__ = one_line

    def __add__(self, other: QuadraticForm) -> QuadraticForm:
        # The origin of directions means nothing; elsewhere the stiffer part has more to lose.
        own, theirs = float(np.trace(self.matrix[9:12, 9:12])), float(np.trace(other.matrix[9:12, 9:12]))
        share = theirs / (own + theirs) if theirs > 0.0 else 0.0
        source = self.origin_source + share * (other.origin_source - self.origin_source)
        target = self.origin_target + share * (other.origin_target - self.origin_target)
        matrix = self.about(source, target).matrix + other.about(source, target).matrix
        both = None if self.moments is None or other.moments is None else self.moments + other.moments
        return QuadraticForm(matrix, source, target, both)

    def __mul__(self, factor: float) -> QuadraticForm:
        moments = None if self.moments is None else scaled(self.moments, factor)
        return QuadraticForm(factor * self.matrix, self.origin_source, self.origin_target, moments)

    def about(self, origin_source: FloatArray, origin_target: FloatArray) -> QuadraticForm:
        """The same cost relative to other origins, (3,) each."""
        # t = t' + R (c_s - c_s') - (c_t - c_t'), linear in y'.
        change = np.eye(13)
        change[9:12, :9] = np.kron(np.eye(3), self.origin_source - origin_source)
        change[9:12, 12] = origin_target - self.origin_target
        return QuadraticForm(change.T @ self.matrix @ change, origin_source, origin_target, self.moments)

    def between(self, origin_source: FloatArray, origin_target: FloatArray) -> QuadraticForm:
        """The same cost for poses between coordinates that count from other points, (3,) each."""
        m = self.moments
        if m is not None:
            m = dataclasses.replace(
                m, mean_source=m.mean_source - origin_source, mean_target=m.mean_target - origin_target
            )
        return QuadraticForm(self.matrix, self.origin_source - origin_source, self.origin_target - origin_target, m)

    @property
    def scale(self) -> float:
        """Size of the numbers that the cost is summed from: 1e-15 of it is rounding."""
        return max(float(self.matrix[12, 12]), float(np.trace(self.matrix[:9, :9])) / 3.0, np.finfo(float).tiny)

    def coordinates(self, T: FloatArray) -> FloatArray:
        """The 13 numbers of a pose T_target_source, (4, 4)."""
        R = T[:3, :3]
        t = T[:3, 3] + R @ self.origin_source - self.origin_target
        return np.concatenate([R.ravel(), t, [1.0]])

    def twists_from(self, frame: FloatArray) -> FloatArray:
        """Matrix (6, 6) from twists of a frame T_target_frame to twists about the target origin."""
        placed = frame.copy()
        placed[:3, 3] -= self.origin_target
        return pose.adjoint(placed)

    def value(self, T: FloatArray) -> float:
        """Cost of a pose T_target_source, (4, 4)."""
        y = self.coordinates(T)
        return float(y @ self.matrix @ y)


def point_form(p: FloatArray, q: FloatArray, weights: FloatArray, origins: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Matrix of points p to points q, (n, 3) each, relative to the origins. Shapes: returns (13, 13)."""
    total = np.zeros((7, 7))
    rows = np.ones((7, min(CHUNK_ROWS, len(p))))
    for i in range(0, len(p), CHUNK_ROWS):
        part = slice(i, i + CHUNK_ROWS)
        block = rows[:, : len(p[part])]
        np.subtract(p[part].T, origins[0][:, None], out=block[:3])
        block[3] = 1.0
        np.subtract(q[part].T, origins[1][:, None], out=block[4:])
        # The root of the weight on both sides: a product with its own transpose costs half of a general one.
        block *= np.sqrt(weights[part])
        total += block @ block.T
    return isotropic_form(total)


def direction_form(m: FloatArray, n: FloatArray, weights: FloatArray) -> FloatArray:
    """Matrix of directions m to directions n, (n, 3) each; no origin enters. Shapes: returns (13, 13)."""
    total = np.zeros((7, 7))
    rows = np.zeros((7, min(CHUNK_ROWS, len(m))))
    for i in range(0, len(m), CHUNK_ROWS):
        part = slice(i, i + CHUNK_ROWS)
        block = rows[:, : len(m[part])]
        root = np.sqrt(weights[part])
        np.multiply(m[part].T, root, out=block[:3])
        np.multiply(n[part].T, root, out=block[4:])
        total += block @ block.T
    return isotropic_form(total)


def plane_form(
    p: FloatArray, q: FloatArray, normals: FloatArray, weights: FloatArray, origins: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Matrix of points p to planes through q with the given normals, (n, 3) each, relative to the origins.

    Shapes: returns (13, 13).
    """
    total = np.zeros((13, 13))
    rows, local, foot = (np.zeros((count, min(CHUNK_ROWS, len(p)))) for count in (13, 3, 3))
    for i in range(0, len(p), CHUNK_ROWS):
        part = slice(i, i + CHUNK_ROWS)
        size = len(p[part])
        block, x, n = rows[:, :size], local[:, :size], rows[9:12, :size]
        np.subtract(p[part].T, origins[0][:, None], out=x)
        np.multiply(normals[part].T, np.sqrt(weights[part]), out=n)
        for k in range(3):
            np.multiply(x, n[k], out=block[3 * k : 3 * k + 3])
        np.subtract(origins[1][:, None], q[part].T, out=foot[:, :size])
        np.einsum("ij,ij->j", n, foot[:, :size], out=block[12])
        total += block @ block.T
    return total


def plane_rows(points: FloatArray, normals: FloatArray, centre: FloatArray, lever: float) -> FloatArray:
    """Point-to-plane Jacobian by the six scaled motions (rotation about the centre times the lever, translation).

    Shapes: points, normals (n, 3), returns (6, n), one motion a row.
    """
    from dqreg.kernels.evidence.plane_rows import plane_row_columns
    from dqreg.kernels.threads import as_plain, over_chunks

    rows = np.zeros((6, len(points)))
    columns = as_plain(points), as_plain(normals), as_plain(centre)
    over_chunks(plane_row_columns, len(points), *columns, float(lever), rows, chunk=JACOBIAN_ROWS)
    return rows


def line_form(
    p: FloatArray, q: FloatArray, directions: FloatArray, weights: FloatArray, origins: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Matrix of points p to lines through q with the given directions, (n, 3) each, relative to the origins.

    Shapes: returns (13, 13).
    """
    # |(I - d d^T) x|^2 = |x|^2 - (d . x)^2.
    return point_form(p, q, weights, origins) - plane_form(p, q, directions, weights, origins)


def isotropic_form(sums: FloatArray) -> FloatArray:
    """Matrix of points or directions from their sums: the same 4x4 block for each row of (R, t).

    Shapes: sums (7, 7), returns (13, 13).
    """
    matrix = np.zeros((13, 13))
    for k in range(3):
        own = np.array([3 * k, 3 * k + 1, 3 * k + 2, 9 + k])
        matrix[np.ix_(own, own)] = sums[:4, :4]
        matrix[own, 12] = matrix[12, own] = -sums[:4, 4 + k]
    matrix[12, 12] = np.trace(sums[4:, 4:])
    return matrix


def isotropic_moments(form: QuadraticForm, *, placed: bool) -> Moments:
    """Moments of the points (placed) or directions whose matrix this is, about origins near the means."""
    M = form.matrix
    weight, H, squares = float(M[9, 9]), -M[:9, 12].reshape(3, 3), (float(np.trace(M[:3, :3])), float(M[12, 12]))
    nowhere, nothing = np.zeros(3), np.zeros((3, 3))
    if not placed:
        return Moments(0.0, nowhere, nowhere, nothing, 0.0, 0.0, H, *squares)
    if not weight > 0.0:
        return Moments(0.0, nowhere, nowhere, nothing, 0.0, 0.0, nothing, 0.0, 0.0)
    off_source, off_target = M[9, :3], -M[9:12, 12]
    return Moments(
        weight,
        form.origin_source + off_source / weight,
        form.origin_target + off_target / weight,
        H - np.outer(off_target, off_source) / weight,
        max(squares[0] - float(off_source @ off_source) / weight, 0.0),
        max(squares[1] - float(off_target @ off_target) / weight, 0.0),
        nothing,
        0.0,
        0.0,
    )


Slopes = tuple[FloatArray, FloatArray, FloatArray]

_GENERATORS = np.zeros((3, 3, 3))
for _k in range(3):
    _GENERATORS[_k] = np.cross(np.eye(3)[_k], np.eye(3)).T
_PRODUCTS = np.einsum("kia,lab->klib", _GENERATORS, _GENERATORS).reshape(9, 9)


def derivatives(form: QuadraticForm, T: FloatArray) -> Slopes:
    """Gradient and Hessian of the cost with respect to a left twist, at zero.

    From ``R' = (I + W + W^2/2) R`` and ``t' = (I + W + W^2/2) t + (I + W/2) v`` up to second order.

    Shapes: gradient (6,), hessian (6, 6), squares (6, 6).
    """
    y = form.coordinates(T)
    gradient, hessian, squares = split_derivatives(form, T[:3, :3], y, y[9:12])
    # exp(twist) carries the centre to v + w x v / 2, to second order.
    mixed = 0.5 * (_GENERATORS.transpose(0, 2, 1) @ gradient[3:])
    hessian[:3, 3:] += mixed
    hessian[3:, :3] += mixed.T
    return gradient, hessian, squares


def projected_form(form: QuadraticForm, T: FloatArray, held: FloatArray, tether: FloatArray) -> QuadraticForm:
    """A cost near a pose, to second order, without part of each twist from there; that part is tied to the pose.

    Shapes: held (6, 6), what leaves of a twist about the target's zero the part that counts, tether (6,), weights of
    the squares of the rest.
    """
    gradient, _, squares = derivatives(form, T)
    about = form.twists_from(np.eye(4))
    kept = about @ held @ np.linalg.inv(about)
    # The twist as a linear function of the pose: the skew part of R' R^T, and what carries the origin on.
    y = form.coordinates(T)
    twist = np.zeros((6, 13))
    twist[:3, :9] = 0.5 * (_GENERATORS @ T[:3, :3]).reshape(3, 9)
    twist[3:, :9] = -(_GENERATORS @ y[9:12]).T @ twist[:3, :9]
    twist[3:, 9:12], twist[3:, 12] = np.eye(3), -y[9:12]
    counted = kept @ twist
    rest = np.linalg.solve(about, twist - counted)
    matrix = 0.5 * counted.T @ squares @ counted + (rest.T * tether) @ rest
    slope = 0.5 * gradient @ counted
    matrix[:, 12] += slope
    matrix[12] += slope
    matrix[12, 12] += form.value(T)
    return QuadraticForm(matrix, form.origin_source, form.origin_target)


def split_derivatives(form: QuadraticForm, R: FloatArray, y: FloatArray, arm: FloatArray) -> Slopes:
    """Gradient and Hessian for a rotation about a point and a translation after it, at zero.

    ``R' = exp(w) R`` and ``t' = t + (exp(w) - I) arm + shift``, both along the target's axes.

    Shapes: R (3, 3), y (13,), gradient (6,), hessian (6, 6), squares (6, 6).
    """
    J = np.zeros((13, 6))
    J[:9, :3] = (_GENERATORS @ R).reshape(3, 9).T
    J[9:12, :3] = (_GENERATORS @ arm).T
    J[9:12, 3:] = np.eye(3)
    slope = 2.0 * form.matrix @ y
    squares = 2.0 * J.T @ form.matrix @ J
    hessian = squares.copy()
    # <slope, second derivative of y>: W_k W_l summed both ways, against (R, arm).
    pull = slope[:9].reshape(3, 3) @ R.T + np.outer(slope[9:12], arm)
    curved = (_PRODUCTS @ pull.ravel()).reshape(3, 3)
    hessian[:3, :3] += 0.5 * (curved + curved.T)
    return J.T @ slope, hessian, squares
