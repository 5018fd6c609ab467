"""What minimising a cost answers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from dqreg.arrays import FloatArray

if TYPE_CHECKING:
    from dqreg.rigid.dual_quaternion import DualQuaternion


@dataclass(frozen=True, eq=False)
class PoseFit:
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
        Motions that the cost does not feel and that stayed as they were; in the target's coordinates.

    Examples
    --------
    >>> import numpy as np
    >>> PoseFit(np.eye(4), 0.0, "converged", 3, 1, ()).dual_quaternion.real.tolist()
    [1.0, 0.0, 0.0, 0.0]
    """

    T_target_source: FloatArray
    cost: float
    status: str
    iterations: int
    starts: int
    free: tuple[str, ...]

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
