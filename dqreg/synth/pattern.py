"""What every scanner with rays offers to the one that casts them."""

from __future__ import annotations

from typing import Protocol

from dqreg._arrays import FloatArray


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
        """Return when each pixel is read.

        Shapes: returns (k, rows, columns).
        """
