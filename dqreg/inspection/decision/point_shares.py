"""Whether enough points are within their limits: what noise alone can do to single points is no fault of the part."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.inspection.decision.regions import Outcome
from dqreg.inspection.membership.membership import OFF_SIGMAS
from dqreg.inspection.tolerances import PointLimits


def outcome_of_share(
    values: FloatArray, room: FloatArray, noise: Callable[[], FloatArray], limits: PointLimits, required: float
) -> Outcome:
    """Whether the required share of points is within: pass and fail are proven (ISO 14253-1).

    Of each point: deviation, what the pose adds (k = 2), and the standard deviation of its noise, which is
    only asked for where a share does not pass. Shapes: (n,).
    """
    count = len(values)
    if not count:
        return "undecided"
    # Pass where deviations larger by their uncertainty would do too, with all of their noise.
    if np.count_nonzero(limits.beyond(values) + room <= 0.0) >= required * count:
        return "pass"
    # Fail where smaller ones would not, nor any that noise could have moved from within.
    small = np.hypot(room, _noise_factor(required) * noise())
    return "fail" if np.count_nonzero(limits.beyond(values) <= small) < required * count else "undecided"


def _noise_factor(required: float) -> float:
    """By how many sigma noise may move points: those that hold that share, and one more for its long tails.

    >>> round(_noise_factor(0.95), 2), _noise_factor(1.0)
    (2.96, 6.0)
    """
    from scipy.special import ndtri

    return min(1.0 + float(ndtri(0.5 + 0.5 * required)), OFF_SIGMAS)
