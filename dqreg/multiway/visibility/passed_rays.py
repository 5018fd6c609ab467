"""What the rays of all scanners passed, where these stood amid what they show: a LiDAR's origin is its place.

Pairs are asked one by one when they are registered. A scan of another room with the same walls is doubted there in some
pairs, and what all others say together is as clear as day: rays passed a fifth of its furniture, and none of theirs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.rays import Rays
from dqreg.multiway.scans.scans import View
from dqreg.registration.overlap.free_space import rays_of_target
from dqreg.rigid import pose
from dqreg.trust.free_space import MIN_COMPARED
from dqreg.trust.rays import APART_SIGMAS

# Share of the scans that must look like rays from one place, as far apart in angle where they are long: of turntables a
# third did by chance at most, of LiDARs all.
MIN_LIKELY_SHARE = 0.8
# Points of a scan that are compared with the rays of so many scanners that stood nearest.
COMPARED_POINTS, NEAREST_SCANS = 3_000, 20
# Share of what a scan and the others compare that rays passed, from which it stands wrong: synthetic stops and streets
# came to 0.0002, a measured sequence with people in it to 0.008, a stop of another room and a mirrored one to 0.046 to
# 0.12.
MAX_PASSED_SHARE = 0.02


@dataclasses.dataclass(frozen=True, eq=False)
class PassedRays:
    """The rays of each scan, in its centred frame."""

    rays: tuple[Rays | None, ...]
    origins: tuple[FloatArray | None, ...]  # Of the centred frames
    noises: tuple[float, ...]

    @staticmethod
    def of(views: Sequence[View]) -> PassedRays | None:
        """Those of scans from known or likely places; None where too many scans are no rays from one place."""
        usable = [k for k, view in enumerate(views) if view.usable]
        rays: list[Rays | None] = [None] * len(views)
        unlikely = 0
        for k in usable:
            target = views[k].target
            assert target is not None
            found = rays_of_target(target.indexed)
            rays[k] = found if found is not None and found.is_even else None
            unlikely += rays[k] is None
            if unlikely > (1.0 - MIN_LIKELY_SHARE) * len(usable):
                return None
        origins = tuple(view.origin if view.usable else None for view in views)
        return PassedRays(tuple(rays), origins, tuple(view.scan.noise if view.usable else 0.0 for view in views))

    def shares(self, T_world_scan: FloatArray) -> FloatArray:
        """Share of what each scan and all others compare that rays passed, (n,); 0 where too little is compared."""
        passed, met = self._counts(T_world_scan)
        return _share(passed.sum(axis=1), met.sum(axis=1))

    def contradictions(self, T_world_scan: FloatArray) -> FloatArray:
        """The same of each two scans of which one exceeds what is allowed, where they do too, (n, n); 0 elsewhere."""
        passed, met = self._counts(T_world_scan)
        wrong = _share(passed.sum(axis=1), met.sum(axis=1)) > MAX_PASSED_SHARE
        shares = _share(passed, met)
        return np.where((wrong[:, None] | wrong) & (shares > MAX_PASSED_SHARE), shares, 0.0)

    def _counts(self, T_world_scan: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points of each two placed scans that the other's rays passed, and that they met as far, (n, n) each."""
        passed, met = np.zeros((2, len(self.rays), len(self.rays)))
        for i, j in self._pairs(T_world_scan):
            for a, b in ((i, j), (j, i)):
                counts = self._met(a, b, T_world_scan)
                passed[[i, j], [j, i]] += counts[0]
                met[[i, j], [j, i]] += counts[1]
        return passed, met

    def _pairs(self, T_world_scan: FloatArray) -> Iterator[tuple[int, int]]:
        """Placed scans whose scanners stood near each other."""
        placed = [k for k, rays in enumerate(self.rays) if rays is not None and np.isfinite(T_world_scan[k]).all()]
        eyes = np.array([pose.apply(self._centred(T_world_scan, k), self._rays(k).eye[None])[0] for k in placed])
        pairs = set()
        for row, k in enumerate(placed):
            near = np.argsort(np.linalg.norm(eyes - eyes[row], axis=1), kind="stable")[: NEAREST_SCANS + 1]
            pairs |= {(min(k, placed[j]), max(k, placed[j])) for j in near.tolist() if placed[j] != k}
        yield from sorted(pairs)

    def _met(self, i: int, j: int, T_world_scan: FloatArray) -> FloatArray:
        """Points of scan j that the rays of scan i passed, and that they met as far."""
        points = self._rays(j).points
        points = points[sample_rows(len(points), COMPARED_POINTS)]
        T_i_j = pose.inverse(self._centred(T_world_scan, i)) @ self._centred(T_world_scan, j)
        margin = APART_SIGMAS * max(self.noises[i], self.noises[j])
        return np.asarray(self._rays(i).met(points, T_i_j[None], margin)[0, :2], dtype=np.float64)

    def _rays(self, k: int) -> Rays:
        rays = self.rays[k]
        assert rays is not None
        return rays

    def _centred(self, T_world_scan: FloatArray, k: int) -> FloatArray:
        origin = self.origins[k]
        assert origin is not None
        return np.asarray(T_world_scan[k] @ pose.from_parts(np.eye(3), origin))


def _share(passed: FloatArray, met: FloatArray) -> FloatArray:
    compared = passed + met
    return np.where(compared >= MIN_COMPARED, passed / np.maximum(compared, 1.0), 0.0)
