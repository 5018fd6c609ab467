"""What a scan is measured by: planes at some of its points, the spacing of all, their noise, and their order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import PlaneFits, fit_planes, fit_planes_at, sample_rows
from dqreg.geometry.scan_noise import noise_of
from dqreg.geometry.spacing import spacing_of

# Points among which neighbours are searched where normals are fitted at a few points only of more than these.
THINNED_POINTS = 50_000
# Pieces of the cloud on which spacing and noise are measured then.
PIECE_COUNT = 30
# Points of a piece, and those in its middle, whose neighbours are in the piece.
PIECE_POINTS, MIDDLE_POINTS = 512, 32
# Parts of a cloud in its own order, at most; and points that are looked up in one go.
CLOUD_PARTS, CHUNK_POINTS = 8, 65_536


def measure_all(
    points: FloatArray, rows: IntArray, tree: NeighbourTree, fits: PlaneFits | None, means: FloatArray, *, quiet: bool
) -> tuple[PlaneFits, float, tuple[float, float | None]]:
    """Planes at some points of a cloud, fitted unless they are known; spacing and noises of the cloud, see `noise_of`.

    The noise is that of the means, (n, 3), from which points of cells were moved to the surface of their neighbours.
    """
    at = points if len(rows) == len(points) else points[rows]
    fits = fit_planes_at(tree, points, rows) if fits is None else fits
    if at is points and fits.neighbours is not None:
        tree.remember(fits.neighbours)
    return fits, (spacing := spacing_of(fits, at)), noise_of(fits, means, at, tree, spacing, quiet=quiet)


def measure_pieces(
    points: FloatArray, rows: IntArray, *, quiet: bool
) -> tuple[PlaneFits, float, tuple[float, float | None]]:
    """The same of a large cloud: planes to neighbours in a thinned one, the rest from pieces of it."""
    some = sample_rows(len(points), max(THINNED_POINTS, 2 * len(rows)))
    thinned, beside = np.take(points, some, axis=0), np.minimum(np.searchsorted(some, rows), len(some) - 1)
    fits = fit_planes(NeighbourTree(thinned, in_order=True), thinned, np.take(points, rows, axis=0), beside=beside)
    # Runs along the Morton curve are patches of the surface with all of their points, so that the neighbours of those
    # in the middle are their neighbours in the whole cloud.
    firsts = np.linspace(0, len(points) - PIECE_POINTS, PIECE_COUNT).astype(np.int64)
    pieces = np.take(points, (firsts[:, None] + np.arange(PIECE_POINTS)).ravel(), axis=0)
    middles = np.take(
        points, (firsts[:, None] + (PIECE_POINTS - MIDDLE_POINTS) // 2 + np.arange(MIDDLE_POINTS)).ravel(), axis=0
    )
    of_pieces = NeighbourTree(pieces, in_order=True)
    pieced = fit_planes(of_pieces, pieces, middles)
    spacing = spacing_of(pieced, middles)
    return fits, spacing, noise_of(pieced, pieces, middles, of_pieces, spacing, quiet=quiet)


def parts_of(order: IntArray) -> NDArray[np.uint8]:
    """Which part of a cloud in its own order each point stands in, given their rows, (n,)."""
    # Up to the last row that counts: copies at the end of a cloud do not. Of a length that is a power of two.
    parts, shift = np.zeros(len(order), dtype=np.uint8), int(order.max() // CLOUD_PARTS).bit_length()
    for i in range(0, len(order), CHUNK_POINTS):
        np.right_shift(order[i : i + CHUNK_POINTS], shift, out=parts[i : i + CHUNK_POINTS], casting="unsafe")
    return parts
