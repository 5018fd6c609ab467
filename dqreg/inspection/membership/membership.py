"""Which points of a scan are of the part: not beyond reach, not of a surface that leaves it, no outliers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, as_float
from dqreg.errors import InputError
from dqreg.inspection.membership.scan_cells import ScanCells
from dqreg.inspection.membership.scan_scene import Nominal
from dqreg.inspection.membership.scan_surfaces import Surfaces, surfaces_of
from dqreg.inspection.membership.sparse_groups import sparse_groups
from dqreg.inspection.statistics import MIN_SCANNED_POINTS

Flags = NDArray[np.int8]
# What a point belongs to. Files of deviations hold these numbers: never renumbered.
ON_PART: Final = 0
BEYOND: Final = 1
OTHER_SURFACE: Final = 2
OUTLIER: Final = 3
EXCLUDED: Final = 4
# The same for those who read such a file.
FLAGS_IN_WORDS = (
    f"{ON_PART} the part, {BEYOND} beyond reach, {OTHER_SURFACE} another surface, {OUTLIER} an outlier, "
    f"{EXCLUDED} excluded"
)
# What the reach follows from: the caller, the size of the part, or whichever is the largest of the scan's noise, its
# spacing and the deviations of the part.
ReachFrom = Literal["given", "size", "noise", "spacing", "deviations"]

# A point is off the surface from that many sigmas of the scan's noise, or from one spacing, whichever is more ...
OFF_SIGMAS, OFF_SPACINGS = 6.0, 1.0
# ... and lies beside another surface, not on the part, from that many sigmas on.
BESIDE_SIGMAS = 3.0
# Less than this share of the spacing is no noise: files in single precision round there.
ROUNDING_SPACINGS = 1e-6
# Cells in which points off the surface are neighbours, in spacings: a surface fills them, outliers do not.
CELL_SPACINGS = 3.0
# A point is a spike where, of so many neighbours on the part, fewer than these leave their median on its side by half
# as much as it does. More are a patch, whatever made it.
SPIKE_NEIGHBOURS, MIN_ALIKE_NEIGHBOURS = 25, 5
ALIKE_SHARE = 0.5
# Where the highest of a cluster are gone, those below them stand alone: so many rounds. Cells of which more is off the
# part are a patch.
SPIKE_ROUNDS, MAX_OFF_CELL_SHARE = 8, 0.9
# Points that are asked at once.
CHUNK_POINTS = 100_000


@dataclasses.dataclass(frozen=True)
class Counts:
    """Points of a scan by what they belong to; the last five add up to the first.

    Attributes
    ----------
    total : int
        Points of the scan that were read.
    on_part : int
        Points that enter the figures.
    other_surfaces : int
        Within reach, but of a surface that leaves the part: a table, a clamp, material that the part does not have.
    outliers : int
        Within reach, but single points off every surface.
    beyond_reach : int
        Farther from the part than ``reach``.
    excluded : int
        In a box that was asked to be left out.
    """

    total: int
    on_part: int
    other_surfaces: int
    outliers: int
    beyond_reach: int
    excluded: int


def counts_of(flags: Flags) -> Counts:
    """Points of each kind.

    >>> counts_of(np.array([0, 0, 1, 3], dtype=np.int8)).on_part
    2
    """
    found = np.bincount(flags, minlength=5).tolist()
    return Counts(len(flags), found[ON_PART], found[OTHER_SURFACE], found[OUTLIER], found[BEYOND], found[EXCLUDED])


def by_reach(values: FloatArray, reach: float) -> Flags:
    """On the part or beyond reach, by the distance alone. Shapes: (n,)."""
    # True is one, and so is beyond; no number is not within reach. Sizes of all would be one more large array.
    within = values <= reach
    within &= values >= -reach
    return np.logical_not(within, out=within).view(np.int8)


@dataclasses.dataclass(frozen=True)
class Membership:
    """What each point belongs to, and the reach that says so."""

    flags: Flags  # (n,)
    reach: float
    source: ReachFrom


def membership(
    points: FloatArray,
    values: FloatArray,
    nominal: Nominal,
    *,
    limit: float,
    noise: float,
    spacing: float,
    given: bool = True,
) -> Membership:
    """What each point belongs to; linear in the points.

    Points off the part's surface are joined to smooth surfaces through neighbouring cells. A surface that ends within
    the limit is a deviation of the part; one that runs on beyond it is another surface, whole, unless it continues the
    part; too few points for a surface, and spikes on the part, are outliers. See `surfaces_of`. A limit that was given
    is the reach. Else no point of the part lies beyond the reach, which follows from them.

    Points are about the target's origin, where cells keep their digits.
    """
    distances = np.abs(values)
    # What is left of exact data is rounding, of which neighbours know nothing.
    noisy, spaced = OFF_SIGMAS * max(noise, ROUNDING_SPACINGS * spacing), OFF_SPACINGS * spacing
    begins = max(noisy, spaced)
    flags = by_reach(values, limit)
    off = np.flatnonzero(distances > begins)
    if np.isfinite(limit) and spacing > 0.0 and len(off):
        cells = ScanCells(points[off], CELL_SPACINGS * spacing)
        found = surfaces_of(
            cells, off, points, distances, nominal, limit=limit, noise=noise, spacing=spacing, closed=given
        )
        _flag(flags, off, found, cells, points, distances, (begins, BESIDE_SIGMAS * noise))
        single = off[~found.crowded[cells.cell]]
        single = single[distances[single] <= limit]
        flags[sparse_groups(single, flags == ON_PART, values, nominal, noise=noise)] = ON_PART
    if np.isfinite(limit) and spacing > 0.0 and noise > 0.0:
        on = flags == ON_PART
        if (on & (distances > noisy)).any():
            flags[_spikes(np.flatnonzero(on), values, nominal.feet, noisy, CELL_SPACINGS * spacing)] = OUTLIER
    if given:
        return Membership(flags, limit, "given")
    least: ReachFrom = "noise" if noisy >= spaced else "spacing"
    reach = float(distances.max(initial=begins, where=flags == ON_PART))
    flags[(flags != ON_PART) & (distances > reach)] = BEYOND
    return Membership(flags, reach, "deviations" if reach > begins else least)


def _spikes(rows: IntArray, values: FloatArray, feet: FloatArray, least: float, width: float) -> IntArray:
    """Of rows on the part those whose points leave it by ``least`` and stand alone among their neighbours."""
    begun = rows
    for _ in range(SPIKE_ROUNDS):
        off = np.abs(values[rows]) > least
        if len(rows) < MIN_SCANNED_POINTS or not off.any():
            break
        cells = ScanCells(feet[rows], width)
        asked = np.flatnonzero(off & (cells.sums(off) <= MAX_OFF_CELL_SHARE * cells.counts)[cells.cell])
        alone = _alone(values[rows], feet[rows], asked, least)
        if not alone.any():
            break
        rows = np.delete(rows, asked[alone])
    return np.setdiff1d(begun, rows, assume_unique=True)


def _alone(values: FloatArray, feet: FloatArray, asked: IntArray, least: float) -> BoolArray:
    """Whether points leave their neighbours by ``least``, and hardly any of these does."""
    from scipy.spatial import cKDTree

    tree, found = cKDTree(feet), np.zeros(len(asked), dtype=bool)
    for begin in range(0, len(asked), CHUNK_POINTS):
        chunk = asked[begin : begin + CHUNK_POINTS]
        around = values[tree.query(feet[chunk], k=SPIKE_NEIGHBOURS)[1]]
        middle = np.median(around, axis=1)
        away = values[chunk] - middle
        alike = (around - middle[:, None]) * np.sign(away)[:, None] >= ALIKE_SHARE * np.abs(away)[:, None]
        found[begin : begin + CHUNK_POINTS] = (np.abs(away) > least) & (alike.sum(axis=1) < MIN_ALIKE_NEIGHBOURS)
    return found


def _flag(
    flags: Flags,
    off: NDArray[np.int64],
    found: Surfaces,
    cells: ScanCells,
    points: FloatArray,
    distances: FloatArray,
    limits: tuple[float, float],
) -> None:
    """Write what points off the surface belong to, and what lies beside other surfaces."""
    begins, beside = limits
    kinds = np.where(found.other, OTHER_SURFACE, np.where(found.crowded, ON_PART, OUTLIER))[cells.cell]
    far = flags[off] == BEYOND
    flags[off] = np.where(far & (kinds != ON_PART), BEYOND, kinds)
    if found.other.any():
        # Where a table touches the part its last points lie nearer than "off".
        near = np.flatnonzero((distances <= begins) & (distances > beside))
        flags[near[cells.touches(points[near], found.other)]] = OTHER_SURFACE


def in_boxes(points: FloatArray, boxes: Sequence[Sequence[float]]) -> BoolArray:
    """Points in any of the boxes, given by two opposite corners: x, y, z, x, y, z.

    >>> in_boxes(np.array([[0.5, 0.5, 0.5], [2.0, 0, 0]]), [(1, 1, 1, 0, 0, 0)]).tolist()
    [True, False]
    """
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        ends = as_float(box, "a box to exclude")
        if ends.shape != (6,) or not np.isfinite(ends).all():
            raise InputError(f"a box to exclude is six coordinates, two opposite corners; got {box!r:.80}")
        low, high = np.minimum(ends[:3], ends[3:]), np.maximum(ends[:3], ends[3:])
        inside |= ((points >= low) & (points <= high)).all(axis=1)
    return inside
