"""Sections: a cut of a part by a plane as curves, and the scan's deviations along them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, IntArray, as_vectors
from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh
from dqreg.inspection.decision.places import MEDIAN_SIGMA
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.files import decimals_of, write_sections
from dqreg.inspection.scanned_part.scanned_part import ScannedPart
from dqreg.solvers.robust import scatter_of

# Half the thickness of the slab of scan points that stands for the cut, and the step along the curve, in spacings of
# the scan.
HALF_SLAB_SPACINGS, STEP_SPACINGS = 1.5, 3.0
# Points of the scan that a place of the curve needs.
MIN_PLACE_POINTS = 3


@dataclasses.dataclass(frozen=True, eq=False)
class Section:
    """A cut of a part with the deviations of the scan along it, target units.

    Attributes
    ----------
    point, normal : ndarray, (3,)
        Plane of the cut, in the caller's target frame.
    curves : tuple of ndarray, (k, 3)
        The part's outlines in the plane; closed ones end where they begin.
    positions : ndarray, (m, 3)
        Places on the outlines, a step apart.
    outward : ndarray, (m, 3)
        Normals of the part there; where it has no outside, as its faces are wound.
    curve : ndarray of int, (m,)
        Outline of each place.
    arc : ndarray, (m,)
        Length along its outline.
    values : ndarray, (m,)
        Median deviation of the scan points there; NaN where there are fewer than three.
    sigma : ndarray, (m,)
        Standard deviation of that median.
    points : ndarray of int, (m,)
        Scan points at each place.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.geometry import MeshSurface
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> scan = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * [1, 1, 0] + [0, 0, 1.02]
    >>> cut = section_of(measure_deviations(scan, part, MeshSurface(part)), [0, 0, 0], [1, 0, 0])
    >>> round(float(np.nanmedian(cut.values)), 3), 0.2 < cut.coverage < 0.3, cut.table.shape[1]
    (0.02, True, 11)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cut.save(f"{folder}/cut.csv", "middle", units="mm")
    """

    point: FloatArray
    normal: FloatArray
    curves: tuple[FloatArray, ...]
    positions: FloatArray
    outward: FloatArray
    curve: IntArray
    arc: FloatArray
    values: FloatArray
    sigma: FloatArray
    points: IntArray

    @property
    def coverage(self) -> float:
        """Share of the places that have a value."""
        return float(np.isfinite(self.values).mean())

    @property
    def table(self) -> FloatArray:
        """Curve, arc, position, normal, deviation, sigma and points of every place, (m, 11)."""
        columns = (self.curve, self.arc, self.positions, self.outward, self.values, self.sigma, self.points)
        return np.column_stack(columns)

    def save(self, path: str | os.PathLike[str], name: str = "section", *, units: str | None = None) -> None:
        """Write the deviations along the section as CSV, one row a place of its outlines.

        Parameters
        ----------
        path : str or path
            The file; written whole or not at all.
        name : str
            The first column.
        units : str, optional
            Length unit, for the head of the columns.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        save_sections(path, [(name, self)], units)


def save_sections(path: str | os.PathLike[str], sections: Sequence[tuple[str, Section]], units: str | None) -> None:
    """Write the deviations along sections, each under its name, into one CSV file."""
    sigma = np.concatenate([cut.sigma[np.isfinite(cut.sigma)] for _, cut in sections])
    size = max(float(np.linalg.norm(np.ptp(cut.positions, axis=0))) for _, cut in sections)
    decimals = decimals_of(size, float(np.median(sigma)) if len(sigma) else None)
    write_sections(path, [(name, cut.table) for name, cut in sections], decimals=decimals, units=units)


def section_of(deviations: Deviations, point: ArrayLike, normal: ArrayLike, *, step: float | None = None) -> Section:
    """Cut a part and its scan by a plane.

    Parameters
    ----------
    deviations : Deviations
        From `dqreg.Registration.deviations`, of a scan on a mesh.
    point, normal : array_like, (3,)
        A point of the plane and its normal, of any length, in the caller's target frame.
    step : float, optional
        Distance of places along the outlines, target units; scan points within half of it from the plane stand for the
        cut. Default: three usual spacings of the scan.

    Returns
    -------
    Section
        Outlines and deviations along them.

    Raises
    ------
    InputError
        If the target is no mesh or the plane cannot be used.
    DegenerateGeometryError
        If the plane misses the part.

    Examples
    --------
    >>> from dqreg.geometry import MeshSurface
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((3.0, 2.0, 1.0)))
    >>> scan = np.random.default_rng(0).uniform(-1.5, 1.5, (4000, 3)) * [1, 0.6, 0] + [0, 0, 0.51]
    >>> cut = section_of(measure_deviations(scan, part, MeshSurface(part)), [0, 0, 0], [0, 1, 0])
    >>> len(cut.curves), round(float(np.nanmedian(cut.values)), 6)
    (1, 0.01)
    """
    return section_on(ScannedPart.of(deviations), point, normal, step)


