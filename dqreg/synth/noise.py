"""Errors of a scan: range noise, dropouts, outliers and mixed pixels."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg._numbers import is_number
from dqreg.errors import InputError


@dataclass(frozen=True)
class Noise:
    """Error model of a virtual scanner; by default there are no errors.

    Attributes
    ----------
    range_sigma : float
        Standard deviation of the range at head-on incidence, a length in the unit of the part.
    grazing_growth : float
        How fast it grows with the incidence angle i: sigma = range_sigma (1 + grazing_growth (1 / cos i -
        1)).
    dropout : float
        Fraction of returns lost at the most grazing incidence: a return is lost with probability dropout (1 -
        cos i).
    max_incidence_rad : float
        Beyond this incidence angle nothing returns; less than pi / 2.
    outlier_share : float
        Fraction of the returns that become outliers, uniform in an enlarged bounding box of the part and its
        surroundings.
    outlier_box : float
        Size of that box over the size of the bounding box.
    mixed_share : float
        Fraction of the returns at a depth step that become mixed pixels: somewhere between their own range and
        that of the next pixel in the row.
    mixed_step : float
        Least difference of ranges that is a depth step, in diagonals of the part.
    lateral_sigma : float
        Standard deviation of where a pixel looks, across its ray along both axes of the image, in pixels (of a
        LiDAR: in steps of azimuth and ring). The range is that of the pixel's middle.
    quantisation : float
        Step of the range reading, a length in the unit of the part: every range is rounded to a multiple of it.
        0 leaves it as it is.

    Raises
    ------
    InputError
        If a value cannot be; the message names it.

    Examples
    --------
    >>> Noise(range_sigma=0.05, outlier_share=0.02).outlier_box
    1.2
    """

    range_sigma: float = 0.0
    grazing_growth: float = 0.0
    dropout: float = 0.0
    max_incidence_rad: float = float(np.deg2rad(85.0))
    outlier_share: float = 0.0
    outlier_box: float = 1.2
    mixed_share: float = 0.0
    mixed_step: float = 0.01
    lateral_sigma: float = 0.0
    quantisation: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not is_number(value) or not 0.0 <= value < np.inf:
                raise InputError.of("must be a number that is not negative", name=field.name, given=value)
        for name in ("dropout", "outlier_share", "mixed_share"):
            if getattr(self, name) > 1.0:
                raise InputError.of("is a fraction and must not be above 1", name=name, given=getattr(self, name))
        if not 0.0 < self.max_incidence_rad < 0.5 * np.pi:
            raise InputError.of(
                "must lie between 0 and a right angle",
                name="max_incidence_rad",
                given=self.max_incidence_rad,
                unit="rad",
            )

    def require_fit(self, diagonal: float) -> None:
        """Raise if a length cannot belong to a part of this size; the unit is then likely to be wrong.

        Parameters
        ----------
        diagonal : float
            Diagonal of the part, in the unit of the lengths.

        Raises
        ------
        InputError
            If range noise or quantisation is more than a tenth of the diagonal.

        Examples
        --------
        >>> Noise(range_sigma=0.05).require_fit(150.0)
        """
        for name in ("range_sigma", "quantisation"):
            if getattr(self, name) > 0.1 * diagonal:
                raise InputError.of(
                    f"must be at most a tenth of the part's diagonal, {diagonal:.4g}; got "
                    f"{getattr(self, name):g}. Is it in the unit of the part?",
                    name=name,
                )

    def draw(self, ranges: FloatArray, cosines: FloatArray, diagonal: float, rng: np.random.Generator) -> PixelErrors:
        """Draw the errors of all pixels.

        Parameters
        ----------
        ranges : ndarray, (k, rows, columns)
            True range of each pixel of each view; NaN where the ray meets nothing.
        cosines : ndarray, (k, rows, columns)
            Cosine of the incidence angle; negative where the face is met from behind, NaN where there is
            none.
        diagonal : float
            Diagonal of the part, in the unit of the ranges.
        rng : numpy.random.Generator
            Source of randomness; the same numbers are taken from it whatever the rays meet.

        Returns
        -------
        PixelErrors
            One entry a pixel, in the order of ``ranges.ravel()``.

        Raises
        ------
        ValueError
            If ranges and cosines differ in shape, or are no images (k, rows, columns).

        Examples
        --------
        >>> errors = Noise().draw(np.ones((1, 2, 2)), np.ones((1, 2, 2)), 1.0, np.random.default_rng(0))
        >>> errors.is_kept.tolist()
        [True, True, True, True]
        """
        gauss = rng.standard_normal(ranges.size)
        lost, outlier, mixed = rng.random((3, ranges.size))
        in_box = rng.uniform(-0.5, 0.5, (ranges.size, 3))
        cosine = cosines.ravel()
        is_kept = (cosine > np.cos(self.max_incidence_rad)) & (lost >= self.dropout * (1.0 - cosine))
        safe_cosine = np.where(is_kept, cosine, 1.0)
        sigma = self.range_sigma * (1.0 + self.grazing_growth * (1.0 / safe_cosine - 1.0))
        step = _step_to_next(ranges)
        is_outlier = outlier < self.outlier_share
        is_mixed = (np.abs(step) > self.mixed_step * diagonal) & (mixed < self.mixed_share) & ~is_outlier
        # Below its threshold the number that chose the pixel is itself uniform: it also places the point in the step.
        towards_next = np.where(is_mixed, mixed, 0.0) / (self.mixed_share or 1.0) * step
        return PixelErrors(
            is_kept=is_kept,
            is_outlier=is_outlier,
            is_mixed=is_mixed,
            sigma=sigma,
            range_error=np.where(is_mixed, towards_next, sigma * gauss),
            in_box=self.outlier_box * in_box,
        )


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """Errors of all pixels of a scan, as `Noise.draw` gives them."""

    is_kept: BoolArray  # (n,): Whether the pixel brings a point back
    # is_outlier, is_mixed: (n,): Whether that point is an outlier or a mixed pixel
    is_outlier: BoolArray
    is_mixed: BoolArray
    sigma: FloatArray  # (n,): Standard deviation of the range noise
    range_error: FloatArray  # (n,): What to add to the range
    in_box: FloatArray  # (n, 3): Position of the outlier about the part's centre, in sizes of its bounding box


def _step_to_next(ranges: FloatArray) -> FloatArray:
    """Range of the next pixel in the row minus its own, (n,); zero where either meets nothing."""
    step = np.diff(ranges, axis=2, append=np.nan).ravel()
    return np.where(np.isfinite(step), step, 0.0)
