"""Settings of the odometry, and the lengths that a sequence's first frame resolves them to."""

from __future__ import annotations

import dataclasses
from typing import Literal, TypedDict, get_args

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry.beams import Beams, beams_of
from dqreg.geometry.morton import morton_order
from dqreg.registration.options.option_checks import read_time_limit, require_flag, require_word

# Voxel over the median range of the first frame: 0.4 m in halls and streets, 0.1 m on a desk.
VOXEL_SHARE = 0.05
# Range of the map over the farthest point of the first frame; a point farther than so many times what nine tenths are
# within is an outlier: in halls and streets the farthest ones came to 2 to 8.
MAP_RANGE_RATIO, OUTLIER_RANGE_RATIO = 2.0, 10.0
# Largest distance of a pair, in voxels: while the pose is sought, and on the last level.
REACH_VOXELS, NEAR_VOXELS = 5.0, 1.25
# Points from which on rings are looked for.
MIN_RINGED_POINTS = 1_000


Method = Literal["plane", "dq", "dq-points"]
MapSearch = Literal["never", "doubt"]


class OdometryOptions(TypedDict, total=False):
    """Fields of `OdometrySettings`, for type checkers."""

    voxel_size: float | None
    max_range: float | None
    min_range: float
    deskew: bool
    max_points_per_voxel: int
    search_deg: float
    patience: int
    method: Method
    threads: int
    history: int | None
    map_search: MapSearch
    time_limit: float | None


@dataclasses.dataclass(frozen=True)
class OdometrySettings:
    """What can be chosen; every length may be left to the first frame.

    Attributes
    ----------
    voxel_size : float, optional
        Edge of a voxel of the map. Default: 0.05 of the first frame's median range.
    max_range : float, optional
        Points farther from the sensor are left out, and the map forgets what is farther. Default: twice the farthest
        point of the first frame, strays aside: at most twenty times the range that nine tenths of it are within.
    min_range : float
        Points nearer to the sensor are left out.
    deskew : bool
        Whether per-point times, where given, are used to undo the motion during a sweep.
    max_points_per_voxel : int
        Points that a voxel of the map keeps.
    search_deg : float
        Largest turn between two frames that is searched, beside constant velocity.
    patience : int
        Frames in a row that are kept out of the map because they fit it badly; the next one goes in all the same.
    method : {"plane", "dq", "dq-points"}
        Pose step: points to tangent planes, the dual-quaternion closed form on points and normals, or on points.
    threads : int
        Threads of KISS-ICP's parts; 0 takes all cores.
    history : int, optional
        Frames that ``poses`` and ``trajectory`` keep, for programs that never end. Default: all, 128 bytes a frame.
    map_search : {"never", "doubt"}
        Whether a frame that is lost, or fits badly, where it is expected is sought in all of the map, which takes as
        long as many frames. With "never" it stays lost or in doubt, and `Odometry.relocalise` can be called for it.
    time_limit : float, optional
        Seconds that the search for one frame in all of the map may take; one that had no time to end tells nothing, and
        the verdict says so. Default: no limit. `Odometry.relocalise` searches to the end.

    Raises
    ------
    InputError
        If a value is out of range, or a word unknown.

    Examples
    --------
    >>> settings = OdometrySettings(voxel_size=0.5, min_range=1.0)
    >>> settings.resolve(np.array([[8.0, 0, 0], [0, 4, 0], [0, 0, 20]])).max_range  # twice the farthest point
    40.0
    """

    voxel_size: float | None = None
    max_range: float | None = None
    min_range: float = 0.0
    deskew: bool = True
    max_points_per_voxel: int = 12
    search_deg: float = 60.0
    patience: int = 2
    method: Method = "plane"
    threads: int = 0
    history: int | None = None
    map_search: MapSearch = "doubt"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_flag("deskew", self.deskew)
        for name in ("voxel_size", "max_range"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"{name} must be a length above 0, or None to measure it; got {value!r}")
        if not 0.0 <= self.min_range < (self.max_range or np.inf):
            raise InputError(f"min_range must be at least 0 and below max_range; got {self.min_range!r}")
        if not 0.0 <= self.search_deg <= 180.0:
            raise InputError(f"search_deg must be between 0 and 180; got {self.search_deg!r}")
        if self.max_points_per_voxel < 1 or self.patience < 0 or self.threads < 0:
            raise InputError(
                "max_points_per_voxel must be at least 1, patience and threads at least 0; got "
                f"{self.max_points_per_voxel}, {self.patience} and {self.threads}"
            )
        if self.history is not None and self.history < 1:
            raise InputError(f"history must be at least 1, or None to keep all poses; got {self.history}")
        require_word("method", self.method, get_args(Method))
        require_word("map_search", self.map_search, get_args(MapSearch))
        read_time_limit(self.time_limit)

    def resolve(self, points: FloatArray) -> Resolved:
        """The lengths of a sequence, from its first frame.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Finite points of the first frame in the sensor's frame, not all at the sensor.

        Returns
        -------
        Resolved
            No length left open.

        Raises
        ------
        InputError
            If there is no point.

        Examples
        --------
        >>> OdometrySettings(max_range=100.0).resolve(np.array([[8.0, 0, 0], [0, 4, 0], [0, 0, 20]])).voxel_size
        0.4
        """
        if not len(points):
            raise InputError("no length follows from a frame without points; give one that has some")
        ranges = np.linalg.norm(points, axis=1)
        voxel = self.voxel_size or VOXEL_SHARE * float(np.median(ranges))
        limit = self.max_range or MAP_RANGE_RATIO * min(
            float(ranges.max()), OUTLIER_RANGE_RATIO * float(np.quantile(ranges, 0.9))
        )
        return Resolved(
            voxel_size=voxel,
            max_range=limit,
            min_range=self.min_range,
            deskew=self.deskew,
            max_points_per_voxel=self.max_points_per_voxel,
            reach=REACH_VOXELS * voxel,
            near=NEAR_VOXELS * voxel,
            threads=self.threads,
            noise=_noise_in_rings(points),
        )


def _noise_in_rings(points: FloatArray) -> float:
    """How far points lie off the lines of their rings, a standard deviation; 0 where they lie in none."""
    beams = beams_of(points, morton_order(points)) if len(points) >= MIN_RINGED_POINTS else Beams()
    return 0.0 if beams.origin is None else beams.noise


def with_options(settings: OdometrySettings, options: OdometryOptions) -> OdometrySettings:
    """The same settings with some fields replaced."""
    known = [field.name for field in dataclasses.fields(settings)]
    if strange := sorted(set(options) - set(known)):
        raise InputError(f"unknown setting {', '.join(strange)}; known are {', '.join(known)}")
    return dataclasses.replace(settings, **options)


@dataclasses.dataclass(frozen=True)
class Resolved:
    """Lengths of one sequence, in its own unit."""

    # voxel_size, max_range, min_range, deskew, max_points_per_voxel, threads: As in `OdometrySettings`
    voxel_size: float
    max_range: float
    min_range: float
    deskew: bool
    max_points_per_voxel: int
    reach: float  # Largest distance of a pair while the pose is sought
    near: float  # Largest distance of a pair on the last level
    threads: int
    noise: float = 0.0  # Of points beside each other on rings, a standard deviation; 0 where they lie in none
