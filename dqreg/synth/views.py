"""Where a virtual scanner stands and which rays it sends out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg.arrays import FloatArray, as_vectors
from dqreg.errors import InputError


@dataclass(frozen=True)
class Scanner:
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
        views = as_vectors(self.views, "views")
        if not len(views) or not np.linalg.norm(views, axis=1).all():
            raise InputError(f"views must be one or more directions that are not zero; got {self.views!r}")
        if isinstance(self.pixels, bool) or not isinstance(self.pixels, int) or self.pixels < 1:
            raise InputError(f"pixels must be a whole number above 0; got {self.pixels!r}")
        if not _is_within(self.stand_off, 0.5, np.inf):
            raise InputError(
                f"stand_off must be above 0.5 diagonals, or the sensor is in the part; got {self.stand_off!r}"
            )
        if self.field_of_view_rad is not None and not _is_within(self.field_of_view_rad, 0.0, np.pi):
            raise InputError(
                f"field_of_view_rad must lie between 0 and a half-turn; got {self.field_of_view_rad!r} rad"
            )

    @property
    def opening_rad(self) -> float:
        """Full opening angle of the image in radians, given or derived from ``stand_off``."""
        return (
            2.0 * float(np.arcsin(0.5 / self.stand_off)) if self.field_of_view_rad is None else self.field_of_view_rad
        )

    def sensor_positions(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Pinholes of all views.

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
        views = as_vectors(self.views, "views")
        away: FloatArray = views / np.linalg.norm(views, axis=1, keepdims=True)
        return centre + self.stand_off * diagonal * away

    def ray_directions(self) -> FloatArray:
        """Return the unit rays through the middle of each pixel, away from the sensor.

        Returns
        -------
        ndarray, (k, pixels, pixels, 3)
            One image a view, rows from bottom to top.

        Examples
        --------
        >>> Scanner(views=((0, 0, 2),), pixels=1).ray_directions()[0, 0, 0].tolist()
        [0.0, 0.0, -1.0]
        """
        forward = -as_vectors(self.views, "views")
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        # Any axis that is not close to the view will do for "up".
        up = np.where(np.abs(forward[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        up = np.cross(right, forward)
        s = np.tan(0.5 * self.opening_rad) * ((np.arange(self.pixels) + 0.5) * (2.0 / self.pixels) - 1.0)
        rays = (
            forward[:, None, None]
            + s[None, :, None, None] * up[:, None, None]
            + s[None, None, :, None] * right[:, None, None]
        )
        directions: FloatArray = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return directions


def _is_within(value: object, low: float, high: float) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and low < value < high
