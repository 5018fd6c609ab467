"""What the rays of two scanners met: a surface that a pose puts where rays passed through is not there.

As `free_space`, for scans from a place amid what they show, and as fine as their own rays are apart: a pixel is as wide
as the distance to the neighbours that surround a ray, those of the next ring among them, and a point counts where all
pixels about its own hold a ray. So what a field of view ends, what lies in a shadow, and what falls between two rings
says nothing, and an edge is one only where rays beside it went on behind it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.rays import Rays
from dqreg.trust.limits import MAX_RAY_PASS_SHARE, MIN_RAY_MEETING_SHARE

# Points are apart from what rays met by so many standard deviations of the noise.
APART_SIGMAS = 5.0


@dataclasses.dataclass(frozen=True, eq=False)
class BothRays:
    """The rays of two scans that are compared."""

    source: Rays
    target: Rays

    def met(self, T_target_source: FloatArray, noise: float, count: int, slack: float = 0.0) -> Met:
        """What they say at some poses, (k, 4, 4), of so many points of each, by their noise and how exact poses are."""
        there, back = T_target_source, np.asarray(np.linalg.inv(T_target_source), dtype=np.float64)
        margin, counts, asked = APART_SIGMAS * noise + slack, np.zeros((len(there), 3)), 0
        for rays, points, T in ((self.target, self.source.points, there), (self.source, self.target.points, back)):
            points = points[sample_rows(len(points), count)]
            counts, asked = counts + rays.met(points, T, margin), asked + len(points)
        through, alike, _ = counts.T
        are_even = self.source.is_even and self.target.is_even
        return Met(through / np.maximum(through + alike, 1.0), alike / asked, are_even)


@dataclasses.dataclass(frozen=True, eq=False)
class Met:
    """What the rays of two scans say at some poses."""

    through: FloatArray  # (k,): Share of the points in the other's view, and not behind anything, that rays passed
    alike: FloatArray  # (k,): Share of all points that the other's rays met as far
    are_even: bool  # Whether both are rays for certain: the points of bodies may look like some from inside

    @property
    def agree(self) -> bool:
        """Whether they tell at the first pose that faces end where they end in both scans."""
        is_seen = self.through[0] <= MAX_RAY_PASS_SHARE and self.alike[0] >= MIN_RAY_MEETING_SHARE
        return bool(self.are_even and is_seen)
