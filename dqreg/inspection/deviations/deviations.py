"""The deviations of a scan as a record: arrays, figures, bands, worst places, files."""

from __future__ import annotations

import dataclasses
import math
import os
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._records import one_line
from dqreg.errors import InputError
from dqreg.geometry import exports
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.inspection.deviations.files import decimals_of, require_suffix, write_array, write_coloured, write_table
from dqreg.inspection.deviations.outward_side import wound_outward
from dqreg.inspection.deviations.wall_doubts import WallDoubt
from dqreg.inspection.membership.membership import ON_PART, Counts, Flags, ReachFrom, by_reach, counts_of
from dqreg.inspection.statistics import Bands, Place, Summary, bands_of, require_length, summary_of, worst_places
from dqreg.inspection.tolerances import REQUIRED_SHARE, PointLimits


@dataclasses.dataclass(frozen=True, eq=False)
class Deviations:
    """How far each point of a scan lies off its target.

    Attributes
    ----------
    values : ndarray, (n,)
        Distance of every point, in the order of the scan without rows dropped when it was read, target units; positive
        outside the part and negative inside where ``signed``, else never negative.
    points, closest : ndarray, (n, 3)
        The scan under its pose, and the closest place of the target, in the caller's target frame.
    faces : ndarray of int, (n,)
        Face of the mesh, or point of the cloud, that is closest. Faces without area are not counted.
    signed, scale_solved : bool
        Whether the sign means something; whether the scan was scaled to fit, so that none of its lengths can pass.
    reason : str
        What the sign means, or why there is none.
    units : str or None
        Length unit, where known.
    tolerance : float or None
        Largest deviation allowed.
    reach : float
        Points farther off are of something else (a table, a clamp): measured, but in no statistics.
    reach_from : {"given", "size", "noise", "spacing", "deviations"}
        The caller, the part's size, or the largest of noise, spacing and the part's deviations.
    limit : float
        Largest deviation of surfaces that do not continue the part.
    flags : ndarray of int8, (n,)
        0 on the part, in the statistics; 1 beyond reach, 2 of another surface, 3 an outlier, 4 excluded.
    target : Mesh, PointCloud or None
        About ``origin``; faces of a closed mesh look outward.
    covariance : ndarray, (6, 6)
        Of the pose: rotation vector, then translation, about ``centre``; NaN where a motion is unconstrained.
    centre : ndarray, (3,)
        In the caller's target frame.
    allowed : PointLimits or None
        Limits at each point, where a plan asks for more than one tolerance.
    noise : float or None
        Standard deviation of the scan's noise, where known: digits of tables.
    apart : float
        Least distance between two worst places, a length.
    size, origin : float and ndarray, (3,)
        Diagonal of the target's bounding box, and its middle in the caller's frame: differences from it are exact.
    wall_doubts : tuple of WallDoubt
        Patches of thin walls (``thickness``, ``position``) that may be of the other side.

    Raises
    ------
    InputError
        If the tolerance or the reach is no length above 0; of `summary` and `worst` as well.

    Examples
    --------
    >>> from dqreg.geometry import MeshSurface
    >>> from dqreg.inspection import measure_deviations
    >>> from dqreg.synth.parts import box
    >>> part = Mesh(*box((2.0, 2.0, 2.0)))
    >>> scan = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [1, 1, 0] + [0, 0, 1.02]
    >>> found = measure_deviations(scan, part, MeshSurface(part), tolerance=0.05)
    >>> round(found.summary().p95, 3), found.bands().passed, len(found.worst(1)), found.pose_sigma([0]).item()
    (0.02, True, 1, 0.0)
    >>> found.normals([0]).tolist()
    [[0.0, 0.0, 1.0]]
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.save(f"{folder}/deviations.csv")
    """

    __repr__ = one_line
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
    size: float = 0.0
    origin: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(3), repr=False)
    flags: Flags = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=np.int8), repr=False)
    target: Mesh | PointCloud | None = dataclasses.field(default=None, repr=False)
    covariance: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((6, 6)), repr=False)
    centre: FloatArray = dataclasses.field(default_factory=lambda: np.zeros(3), repr=False)
    allowed: PointLimits | None = dataclasses.field(default=None, repr=False)
    noise: float | None = None
    reach_from: ReachFrom = "given"
    limit: float = 0.0
    wall_doubts: tuple[WallDoubt, ...] = ()
    scale_solved: bool = False

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            require_length(self.tolerance, "tolerance")
        require_length(self.reach, "reach", or_infinite=True)
        if len(self.flags) != len(self.values):
            object.__setattr__(self, "flags", by_reach(self.values, self.reach))
        if self.signed and isinstance(self.target, Mesh):
            object.__setattr__(self, "target", wound_outward(self.target))

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def counted(self) -> BoolArray:
        """Which points enter the statistics, (n,): those on the part."""
        return np.asarray(self.flags == ON_PART)

    @property
    def counts(self) -> Counts:
        """Points of the scan by what they belong to."""
        return counts_of(self.flags)

    def normals(self, rows: IntArray) -> FloatArray:
        """Unit normals of the target, in its frame, at the closest places of some points; 0 where it has none.

        Parameters
        ----------
        rows : ndarray of int, (m,)
            Rows of the scan.

        Returns
        -------
        ndarray, (m, 3)
        """
        rows, target = np.asarray(rows), self.target
        every = target.face_normals if isinstance(target, Mesh) else None if target is None else target.normals
        return np.zeros((len(rows), 3)) if every is None else every[self.faces[rows]]

    def pose_sigma(self, rows: IntArray) -> FloatArray:
        """Standard deviation of some deviations that comes from the pose, target units.

        A motion that is unconstrained slides the scan along the part and changes no deviation: it adds nothing.

        Parameters
        ----------
        rows : ndarray of int, (m,)
            Rows of the scan.

        Returns
        -------
        ndarray, (m,)
        """
        normals = self.normals(rows := np.asarray(rows))
        arms = np.hstack([np.cross(self.points[rows] - self.centre, normals), normals])
        spread = np.einsum("ni,ij,nj->n", arms, np.nan_to_num(self.covariance, nan=0.0), arms, optimize=True)
        sigma: FloatArray = np.sqrt(np.maximum(spread, 0.0))
        return sigma

    def summary(self, tolerance: float | None = None) -> Summary:
        """Figures of the counted points.

        Parameters
        ----------
        tolerance : float, optional
            Largest deviation allowed; default: the record's own.

        Returns
        -------
        Summary
        """
        return summary_of(self.values[self.counted], len(self), self._allowed(tolerance), overwrite_input=True)

    def bands(self, tolerance: float | None = None, *, required_share: float = REQUIRED_SHARE) -> Bands:
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
        allowed = self._allowed(tolerance)
        if allowed is None:
            raise InputError("bands need a tolerance: the largest deviation allowed, in target units")
        if not 0.0 < required_share <= 1.0:
            raise InputError(f"required_share must be above 0 and at most 1; got {required_share!r}")
        return bands_of(self.values[self.counted], allowed, required_share, self.signed)

    def worst(self, count: int = 5, apart: float | None = None) -> tuple[Place, ...]:
        """The worst places, the worst first: each a patch of the scan and none a single outlier; see `worst_places`.

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
        """
        if apart is not None:
            require_length(apart, "apart")
        near = np.flatnonzero(self.counted)
        # Near the origin squares of coordinates keep their digits.
        places = worst_places(self.closest[near] - self.origin, self.values[near], count, apart or self.apart)
        return tuple(
            dataclasses.replace(place, row=int(near[place.row]), position=self.points[near[place.row]])
            for place in places
        )

    def save(self, path: str | os.PathLike[str], limit: float | None = None) -> None:
        """Write the deviations; the suffix says how.

        Parameters
        ----------
        path : str or path
            ``.ply``: the coloured cloud with the value as the property ``deviation``; ``.csv``: one row a point, the
            unit of lengths in the head, digits to a fiftieth of the noise; ``.npy``: the array ``values``.
        limit : float, optional
            Deviation at which the colours end, target units. Default: the tolerance, so that what is out of it has a
            colour of its own; without one, the 95 % of the absolute deviations.

        Raises
        ------
        InputError
            If the suffix is another one, or the file cannot be written.
        """
        if limit is not None:
            require_length(limit, "limit")
        suffix = require_suffix(path)
        if suffix == ".npy":
            write_array(path, self.values)
        elif suffix == ".csv":
            lengths = np.column_stack([self.points, self.values, self.closest])
            within = None if self.tolerance is None else np.abs(self.values) <= self.tolerance
            if self.allowed is not None:
                within = self.allowed.beyond(self.values) <= 0.0
            normals = self.normals(np.arange(len(self)))
            decimals = decimals_of(self.size, self.noise)
            write_table(path, lengths, self.faces, normals, self.flags, within, decimals=decimals, units=self.units)
        else:
            about = {name: getattr(self, name) for name in ("reason", "signed", "units", "reach", "allowed")}
            limit = limit or self._colour_limit()
            write_coloured(path, self.points, self.values, limit=limit, flags=self.flags, **about)

    def to_pyvista(self) -> Any:
        """The scan under its pose as PyVista's PolyData, with its deviations.

        Returns
        -------
        pyvista.PolyData
            A copy; ``point_data`` has ``deviation``, target units, and ``flags``.

        Raises
        ------
        MissingDependencyError
            If PyVista is not installed.
        """
        return exports.to_pyvista(self.points, None, {"deviation": self.values, "flags": self.flags})

    def _colour_limit(self) -> float:
        limit = self.tolerance or self.summary().p95
        return limit if 0.0 < limit < np.inf else 1.0

    def _allowed(self, given: float | None) -> float | None:
        if given is not None:
            require_length(given, "tolerance")
        return self.tolerance if given is None else float(given)
