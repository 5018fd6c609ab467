"""Which point of a scan meets which place of another body, kept from one round of the joint refinement to the next."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Closest
from dqreg.icp.rejectors import at_boundary
from dqreg.multiway.refinement.bodies import Body
from dqreg.rigid import pose


@dataclasses.dataclass(frozen=True)
class BodyMatches:
    """Points of one body and the places that they meet on another, between the centred frames."""

    points: FloatArray  # (n, 3): Of the source, where they were scanned
    moved: FloatArray  # (n, 3): The same in the target's frame
    feet: FloatArray  # (n, 3): What they meet
    normals: FloatArray  # (n, 3): Of the target there
    turned: FloatArray  # (n, 3): Those of the points, in the target's frame
    variances: FloatArray | None  # (n,): Of the target's normals; None where they are exact
    turned_variances: FloatArray  # (n,): Of the points' normals
    distances: FloatArray  # (n,)
    aside: FloatArray  # (n,): Distances from the planes, positive on the normals' side
    roughness: FloatArray  # (n,): Residuals of the planes around the points
    target_roughness: FloatArray  # (n,): The same on the target


class Matching:
    """The matches of one pair: what was found stays where motions are too small to change it."""

    def __init__(self, source: Body, target: Body, rows: IntArray) -> None:
        from dqreg.kernels.threads import as_plain

        assert source.scan is not None
        self.source, self.target, self.rows = source, target, rows
        self._points = as_plain(np.take(source.scan.points, rows, axis=0))
        self._normals = as_plain(np.take(source.scan.normals, rows, axis=0))
        self._radius = float(np.linalg.norm(self._points, axis=1).max(initial=0.0))
        self._found = np.full(len(rows), -1, dtype=np.int64)
        self._others = np.full(len(rows), -np.inf)
        self._last: FloatArray | None = None

    def at(self, T_target_source: FloatArray, reach: float, facing: float) -> BodyMatches:
        """Matches within reach whose normals agree."""
        return (self._on_part if self.target.scan is None else self._on_scan)(T_target_source, reach, facing)

    def _on_scan(self, T: FloatArray, reach: float, facing: float) -> BodyMatches:
        from dqreg.kernels.trees.close_points import close_points, facing_matches
        from dqreg.kernels.trees.point_tree import LEAF_POINTS

        assert self.source.scan is not None
        assert self.target.scan is not None
        planed, count = self.target.planed, len(self.rows)
        motion = np.ascontiguousarray(T[:3])
        tree, moved_by = planed.tree, self._moved_by(T)
        place = tree.boxes, tree.places, LEAF_POINTS, tree.rows, planed.points
        close_points(0, count, *place, self._points, motion, moved_by, reach, self._found, self._others)
        kept, distances, aside = np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros(count)
        signed = self.source.scan.oriented and self.target.surface.oriented
        found = facing_matches(
            self._points,
            self._normals,
            motion,
            self._found,
            planed.points,
            planed.normals,
            planed.barred,
            reach,
            facing,
            signed,
            kept,
            distances,
            aside,
        )
        kept = kept[:found]
        met, own = self._found[kept], self.rows[kept]
        points = np.take(self._points, kept, axis=0)
        return BodyMatches(
            points=points,
            moved=pose.apply(T, points),
            feet=np.take(planed.points, met, axis=0),
            normals=np.take(planed.normals, met, axis=0),
            turned=np.take(self._normals, kept, axis=0) @ T[:3, :3].T,
            variances=planed.variances[met],
            turned_variances=self.source.spread[own],
            distances=distances[:found],
            aside=aside[:found],
            roughness=self.source.planed.roughness[own],
            target_roughness=planed.roughness[met],
        )

    def _moved_by(self, T: FloatArray) -> float:
        """How far no point has moved since the last time."""
        last, self._last = self._last, T
        if last is None:
            return np.inf
        change = T - last
        return float(np.linalg.norm(change[:3, 3]) + self._radius * np.linalg.norm(change[:3, :3], 2))

    def _on_part(self, T: FloatArray, reach: float, facing: float) -> BodyMatches:
        assert self.source.scan is not None
        surface = self.target.surface
        moved, turned = pose.apply(T, self._points), self._normals @ T[:3, :3].T
        closest = surface.closest(moved, within=reach)
        kept = np.flatnonzero(closest.distances <= reach)
        cosines = np.einsum("ij,ij->i", turned[kept], closest.normals[kept])
        signed = self.source.scan.oriented and surface.oriented
        kept = kept[(cosines if signed else np.abs(cosines)) >= facing]
        kept = kept[~at_boundary(_taken(closest, kept), surface, reach)]
        found, own = _taken(closest, kept), self.rows[kept]
        return BodyMatches(
            points=self._points[kept],
            moved=moved[kept],
            feet=found.points,
            normals=found.normals,
            turned=turned[kept],
            variances=found.variances,
            turned_variances=self.source.spread[own],
            distances=found.distances,
            aside=np.einsum("ij,ij->i", moved[kept] - found.points, found.normals),
            roughness=self.source.planed.roughness[own],
            target_roughness=np.zeros(len(kept)),
        )


def _taken(closest: Closest, rows: IntArray) -> Closest:
    return dataclasses.replace(
        closest,
        points=closest.points[rows],
        normals=closest.normals[rows],
        distances=closest.distances[rows],
        elements=closest.elements[rows],
        others=None,
        variances=None if closest.variances is None else closest.variances[rows],
    )
