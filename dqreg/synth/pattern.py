"""What every scanner with rays offers to the one that casts them."""

from __future__ import annotations

from typing import Protocol

from dqreg.arrays import FloatArray


class Pattern(Protocol):
    """What a scan is taken with: one image of rays a view, all of a view from one sensor."""

    def sensor_positions(self, centre: FloatArray, diagonal: float) -> FloatArray:
        """Return the sensors of all k views.

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
        """

    def projector_positions(self, centre: FloatArray, diagonal: float) -> FloatArray | None:
        """Return the projectors that must light a point as well.

        Parameters
        ----------
        centre : ndarray, (3,)
            Centre of the part.
        diagonal : float
            Its diagonal.

        Returns
        -------
        ndarray, (k, 3), or None
            One a view; None where there are none.
        """

    def ray_directions(self, shift: FloatArray | None = None) -> FloatArray:
        """Return the unit rays, away from the sensor.

        Parameters
        ----------
        shift : ndarray, (k, rows, columns, 2), optional
            How far beside the middle of its pixel each ray goes, in pixels: along the row, and up.

        Returns
        -------
        ndarray, (k, rows, columns, 3)
            One image a view.
        """

    def times(self) -> FloatArray:
        """Return when each pixel is read.

        Returns
        -------
        ndarray, (k, rows, columns)
            0 at the begin of the sweep, 1 at its end.
        """
