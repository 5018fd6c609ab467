"""Cameras, and what every scanner with rays offers: where it stands, and which rays it sends out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dqreg._arrays import FloatArray, as_vectors, require_workable
from dqreg._numbers import is_number, is_whole
from dqreg.errors import InputError


class Pattern(Protocol):
    """What a scan is taken with: one image of rays a view, all of a view from one sensor."""

    def sensor_positions(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Return the sensors of all k views."""

    def projector_positions(self, centre: FloatArray, diagonal: float) -> FloatArray | None:
        """Return the projectors that must light a point as well."""

    def ray_directions(self, shift: FloatArray | None = None) -> FloatArray:
        """Return the unit rays, away from the sensor.

        Shapes: shift (k, rows, columns, 2), returns (k, rows, columns, 3).
        """

    def times(self) -> FloatArray:
        """Return when each pixel is read. Shapes: returns (k, rows, columns)."""


# More rays than this need more memory than most machines have; no scanner has as many pixels.
MOST_RAYS = 20_000_000


def check_views(views: object, stand_off: object) -> FloatArray:
    """Return the checked directions from the part to its sensors."""
    directions = as_vectors(views, "views")
    require_workable(np.vstack([directions, np.zeros(3)]), "views")
    if not len(directions) or not np.linalg.norm(directions, axis=1).all():
        raise InputError.of("must be one or more directions that are not zero", name="views", given=views)
    if not is_within(stand_off, 0.5, 1e6):
        wanted = "must be above 0.5 diagonals, or the sensor is in the part, and below a million"
        raise InputError.of(wanted, name="stand_off", given=stand_off)
    return directions


def require_rays(views: int, **counts: object) -> None:
    """Raise unless the sides of an image are whole numbers and all images have a sane number of rays."""
    total = views
    for name, count in counts.items():
        if not is_whole(count) or count < 1:
            raise InputError.of("must be a whole number above 0", name=name, given=count)
        total *= int(count)
    if total > MOST_RAYS:
        name, count = next(iter(counts.items()))
        rays = f"{min(total, 10**300):.3g} rays in all {views} views"  # a number of any size
        raise InputError.of(f"is too large: {count!r:.40} makes {rays}; at most {MOST_RAYS:.3g}", name=name)


def unit(vectors: FloatArray) -> FloatArray:
    """Scale vectors to length one. Shapes: vectors (..., 3), returns (..., 3)."""
    directions: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return directions


def is_within(value: object, low: float, high: float) -> bool:
    """Whether a value is a number strictly between two others."""
    return is_number(value) and low < value < high


class Stands:
    """Sensors about the part, all at the same distance from its centre."""

    views: tuple[tuple[float, float, float], ...]
    stand_off: float

    def sensor_positions(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Return the sensors of all views.

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
        >>> Scanner(views=((0, 0, 2),)).sensor_positions(np.zeros(3), 10.0).tolist()
        [[0.0, 0.0, 15.0]]
        """
        return centre + self.stand_off * diagonal * unit(as_vectors(self.views, "views"))

    def projector_positions(self, centre: FloatArray, diagonal: float) -> FloatArray | None:
        """Return None: no second light must see a point.

        Parameters
        ----------
        centre : ndarray, (3,)
            Centre of the part.
        diagonal : float
            Its diagonal.

        Returns
        -------
        None
            There is no projector.

        Examples
        --------
        >>> Scanner(views=((0, 0, 2),)).projector_positions(np.zeros(3), 10.0) is None
        True
        """
        return None


@dataclass(frozen=True)
class Scanner(Stands):
    """Pinhole views of a part, all from the same distance; every length counts in diagonals of the part.

    Attributes
    ----------
    views : sequence of (float, float, float)
        For each view the direction from the part's centre to the sensor; any length above zero.
    pixels : int
        Pixels along each side of the square image.
    stand_off : float
        Distance from the centre of the part's bounding box to the sensor, in diagonals of that box; more than
        0.5.
    field_of_view_rad : float, optional
        Full opening angle of the image, side to side, in radians. By default it just takes in the sphere
        about the part.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> Scanner(views=((0, 0, 1), (1, 1, 1)), pixels=100).opening_rad < np.pi / 4
    True
    """

    views: tuple[tuple[float, float, float], ...]
    pixels: int = 200
    stand_off: float = 1.5
    field_of_view_rad: float | None = None

    def __post_init__(self) -> None:
        views = check_views(self.views, self.stand_off)
        require_rays(len(views), pixels=self.pixels, pixels_again=self.pixels)
        if self.field_of_view_rad is not None and not is_within(self.field_of_view_rad, 0.0, np.pi):
            raise InputError.of(
                "must lie between 0 and a half-turn", name="field_of_view_rad", given=self.field_of_view_rad, unit="rad"
            )

    @property
    def opening_rad(self) -> float:
        """Full opening angle of the image in radians, given or derived from ``stand_off``."""
        return (
            2.0 * float(np.arcsin(0.5 / self.stand_off)) if self.field_of_view_rad is None else self.field_of_view_rad
        )

    def times(self) -> FloatArray:
        """Return when each pixel is read: view after view, in each row after row.

        Returns
        -------
        ndarray, (k, pixels, pixels)
            Fractions of the sweep, above 0 and below 1.

        Examples
        --------
        >>> Scanner(views=((0, 0, 1), (0, 1, 0)), pixels=2).times()[:, :, 0].tolist()
        [[0.125, 0.375], [0.625, 0.875]]
        """
        rows = len(self.views) * self.pixels
        times = ((np.arange(rows) + 0.5) / rows).reshape(-1, self.pixels, 1)
        return np.repeat(times, self.pixels, axis=2)

    def ray_directions(self, shift: FloatArray | None = None) -> FloatArray:
        """Return the unit rays through the middle of each pixel, away from the sensor.

        Parameters
        ----------
        shift : ndarray, (k, pixels, pixels, 2), optional
            How far beside the middle of its pixel each ray goes, in pixels: to the right, and up.

        Returns
        -------
        ndarray, (k, pixels, pixels, 3)
            One image a view, rows from bottom to top.

        Raises
        ------
        ValueError
            If the shifts have another shape.

        Examples
        --------
        >>> Scanner(views=((0, 0, 2),), pixels=1).ray_directions()[0, 0, 0].tolist()
        [0.0, 0.0, -1.0]
        """
        forward, right, up = camera_axes(as_vectors(self.views, "views"))
        half, pitch = np.tan(0.5 * self.opening_rad), 2.0 / self.pixels
        middles = half * ((np.arange(self.pixels) + 0.5) * pitch - 1.0)
        s_right, s_up = middles[None, None, :, None], middles[None, :, None, None]
        if shift is not None:
            s_right, s_up = s_right + half * pitch * shift[..., :1], s_up + half * pitch * shift[..., 1:]
        return unit(forward[:, None, None] + s_up * up[:, None, None] + s_right * right[:, None, None])


def camera_axes(views: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the axes of cameras that look at a part."""
    forward = -views
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    up = np.where(np.abs(forward[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return forward + 0.0, right + 0.0, np.cross(right, forward) + 0.0  # + 0.0 turns -0.0 into 0.0
