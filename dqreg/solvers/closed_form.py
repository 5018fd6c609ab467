"""The closed form of 1991 from the sums: a 4x4 eigenproblem for the rotation, then the translation.

For a unit quaternion r = (w, x, y, z) with the rotation R(r) the cost of matched points p, q and directions m, n,

    E = sum beta |R p + t - q|^2 + sum alpha |R m - n|^2,

is least for ``t = mean_q - R mean_p`` (Walker, Shao and Volz 1991, eq. 45), and then

    E = constant - 2 r^T N r,    constant = sum beta (|p'|^2 + |q'|^2) + sum alpha (|m|^2 + |n|^2),

with p', q' the points about their weighted means. N is linear in ``H = sum beta q' p'^T + sum alpha n m^T``:

        | Hxx+Hyy+Hzz  Hzy-Hyz       Hxz-Hzx       Hyx-Hxy      |
    N = | Hzy-Hyz      Hxx-Hyy-Hzz   Hxy+Hyx       Hxz+Hzx      |
        | Hxz-Hzx      Hxy+Hyx      -Hxx+Hyy-Hzz   Hyz+Hzy      |
        | Hyx-Hxy      Hxz+Hzx       Hyz+Hzy      -Hxx-Hyy+Hzz  |

so r is its eigenvector of the largest eigenvalue lambda_1. The paper's A (eq. 47) is ``2 N`` with every beta divided
by four, plus a multiple of the identity, and its order of components puts w last. N has trace zero: lambda_1 > 0
unless H = 0. With the singular values s1 >= s2 >= |s3| of H (s3 negative where det H is) lambda_1 = s1 + s2 + s3 and
``lambda_1 - lambda_2 = 2 (s2 + s3)``: the gap closes where H has rank one, as for points on a line. Near that the
eigenproblem loses twice the digits that the data lose, and `narrow` takes its place.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.rigid import quaternion
from dqreg.solvers.fit import Fit
from dqreg.solvers.matches import Matches
from dqreg.solvers.moments import Moments
from dqreg.solvers.narrow_data import is_narrow, long_axes, rotation_of
from dqreg.solvers.rounding import SAME_POINT, SMALLEST_DIFFERENCE, SMALLEST_GAP, rounding_of
from dqreg.solvers.uncertainty import FitUncertainty
from dqreg.solvers.undetermined_rotation import no_weight_message, undetermined

Why = Callable[[str], DegenerateGeometryError]


def solve_moments(moments: Moments) -> Fit:
    """Pose from the sums alone, without the points.

    Parameters
    ----------
    moments : Moments
        Finite sums over all matches.

    Returns
    -------
    Fit
        Its cost is ``constant - 2 lambda_1``, a difference of like numbers: its error is some 1e-15 of the constant,
        so an rms below 1e-7 of the size of the part is rounding. It is never negative: what rounding takes below
        zero is zero. `solve` and `cost_of_pose` evaluate the residuals where that matters. Its covariance takes the
        weights as 1 / variance: the sums do not know of how many matches they are.

    Raises
    ------
    DegenerateGeometryError
        If no point carries weight, or the matches leave a rotation unconstrained.

    Examples
    --------
    >>> from dqreg.solvers.moments import moments_of
    >>> p = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> solve_moments(moments_of(p, p + [1.0, 2.0, 3.0])).T_target_source[:3, 3].round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    return fit_of_moments(moments)


def fit_of_moments(moments: Moments, matches: Matches | None = None) -> Fit:
    """`solve_moments`; with the matches at hand, the message of an error knows more."""
    if not moments.point_weight > 0.0:
        raise DegenerateGeometryError(no_weight_message())
    r, lambda_1, gap, H = best_rotation(moments, matches)
    T = pose_from_quaternion(r, moments)
    # tr(R^T H) of the points alone; that of the directions is the rest of lambda_1.
    point_fit = float(np.vdot(T[:3, :3], moments.point_cross))
    point_cost = moments.spread_source + moments.spread_target - 2.0 * point_fit
    return Fit(
        T,
        max(moments.constant - 2.0 * lambda_1, 0.0),
        math.sqrt(max(point_cost, 0.0) / moments.point_weight),
        gap,
        uncertainty=FitUncertainty(H, moments.point_weight, moments.mean_target, 1.0),
    )


