"""Holes in the faces of a cloud in a plane where the faces of another one go on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.trust.face_rims import Held

# Width of a cell of the plane, in spacings of its points; a plane of more cells has a point far away, and is not asked.
CELL_SPACINGS, MAX_CELLS = 2.0, 1 << 22
# Cells of a hole at least: of right pairs of generated views gaps of up to 4 cells between the points were filled.
MIN_HOLE_CELLS = 5
# So many cells around a hole are looked at. What stands beside it, so many cells high at most, may hide the face there
# from one side.
MARGIN_CELLS, OBSTACLE_CELLS = 3, 20.0


class Asked(NamedTuple):
    """What is asked of a hole."""

    filled: float  # Share of it that the other's face holds at least
    whole: float  # Share of what is around it that holds points at least
    stands: bool  # Whether nothing may stand beside it


# Beams of a LiDAR leave gaps on the ground amid gaps (0.81 around them at most), holes of generated views are in whole
# faces (0.97 at least).
CLOSED = Asked(0.8, 0.9, True)
# A hole that few points show as one may be closed by more of them: on right streets those came to a third of the limit
# at most, where other streets were laid on them to 1.2 times it.
PERHAPS_CLOSED = Asked(0.6, 0.7, False)


class _Grid(NamedTuple):
    """Cells of a plane."""

    low: FloatArray  # (2,): Their corner
    cell: float  # Their edge
    shape: tuple[int, int]

    def held(self, flat: FloatArray) -> BoolArray:
        """Which cells hold points of the plane, (n, 2)."""
        from dqreg.kernels.evidence.plane_gaps import hold_cells
        from dqreg.kernels.threads import as_plain

        cells = np.zeros(self.shape, dtype=bool)
        hold_cells(as_plain(flat), self.low, self.cell, cells)
        return cells


def closed_hole(one: Held, theirs: Held, other: FloatArray, asked: Asked = CLOSED) -> float:
    """Diameter of the largest hole in a cloud's faces in a plane where another one's faces go on; 0 for none.

    Faces of both clouds are asked, and all points of the other one, (n, 3). A hole is a place without points that the
    first one's enclose. Where anything of the other cloud stands beside it, that may hide the face from one side, and
    nothing is said.
    """
    if not one.spacing > 0.0:
        return 0.0
    cell = CELL_SPACINGS * one.spacing
    # A free cell all around, so that what is outside is one.
    columns = np.ascontiguousarray(one.flat.T)
    low = columns.min(axis=1) - cell
    height, width = (np.floor((columns.max(axis=1) - low) / cell) + 2.0).tolist()
    if height * width > MAX_CELLS:
        return 0.0
    grid = _Grid(low, cell, (int(height), int(width)))
    own, standing = grid.held(one.flat), None
    labels, gaps = _gaps(own, grid.held(theirs.flat))
    gaps = gaps[gaps[:, 2] >= asked.filled * gaps[:, 1]]
    # The largest decides.
    for label, size, _, top, bottom, left, right in gaps[np.argsort(-gaps[:, 1], kind="stable")].tolist():
        window = _around(top, bottom), _around(left, right)
        hole = labels[window] == label
        if not _is_whole(hole, own[window], asked.whole):
            continue
        if asked.stands:
            standing = _standing(grid, one, other) if standing is None else standing
            if (grown(hole, 1) & standing[window]).any():
                continue
        return 2.0 * cell * float(np.sqrt(size / np.pi))
    return 0.0


def _gaps(own: BoolArray, theirs: BoolArray) -> tuple[NDArray[np.int32], IntArray]:
    """Labels of the free cells, (h, w), and the gaps that the others enclose, (k, 7): see `enclosed_gaps`."""
    from dqreg.kernels.evidence.plane_gaps import COLUMNS, enclosed_gaps

    labels, stack = np.zeros(own.shape, dtype=np.int32), np.zeros(own.size, dtype=np.int64)
    found = np.zeros((own.size // MIN_HOLE_CELLS + 1, COLUMNS), dtype=np.int64)
    return labels, found[: enclosed_gaps(own, theirs, MIN_HOLE_CELLS, labels, stack, found)]


def _around(first: int, last: int) -> slice:
    return slice(max(first - MARGIN_CELLS, 0), last + 1 + MARGIN_CELLS)


def _is_whole(hole: BoolArray, own: BoolArray, share: float) -> bool:
    """Whether so much of the cells around a hole holds points."""
    around = grown(hole, MARGIN_CELLS) & ~hole
    return bool(own[around].mean() >= share)


def grown(hole: BoolArray, steps: int) -> BoolArray:
    """Cells within so many steps of those of a hole, from side to side, (h, w)."""
    # SciPy's dilation is one call, but takes 160 ms to import: four times what a first pair of clouds needs of it.
    found = hole.copy()
    for _ in range(steps):
        before = found.copy()
        found[1:] |= before[:-1]
        found[:-1] |= before[1:]
        found[:, 1:] |= before[:, :-1]
        found[:, :-1] |= before[:, 1:]
    return found


def _standing(grid: _Grid, one: Held, other: FloatArray) -> BoolArray:
    """Cells in which points of the other cloud, (n, 3), stand beside the plane."""
    heights = np.abs((other - one.plane.middle) @ one.plane.normal)
    beside = (heights >= one.within) & (heights < OBSTACLE_CELLS * grid.cell)
    return grid.held((other[beside] - one.plane.middle) @ one.plane.across.T)
