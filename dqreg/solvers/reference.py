"""`dqreg.solvers.svd` and `horn`: the pose by textbook formulas, plain and literal, to measure others by.

K. S. Arun, T. S. Huang and S. D. Blostein, "Least-squares fitting of two 3-D point sets", IEEE Transactions on
Pattern Analysis and Machine Intelligence 9 (1987), with the reflection-safe sign that later authors added.

B. K. P. Horn, "Closed-form solution of absolute orientation using unit quaternions" (1987), as derived in section 5
of Y.-B. Jia, *Quaternions* (2020), whose equation numbers stand at the lines. Weights and directions are ours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqreg.rigid.quaternion import to_matrix
from dqreg.solvers.fit import Fit
from dqreg.solvers.jia import M
from dqreg.solvers.least_squares import centre, fit_of_rotation
from dqreg.solvers.matches import read_matches


def svd(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
    *,
    absolute_weights: bool = False,
) -> Fit:
    """Pose of least cost by the singular value decomposition of H; a yardstick for `solve`.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Matched points p and q.
    directions_source, directions_target : array_like, (m, 3), optional
        Matched directions m and n, weighed as given.
    point_weights, direction_weights : array_like or float, optional
        beta and alpha; 1 where not given.
    absolute_weights : bool
        As in `solve`.

    Returns
    -------
    Fit
        The same cost and the same pose as `solve`, up to rounding.

    Raises
    ------
    InputError
        As `solve`, and for coordinates beyond 1e60 or apart by less than 1e-60.
    DegenerateGeometryError
        As `solve`.

    Examples
    --------
    >>> import numpy as np
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> svd(points, points + [1, 2, 3]).T_target_source[:3, 3].round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    matches = read_matches(
        points_source, points_target, directions_source, directions_target, point_weights, direction_weights
    )
    c = centre(matches)
    # H = sum beta p' q'^T + sum alpha m n^T (Arun eq. 11; ours adds weights and directions)
    H = (c.beta[:, None] * c.p).T @ c.q
    H += (c.alpha[:, None] * matches.directions_source).T @ matches.directions_target
    U, s, Vt = np.linalg.svd(H)  # H = U diag(s) V^T (Arun eq. 12)
    X = Vt.T @ U.T  # Arun eq. 13
    sign = 1.0 if np.linalg.det(X) > 0.0 else -1.0
    # det X = -1 is the best mirror image; the best rotation reverses the weakest direction.
    R = Vt.T @ np.diag([1.0, 1.0, sign]) @ U.T
    s1, s2, s3 = s[0], s[1], sign * s[2]
    # Eigenvalues of the 4x4 matrix by the singular values of H.
    return fit_of_rotation(R, float(s1 + s2 + s3), float(s1 - s2 - s3), matches, c, absolute_weights=absolute_weights)


def horn(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
    *,
    absolute_weights: bool = False,
) -> Fit:
    """Pose of least cost by unit quaternions with one 4x4 matrix a match; a yardstick for `solve`.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Matched points p and q.
    directions_source, directions_target : array_like, (m, 3), optional
        Matched directions m and n, weighed as given.
    point_weights, direction_weights : array_like or float, optional
        beta and alpha; 1 where not given.
    absolute_weights : bool
        As in `solve`.

    Returns
    -------
    Fit
        The same cost and the same pose as `solve`, up to rounding.

    Raises
    ------
    InputError
        As `solve`, and for coordinates beyond 1e60 or apart by less than 1e-60.
    DegenerateGeometryError
        As `solve`.

    Examples
    --------
    >>> import numpy as np
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    >>> horn(points, points + [1, 2, 3]).T_target_source[:3, 3].round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    matches = read_matches(
        points_source, points_target, directions_source, directions_target, point_weights, direction_weights
    )
    c = centre(matches)  # p', q' with sums zero: (11), (12)
    # The sum of both kinds of matches, after (17)
    total = M(c.p, c.q, c.beta) + M(matches.directions_source, matches.directions_target, c.alpha)
    values, vectors = np.linalg.eigh(total)  # M is symmetric: lambda_1 >= ... >= lambda_4
    q = vectors[:, 3]  # maximises (16), hence (15), hence minimises (14)
    return fit_of_rotation(
        to_matrix(q), float(values[3]), float(values[2]), matches, c, absolute_weights=absolute_weights
    )  # b by (13)