def best_rotation(moments: Moments, matches: Matches | None = None) -> tuple[FloatArray, float, float, FloatArray]:
    """Unit quaternion of least cost, lambda_1, the relative gap to lambda_2, and H (3, 3)."""
    H, reach, floor, placed = rotation_sums(moments)
    if moments.aligned is None or not is_narrow(H):
        values, vectors = np.linalg.eigh(quaternion_form(H))
        lambda_1, gap = float(values[3]), float(values[3] - values[2])
        r, floor = vectors[:, 3], floor + SMALLEST_DIFFERENCE * reach
    else:
        axes = long_axes(H)
        held = moments.aligned.turned(*axes)
        R, lambda_1, gap = rotation_of(held.points + held.directions if placed else held.directions, axes)
        r, floor = quaternion.from_matrix(R), SMALLEST_GAP * reach + held.floor(placed=placed)
    why: Why = lambda words: undetermined(words, moments, matches)  # noqa: E731
    return r, lambda_1, require_determined(lambda_1, gap, reach, floor, why), H


def rotation_sums(moments: Moments) -> tuple[FloatArray, float, float, bool]:
    """What decides the rotation: H, the largest lambda_1 it could have, and the part of H that may be rounding.

    The last says whether the points count: where they lie in one place, only the directions do. Shapes: H (3, 3).
    """
    m = moments
    root = math.sqrt(m.point_weight)
    # Squares of the farthest coordinates that are read would overflow.
    grains = SAME_POINT * root * math.hypot(*m.mean_source), SAME_POINT * root * math.hypot(*m.mean_target)
    sizes = math.sqrt(m.spread_source), math.sqrt(m.spread_target)
    reach = math.sqrt(m.length_source) * math.sqrt(m.length_target)
    if sizes[0] <= grains[0] or sizes[1] <= grains[1]:
        return m.direction_cross, reach, 0.0, False
    return m.point_cross + m.direction_cross, reach + sizes[0] * sizes[1], float(rounding_of(grains, sizes)), True


def rounding_gap(moments: Moments) -> float:
    """Gap that the rounding of the coordinates could make."""
    H, _, floor, placed = rotation_sums(moments)
    if moments.aligned is None or not is_narrow(H):
        return floor
    return moments.aligned.turned(*long_axes(H)).floor(placed=placed)


def require_determined(
    lambda_1: float, gap: float, reach: float, floor: float | None = None, why: Why = undetermined
) -> float:
    """Relative gap of the two largest eigenvalues, if it is more than rounding, that of a difference by default."""
    floor = SMALLEST_DIFFERENCE * reach if floor is None else floor
    relative = gap / lambda_1 if lambda_1 > 0.0 else 0.0
    if not gap > floor:
        of_reach, needed = (gap / reach, floor / reach) if reach > 0.0 else (0.0, 0.0)
        raise why(
            f"the relative gap of the two largest eigenvalues is {relative:.3g} ({of_reach:.3g} of what a perfect fit "
            f"of such data reaches; more than {needed:.3g} is needed)"
        )
    return relative


def quaternion_form(H: FloatArray) -> FloatArray:
    """N, the quadratic form of the rotation's fit ``tr(R(r)^T H) = r^T N r`` in the quaternion r = (w, x, y, z).

    Shapes: H (3, 3).
    """
    # Plain numbers: sixteen of them are quicker so than as arrays, and the loop calls this once a step.
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = H.tolist()
    wx, wy, wz = zy - yz, xz - zx, yx - xy
    return np.array(
        (
            (xx + yy + zz, wx, wy, wz),
            (wx, xx - yy - zz, xy + yx, xz + zx),
            (wy, xy + yx, yy - xx - zz, yz + zy),
            (wz, xz + zx, yz + zy, zz - xx - yy),
        )
    )


def pose_from_quaternion(r: FloatArray, moments: Moments) -> FloatArray:
    """4x4 pose with the rotation of r that carries the source's mean to the target's. Shapes: r (4,)."""
    w, x, y, z = r.tolist()
    px, py, pz = moments.mean_source.tolist()
    qx, qy, qz = moments.mean_target.tolist()
    # R - I first: of small rotations of points far from the origin R mean_p would keep too few digits.
    xx, xy, xz = -2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    yx, yy, yz = 2.0 * (x * y + w * z), -2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    zx, zy, zz = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), -2.0 * (x * x + y * y)
    return np.array(
        (
            (1.0 + xx, xy, xz, (qx - px) - (xx * px + xy * py + xz * pz)),
            (yx, 1.0 + yy, yz, (qy - py) - (yx * px + yy * py + yz * pz)),
            (zx, zy, 1.0 + zz, (qz - pz) - (zx * px + zy * py + zz * pz)),
            (0.0, 0.0, 0.0, 1.0),
        )
    )
