"""Patterns of real scanners beside the plain camera: structured light and LiDAR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray, as_float, as_vectors
from dqreg.errors import InputError
from dqreg.synth.cameras import Scanner, Stands, camera_axes, check_views, is_within, require_rays, unit


@dataclass(frozen=True)
class StructuredLight(Scanner):
    """Cameras, each with a projector at its side: a point returns only if both see it.

    Attributes
    ----------
    views, pixels, stand_off, field_of_view_rad
        The cameras, as for `Scanner`.
    baseline : float
        From the camera to its projector, along the rows of the image to the right (negative: to the left), in
        diagonals of the part. The projector lights all that it sees.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> StructuredLight(views=((0, 0, 1),), baseline=0.5).projector_positions(np.zeros(3), 10.0).tolist()
    [[5.0, 0.0, 15.0]]
    """

    baseline: float = 0.4

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_within(self.baseline, -10.0, 10.0) or self.baseline == 0.0:
            raise InputError.of("must be within 10 diagonals and not 0", name="baseline", given=self.baseline)

    def projector_positions(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Return the projectors of all views.

        Parameters
        ----------
        centre : ndarray, (3,)
            Centre of the part.
        diagonal : float
            Its diagonal.

        Returns
        -------
        ndarray, (k, 3)
            In the part's frame and unit.

        Examples
        --------
        >>> StructuredLight(views=((0, 0, 1),), baseline=0.1).projector_positions(np.zeros(3), 10.0).tolist()
        [[1.0, 0.0, 15.0]]
        """
        _, right, _ = camera_axes(as_vectors(self.views, "views"))
        return self.sensor_positions(centre, diagonal) + self.baseline * diagonal * right


@dataclass(frozen=True)
class Lidar(Stands):
    """Spinning LiDAR: rings of equal elevation, columns of equal azimuth; every length counts in diagonals.

    All rings of a column are read at once, columns follow each other, counter-clockwise about ``up``.

    Attributes
    ----------
    views : sequence of (float, float, float)
        For each stand the direction from the part's centre to the sensor.
    rings, azimuths : int
        Rings of a stand, and columns of each ring.
    stand_off : float
        Distance from the part's centre to the sensor; more than 0.5.
    up : (float, float, float)
        Axis of the spin, in the part's frame.
    elevation_rad : float, optional
        Angle between the first and the last ring's edges, half above the part's centre and half below. By default
        the rings just take in the sphere about the part.
    azimuth_rad : float, optional
        Angle that the spin covers, half to each side of the part's centre; up to a full turn. By default it just
        takes in the sphere about the part.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> Lidar(views=((1, 0, 0.5),), rings=16, azimuths=90).ray_directions().shape
    (1, 16, 90, 3)
    """

    views: tuple[tuple[float, float, float], ...]
    rings: int = 64
    azimuths: int = 360
    stand_off: float = 1.5
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    elevation_rad: float | None = None
    azimuth_rad: float | None = None

    def __post_init__(self) -> None:
        views = check_views(self.views, self.stand_off)
        require_rays(len(views), rings=self.rings, azimuths=self.azimuths)
        up = as_float(self.up, "up")
        if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
            raise InputError.of("must be three numbers that are not all zero", name="up", given=self.up)
        limits = ("elevation_rad", np.pi, "a half-turn"), ("azimuth_rad", 2.0 * np.pi + 1e-12, "a full turn")
        for name, most, words in limits:
            value = getattr(self, name)
            if value is not None and not is_within(value, 0.0, most):
                raise InputError.of(f"must lie above 0 and be at most {words}", name=name, given=value, unit="rad")
        towards = np.abs(self._centre_elevation())
        if (towards + 0.5 * self._elevation_span() >= 0.5 * np.pi).any():
            raise InputError.of(
                "holds one that looks along the axis of the spin, where azimuths end; tilt it away from up, raise "
                "stand_off or give elevation",
                name="views",
                given=self.views,
            )

    def times(self) -> FloatArray:
        """Return when each beam is read: stand after stand, in each column after column.

        Returns
        -------
        ndarray, (k, rings, azimuths)
            Fractions of the sweep, above 0 and below 1; the same for all rings.

        Examples
        --------
        >>> Lidar(views=((1, 0, 0),), rings=3, azimuths=4).times()[0, 2].tolist()
        [0.125, 0.375, 0.625, 0.875]
        """
        columns = len(self.views) * self.azimuths
        times = ((np.arange(columns) + 0.5) / columns).reshape(-1, 1, self.azimuths)
        return np.repeat(times, self.rings, axis=1)

    def ray_directions(self, shift: FloatArray | None = None) -> FloatArray:
        """Return the unit beams, away from the sensor.

        Parameters
        ----------
        shift : ndarray, (k, rings, azimuths, 2), optional
            Offset of each beam, in steps: of azimuth, and of elevation.

        Returns
        -------
        ndarray, (k, rings, azimuths, 3)
            Rings from bottom to top.

        Raises
        ------
        ValueError
            If the shifts have another shape.

        Examples
        --------
        >>> Lidar(views=((1, 0, 0),), rings=1, azimuths=1).ray_directions().round(9).tolist()
        [[[[-1.0, 0.0, 0.0]]]]
        """
        up = unit(as_float(self.up, "up"))
        forward = -unit(as_vectors(self.views, "views"))
        level = unit(forward - (forward @ up)[:, None] * up)
        left = np.cross(up, level)
        azimuth, elevation = self._angles(shift)
        flat = np.cos(azimuth) * level[:, None, None] + np.sin(azimuth) * left[:, None, None]
        return unit(np.cos(elevation) * flat + np.sin(elevation) * up)

    def _angles(self, shift: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Azimuth from the part's centre and elevation of each beam, (k, rings or 1, azimuths or 1, 1)."""
        azimuth_step = self._azimuth_span() / self.azimuths
        elevation_step = self._elevation_span() / self.rings
        azimuth = azimuth_step[:, None] * (np.arange(self.azimuths) + 0.5 - 0.5 * self.azimuths)
        middle = np.arange(self.rings) + 0.5 - 0.5 * self.rings
        elevation = self._centre_elevation()[:, None] + elevation_step * middle
        azimuth, elevation = azimuth[:, None, :, None], elevation[:, :, None, None]
        if shift is not None:
            azimuth = azimuth + azimuth_step[:, None, None, None] * shift[..., :1]
            elevation = elevation + elevation_step * shift[..., 1:]
        return azimuth, elevation

    def _centre_elevation(self) -> FloatArray:
        """Elevation of the part's centre seen from each stand, (k,)."""
        sine = -unit(as_vectors(self.views, "views")) @ unit(as_float(self.up, "up"))
        elevation: FloatArray = np.arcsin(np.clip(sine, -1.0, 1.0))
        return elevation

    def _elevation_span(self) -> float:
        return 2.0 * float(np.arcsin(0.5 / self.stand_off)) if self.elevation_rad is None else self.elevation_rad

    def _azimuth_span(self) -> FloatArray:
        """Angle that the spin covers at each stand, (k,)."""
        if self.azimuth_rad is not None:
            return np.full(len(self.views), self.azimuth_rad)
        # A sphere of angular radius a at elevation e reaches asin(sin a / cos e) to each side.
        sine = (0.5 / self.stand_off) / np.cos(self._centre_elevation())
        return 2.0 * np.arcsin(np.minimum(sine, 1.0))
