"""The deviations of a scan as a record: arrays, figures, bands, worst places, files."""

from __future__ import annotations

import dataclasses
import math
import os
from functools import cached_property

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.errors import InputError
from dqreg.inspection.deviation_files import require_suffix, write_array, write_coloured, write_table
from dqreg.inspection.statistics import Bands, Place, Summary, bands_of, summary_of, worst_places


@dataclasses.dataclass(frozen=True, eq=False)
class Deviations:
    """How far each point of a scan lies off its target.

    Attributes
    ----------
    values : ndarray, (n,)
        Distance of every point of the scan, in the order of the scan, target units; positive outside the part and
        negative inside where ``signed``, else never negative.
    points, closest : ndarray, (n, 3)
        The scan under its pose, and the closest place of the target, in the caller's target frame.
    faces : ndarray of int, (n,)
        Face of the mesh, or point of the cloud, that is closest. Faces without area are not counted.
    signed : bool
        Whether the sign means something.
    reason : str
        What the sign means, or why there is none.
    units : str or None
        Length unit, where known.
    tolerance : float or None
        Largest deviation allowed, as asked for.
    reach : float
        Points farther off belong to something else (a table, a clamp): measured, but in no statistics.
    apart : float
        Least distance between two worst places, a length.
    origin : ndarray, (3,)
        Middle of the target in the caller's frame: differences from it keep all digits.

    Notes
    -----
    Rows of the scan that hold no measurement (NaN, a promised normal that is missing) were dropped when it was read
    and have no value here; ``settings["source_dropped"]`` of the registration counts them.
    """

    values: FloatArray
    points: FloatArray
    closest: FloatArray
    faces: IntArray
    signed: bool
    reason: str
    units: str | None = None
    tolerance: float | None = None
    reach: float = math.inf
    apart: float = 0.0
    origin: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(3), repr=False)

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            _require_length(self.tolerance, "tolerance")
        _require_length(self.reach, "reach", or_infinite=True)

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def counted(self) -> BoolArray:
        """Which points enter the statistics, (n,): those within ``reach``."""
        return np.asarray(np.abs(self.values) <= self.reach)

    def summary(self, tolerance: float | None = None) -> Summary:
        """Figures of the counted points.

        Parameters
        ----------
        tolerance : float, optional
            Largest deviation allowed, target units; default: the record's own.

        Returns
        -------
        Summary
            Percentiles are of the absolute deviation.

        Raises
        ------
        InputError
            If the tolerance is no length above 0.
        """
        allowed = self._tolerance(tolerance)
        return summary_of(self.values[self.counted], len(self), allowed)

    def bands(self, tolerance: float | None = None, *, required_share: float = 0.95) -> Bands:
        """Shares of the counted points per band of deviation, and whether enough of them are within the tolerance.

        Parameters
        ----------
        tolerance : float, optional
            T, target units; default: the record's own.
        required_share : float
            Share of the points that must be within the tolerance to pass, above 0 and at most 1.

        Returns
        -------
        Bands
            Below -T, to -T/2, to +T/2, to +T, above; without signs only the upper three.

        Raises
        ------
        InputError
            If there is no tolerance, or one of the numbers cannot be used.
        """
        allowed = self._tolerance(tolerance)
        if allowed is None:
            raise InputError("bands need a tolerance: the largest deviation allowed, in target units")
        if not 0.0 < required_share <= 1.0:
            raise InputError(f"required_share must be above 0 and at most 1; got {required_share!r}")
        return bands_of(self.values[self.counted], allowed, required_share, self.signed)

    def worst(self, count: int = 5, apart: float | None = None) -> tuple[Place, ...]:
        """The worst places, each a patch of the scan and none a single outlier; see `worst_places`.

        Parameters
        ----------
        count : int
            Places at most.
        apart : float, optional
            Least distance between two of them, target units; default: a twentieth of the target's diagonal, or what
            the spacing of the scan resolves.

        Returns
        -------
        tuple of Place
            The largest absolute deviation first.

        Raises
        ------
        InputError
            If the distance is no length above 0.
        """
        if apart is not None:
            _require_length(apart, "apart")
        near = np.flatnonzero(self.counted)
        # Places are sought near the origin, where squares of coordinates keep their digits.
        feet = self.closest[near] - self.origin
        places = worst_places(feet, self.values[near], count, apart or self.apart)
        return tuple(
            dataclasses.replace(place, row=int(near[place.row]), position=self.points[near[place.row]])
            for place in places
        )

    def save(self, path: str | os.PathLike[str], limit: float | None = None) -> None:
        """Write the deviations; the suffix says how.

        Parameters
        ----------
        path : str or path
            ``.ply``: the coloured cloud with the value as the property ``deviation``; ``.csv``: one row a point;
            ``.npy``: the array ``values``.
        limit : float, optional
            Deviation at which the colours end, target units. Default: the tolerance, so that what is out of it has a
            colour of its own; without one, the 95 % of the absolute deviations.

        Raises
        ------
        InputError
            If the suffix is another one, or the file cannot be written.
        """
        if limit is not None:
            _require_length(limit, "limit")
        suffix = require_suffix(path)
        if suffix == ".npy":
            write_array(path, self.values)
        elif suffix == ".csv":
            write_table(path, self.points, self.values, self.closest, self.faces)
        else:
            write_coloured(
                path,
                self.points,
                self.values,
                limit=limit or self._colour_limit(),
                reach=self.reach,
                reason=self.reason,
                signed=self.signed,
                units=self.units,
            )

    def _colour_limit(self) -> float:
        # The tolerance, else the 95 % of the absolute deviations that count.
        limit = self.tolerance or self.summary().p95
        # Exact data has no range, and neither has a scan that is all clutter.
        return limit if 0.0 < limit < np.inf else 1.0

    def _tolerance(self, given: float | None) -> float | None:
        if given is None:
            return self.tolerance
        _require_length(given, "tolerance")
        return float(given)


def _require_length(value: float, name: str, or_infinite: bool = False) -> None:
    try:
        usable = 0.0 < float(value) < np.inf or (or_infinite and value == np.inf)
    except (TypeError, ValueError):
        usable = False
    if not usable or isinstance(value, (str, bool)):
        raise InputError(f"{name} must be a length above 0 in target units; got {value!r}")
