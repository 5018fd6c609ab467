"""What a solver returns: the pose, its cost, and how well it is determined."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import lock, one_line
from dqreg._statuses import Status
from dqreg.solvers.uncertainty import FitUncertainty

if TYPE_CHECKING:
    from dqreg.rigid.dual_quaternion import DualQuaternion


class FoundPose:
    """A pose in both of its forms."""

    T_target_source: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @cached_property
    def dual_quaternion(self) -> DualQuaternion:
        """The pose as a unit dual quaternion, built when first asked for.

        Returns
        -------
        DualQuaternion
            Real part: the rotation; dual part: half the translation times the real part.
        """
        from dqreg.rigid.dual_quaternion import DualQuaternion

        return DualQuaternion.from_matrix(self.T_target_source)


@dataclass(frozen=True, eq=False)
class Fit(FoundPose):
    """Pose that minimises a weighted sum of squares over given matches.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Maps source coordinates to target coordinates, p_target = R p_source + t.
    cost : float
        The minimised sum; for points its unit is weight times length squared.
    rms : float
        Weighted root mean square distance of the matched points, a length; directions do not enter.
    eigenvalue_gap : float
        ``(lambda_1 - lambda_2) / lambda_1`` of the two largest eigenvalues of the 4x4 matrix (its trace taken
        out), between 0 and 4/3. Near 0 some rotation leaves the cost unchanged: the rotation is not determined.
    uncertainty : Uncertainty or None
        Sums that `covariance` follows from; None where the solver keeps none.

    Examples
    --------
    >>> import numpy as np
    >>> fit = Fit(np.eye(4), cost=0.0, rms=0.0, eigenvalue_gap=1.0)
    >>> fit.dual_quaternion.real.tolist()
    [1.0, 0.0, 0.0, 0.0]
    """

    __repr__ = one_line
    T_target_source: FloatArray
    cost: float
    rms: float
    eigenvalue_gap: float
    uncertainty: FitUncertainty | None = field(default=None, kw_only=True, repr=False)

    @property
    def centre(self) -> FloatArray:
        """Point that the increment of `covariance` turns about: the weighted mean of the target points.

        Returns
        -------
        ndarray, (3,)
            Target frame; NaN where the solver kept no sums.
        """
        return np.full(3, np.nan) if self.uncertainty is None else self.uncertainty.centre

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the pose, for matches whose weights are in proportion to 1 / variance.

        Returns
        -------
        ndarray, (6, 6)
            Of the left increment in the target frame about `centre`, as in `Registration`: rotation vector in
            radians first, then translation; ``T_true = pose.about(exp(twist), centre) @ T``. The variance of a match
            of weight 1 is estimated from the residuals (NaN where three points leave none), or 1 where the solver was
            told ``absolute_weights=True``. `cramer_rao` is its least possible value. NaN where the solver kept no sums.

        Examples
        --------
        >>> from dqreg.solvers import solve
        >>> p = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
        >>> fit = solve(p, p, point_weights=1 / 0.1**2, absolute_weights=True)
        >>> np.sqrt(fit.covariance.diagonal()).round(3).tolist()
        [0.032, 0.038, 0.054, 0.05, 0.05, 0.05]
        """
        if self.uncertainty is None:
            return np.full((6, 6), np.nan)
        found = self.uncertainty.covariance(self.T_target_source[:3, :3], self.eigenvalue_gap)
        # It is kept, as all that was computed when the fit was made.
        found.flags.writeable = False
        return found


@dataclass(frozen=True, eq=False)
class PoseFit(FoundPose):
    """Pose that minimises a `PoseCost`.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Maps source coordinates to target coordinates.
    cost : float
        The minimised sum, never negative; some 1e-15 of the sums it is a difference of are rounding.
    status : str
        "closed form" where points and directions alone gave the global minimum; "converged" after Newton's method;
        "iteration limit" where it did not come to rest.
    iterations : int
        Newton steps, of the start that ended lowest.
    starts : int
        Poses that Newton's method began at.
    free : tuple of str
        Unconstrained motions, which stayed as they were; in the target's coordinates.

    Examples
    --------
    >>> import numpy as np
    >>> PoseFit(np.eye(4), 0.0, "converged", 3, 1, ()).dual_quaternion.real.tolist()
    [1.0, 0.0, 0.0, 0.0]
    """

    T_target_source: FloatArray
    cost: float
    status: Status
    iterations: int
    starts: int
    free: tuple[str, ...]
