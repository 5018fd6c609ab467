"""Where an open mesh ends: its free edges, and which places lie at them."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from dqreg.geometry.mesh import Mesh

# Pieces that the free edges are cut into, about, so that their middles can be looked up.
PIECES = 20_000
# Pieces that are looked at for each place, the nearest ones.
LOOKED_AT = 6
# Free edges nearer to each other than this share of the size are one seam that was never sewn, not two borders; and
# they run along each other.
SEAM, ALONG = 1e-4, 0.9
# The strip along the borders that may be called border takes at most about this share of the area.
STRIP = 0.1


@dataclasses.dataclass(frozen=True)
class Borders:
    """Free edges of an open mesh, cut into short pieces."""

    # starts, ends: (k, 3): Ends of each piece
    starts: FloatArray
    ends: FloatArray
    widest: float  # Widest strip along the borders that leaves nine tenths of the surface, a length

    @staticmethod
    def of(mesh: Mesh) -> Borders | None:
        """The borders of a mesh."""
        sides = mesh.topology.free_sides
        if not len(sides):
            return None
        every = np.concatenate([mesh.faces, mesh.flat])
        faces, first = sides // 3, sides % 3
        starts, ends = mesh.vertices[every[faces, first]], mesh.vertices[every[faces, (first + 1) % 3]]
        lengths = np.linalg.norm(ends - starts, axis=1)
        counts = np.maximum(np.ceil(lengths * PIECES / lengths.sum()), 1.0).astype(np.int64)
        edge = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = (ends - starts) / counts[:, None]
        low = starts[edge] + place[:, None] * step[edge]
        pieces = Borders(low, low + step[edge], 0.0)
        real = ~pieces._on_seams(edge, SEAM * mesh.diagonal)
        if not real.any():
            return None
        length = float(np.linalg.norm(step[edge[real]], axis=1).sum())
        return Borders(low[real], low[real] + step[edge[real]], STRIP * float(mesh.face_areas.sum()) / length)

    def near(self, places: FloatArray, margin: float) -> BoolArray:
        """Which places lie at a border."""
        allowed = min(margin, self.widest) + self._rounding
        found = np.zeros(len(places), dtype=bool)
        if not len(places):
            return found
        reach, pieces = self._tree.query(
            places, k=min(LOOKED_AT, len(self.starts)), distance_upper_bound=allowed + 0.5 * self._longest
        )
        reach, pieces = reach.reshape(len(places), -1), pieces.reshape(len(places), -1)
        rows, columns = np.nonzero(np.isfinite(reach))
        _, apart = self._feet(places[rows], pieces[rows, columns])
        found[rows[apart <= allowed]] = True
        return found

    def _feet(self, places: FloatArray, pieces: Any) -> tuple[FloatArray, FloatArray]:
        # How far along its piece the closest point of each place lies, not clipped, and the distance to the piece.
        starts, across = self.starts[pieces], self.ends[pieces] - self.starts[pieces]
        along = np.einsum("ij,ij->i", places - starts, across) / np.einsum("ij,ij->i", across, across)
        closest = starts + np.clip(along, 0.0, 1.0)[:, None] * across
        return along, np.linalg.norm(places - closest, axis=1)

    def _on_seams(self, edge: Any, tolerance: float) -> BoolArray:
        count = min(LOOKED_AT + 2, len(self.starts))
        _, others = self._tree.query(self._middles, k=count)
        others = others.reshape(len(edge), -1)
        mine = np.repeat(np.arange(len(edge)), others.shape[1])
        others = others.ravel()
        along, apart = self._feet(self._middles[mine], others)
        unit = (self.ends - self.starts) / np.linalg.norm(self.ends - self.starts, axis=1, keepdims=True)
        parallel = np.abs(np.einsum("ij,ij->i", unit[mine], unit[others])) > ALONG
        beside = (along >= 0.0) & (along <= 1.0) & (apart <= tolerance) & parallel & (edge[mine] != edge[others])
        return np.bincount(mine[beside], minlength=len(edge)) > 0

    @cached_property
    def _middles(self) -> FloatArray:
        middles: FloatArray = 0.5 * (self.starts + self.ends)
        return middles

    @cached_property
    def _longest(self) -> float:
        return float(np.linalg.norm(self.ends - self.starts, axis=1).max())

    @cached_property
    def _rounding(self) -> float:
        return 1e-12 * float(np.abs(np.concatenate([self.starts, self.ends])).max())

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._middles)
