"""Points of a cloud so far from all others that they are no measurement: marks for a missing return, zeros far off."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import IntArray
from dqreg.geometry import PointCloud
from dqreg.trust.records import Reason

# Share of the points that may be such, and the fewest points of which one is.
MAX_STRAY_SHARE, MIN_POINTS = 1e-3, 100
# What lies so many times as far from the middle as all others is named, since lengths follow from the size; and left
# out, since no scanner measures so far beside the others: a far hit of a LiDAR, or one through a window, is nearer.
NAMED_RATIO, LEFT_OUT_RATIO = 10.0, 100.0
# Points that tell whether to look at all, and those on either side that may be strays themselves.
SAMPLE_POINTS, TRIMMED_POINTS = 250, 5
GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclasses.dataclass(frozen=True)
class Strays:
    """How many there are, and how far off."""

    count: int
    farthest: float  # From the middle of the others, in the unit of the cloud
    ratio: float  # The nearest of them, in distances of the farthest of the others
    left_out: bool  # Whether they are beyond all doubt, and the cloud goes on without them

    def remark(self, name: str) -> Reason:
        """What a user ought to know of them."""
        one = self.count == 1
        few, up = ("point", "lies") if one else ("points", "lie up to")
        then = (
            f"{'was' if one else 'were'} left out, as marks for a missing return are"
            if self.left_out
            else "lengths follow from the size with it: remove what was not measured"
        )
        return Reason(
            f"{self.count} {few} of {name} {up} {self.farthest:.3g} from the middle, {self.ratio:.2g} times as far as "
            f"all others, and {then}",
            "stray_points",
        )


def without_strays(cloud: PointCloud) -> tuple[PointCloud, Strays | None]:
    """The cloud without what is beyond all doubt no point of it, and what there is of strays; None for none.

    One row of a driver that stands for no return, 1e9 m off, would set every length that follows from the size.
    """
    points, (low, high) = cloud.points, cloud._ends
    if len(points) < MIN_POINTS:
        return cloud, None
    few = np.sort(points[_sample(len(points))], axis=0)
    if (high - low).max() < 0.5 * NAMED_RATIO * (few[-1 - TRIMMED_POINTS] - few[TRIMMED_POINTS]).max():
        return cloud, None
    away = np.abs(points - few[len(few) // 2]).max(axis=1)
    most = math.ceil(MAX_STRAY_SHARE * len(points))
    body = float(np.partition(away, -1 - most)[-1 - most])
    for limit in (LEFT_OUT_RATIO, NAMED_RATIO):
        off = away > limit * body
        count = int(np.count_nonzero(off))
        if body > 0.0 and count:
            ratio = float(away[off].min()) / body
            found = Strays(count, float(away.max()), ratio, limit == LEFT_OUT_RATIO)
            return cloud._taken(~off)._changed(dropped=cloud.dropped + count) if found.left_out else cloud, found
    return cloud, None


def _sample(total: int) -> IntArray:
    # Rows of a grid come with a period: steps of the golden ratio have none.
    rows: IntArray = np.floor(np.modf(np.arange(1, SAMPLE_POINTS + 1) * GOLDEN_RATIO)[0] * total).astype(np.int64)
    return rows