def section_on(part: ScannedPart, point: ArrayLike, normal: ArrayLike, step: float | None = None) -> Section:
    """Cut a scanned part, see `section_of`."""
    at, towards = as_vectors([point], "point")[0], as_vectors([normal], "normal")[0]
    length = float(np.linalg.norm(towards))
    if length == 0.0:
        raise InputError("the normal of a section must not be of length zero")
    if step is not None and not 0.0 < step < np.inf:
        raise InputError(f"step must be a length above 0; got {step!r}")
    towards = towards / length
    begin = at - part.origin
    curves, normals = outlines(part.mesh, begin, towards)
    if not curves:
        raise DegenerateGeometryError(
            f"the plane through ({', '.join(f'{x:.6g}' for x in at)}) misses the part: move it or turn its normal"
        )
    width = STEP_SPACINGS * part.spacing if step is None else step
    places, outward, curve, arc = _spaced(curves, normals, width)
    near = np.abs((part.points - begin) @ towards) <= (0.5 * width if step else HALF_SLAB_SPACINGS * part.spacing)
    values, sigma, counts = _medians(part, near, places, outward, width)
    return Section(
        point=at,
        normal=towards,
        curves=tuple(each + part.origin for each in curves),
        positions=places + part.origin,
        outward=outward,
        curve=curve,
        arc=arc,
        values=values,
        sigma=sigma,
        points=counts,
    )


def outlines(mesh: Mesh, point: FloatArray, normal: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Curves in which a plane meets a mesh, and its normal along each segment. Shapes: (k, 3) and (k - 1, 3) each."""
    # Corners in one place are one: some files repeat them in each triangle.
    vertices, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    heights, faces = (vertices - point) @ normal, welded.reshape(-1)[mesh.faces]
    # A corner in the plane itself counts as above it: no triangle is then met in a corner alone.
    above = heights >= 0.0
    crossed = np.flatnonzero(above[faces].any(axis=1) & ~above[faces].all(axis=1))
    ends: list[list[tuple[int, int]]] = []
    for row in faces[crossed].tolist():
        sides = [(row[k], row[(k + 1) % 3]) for k in range(3)]
        ends.append([(min(side), max(side)) for side in sides if above[side[0]] != above[side[1]]])
    beside: dict[tuple[int, int], list[int]] = {}
    for number, pair in enumerate(ends):
        for side in pair:
            beside.setdefault(side, []).append(number)
    left, curves, normals = set(range(len(ends))), [], []
    # Open curves first, from an end of theirs: only what is left is closed.
    starts = [k for k in range(len(ends)) if any(len(beside[side]) == 1 for side in ends[k])]
    for begin in [*starts, *range(len(ends))]:
        if begin in left:
            chain, path = _followed(begin, ends, beside, left)
            corners = np.array(path)
            share = heights[corners[:, 0]] / (heights[corners[:, 0]] - heights[corners[:, 1]])
            low, high = vertices[corners[:, 0]], vertices[corners[:, 1]]
            curves.append(low + share[:, None] * (high - low))
            normals.append(mesh.face_normals[crossed[chain]])
    return curves, normals


def _followed(
    begin: int, ends: list[list[tuple[int, int]]], beside: dict[tuple[int, int], list[int]], left: set[int]
) -> tuple[list[int], list[tuple[int, int]]]:
    """Triangles from one to the next across their sides, and the sides passed."""
    first, last = ends[begin]
    if len(beside[first]) > 1 and len(beside[last]) == 1:
        first, last = last, first
    chain, path = [begin], [first, last]
    left.discard(begin)
    while True:
        following = [k for k in beside[path[-1]] if k in left]
        if not following:
            return chain, path
        chain.append(following[0])
        left.discard(following[0])
        a, b = ends[following[0]]
        path.append(b if a == path[-1] else a)


def _spaced(
    curves: list[FloatArray], normals: list[FloatArray], step: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Places a step apart along the curves: positions, normals, curve, length along it."""
    places, outward, curve, arcs = [], [], [], []
    for number, (corners, sides) in enumerate(zip(curves, normals, strict=True)):
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        count = max(int(ends[-1] / step), 1)
        arc = (np.arange(count) + 0.5) * ends[-1] / count
        segment = np.clip(np.searchsorted(ends, arc, side="right") - 1, 0, len(lengths) - 1)
        share = (arc - ends[segment]) / np.maximum(lengths[segment], np.finfo(float).tiny)
        places.append(corners[segment] + share[:, None] * (corners[segment + 1] - corners[segment]))
        outward.append(sides[segment])
        curve.append(np.full(count, number))
        arcs.append(arc)
    return np.concatenate(places), np.concatenate(outward), np.concatenate(curve), np.concatenate(arcs)


def _medians(
    part: ScannedPart, near: FloatArray, places: FloatArray, outward: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Median deviation of the scan points that lie nearest to each place, on the same side of the part."""
    from scipy.spatial import cKDTree

    feet, normals, values = part.deviations()
    feet, normals, values = feet[near], normals[near], values[near]
    counts = np.zeros(len(places), dtype=np.int64)
    medians, sigma = np.full(len(places), np.nan), np.full(len(places), np.nan)
    if not len(values):
        return medians, sigma, counts
    # A thin wall has two outlines: the normal tells which one a point is of.
    scale = 2.0 * width
    away, nearest = cKDTree(np.hstack([places, scale * outward])).query(np.hstack([feet, scale * normals]))
    kept = np.flatnonzero(away <= 1.5 * width)
    order = kept[np.argsort(np.asarray(nearest)[kept], kind="stable")]
    owners = np.asarray(nearest)[order]
    for rows in np.split(order, 1 + np.flatnonzero(np.diff(owners))):
        place = int(np.asarray(nearest)[rows[0]]) if len(rows) else 0
        counts[place] = len(rows)
        if len(rows) >= MIN_PLACE_POINTS:
            medians[place] = np.median(values[rows])
            spread = scatter_of(values[rows])
            sigma[place] = MEDIAN_SIGMA * max(spread, part.noise) / np.sqrt(len(rows))
    return medians, sigma, counts
