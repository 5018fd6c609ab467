"""A feature of a part: an ideal shape fitted to points, with its size, form error and covariance."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose
from dqreg.inspection.features.models import FeatureKind, Shape
from dqreg.rigid import pose

# Step of the numerical derivatives, in standard deviations of the parameters.
NUDGE_SIGMAS = 1e-2

FeatureMethod = Literal["gauss", "chebyshev", "inscribed", "circumscribed"]


@dataclasses.dataclass(frozen=True, eq=False)
class Feature:
    """An ideal shape fitted to points.

    Attributes
    ----------
    kind : {"plane", "line", "circle", "cylinder", "cone", "sphere", "slot"}
        The shape.
    method : {"gauss", "chebyshev", "inscribed", "circumscribed"}
        How it was fitted.
    point : ndarray, (3,)
        A point of the plane or of the axis, beside the middle of the points; the centre of a circle or sphere.
    axis : ndarray, (3,)
        Unit normal or axis; NaN for a sphere.
    radius : float
        NaN for planes and lines; of a cone at ``point``.
    half_angle : float
        Of a cone, radians: its radius grows along ``axis``. NaN for other shapes.
    form : float
        Form error: the width of the zone that holds all points used (flatness, straightness, roundness,
        cylindricity), a length.
    rms : float
        Root mean square distance of the points used, a length.
    points, outliers : int
        Points used and points cut.
    covariance : ndarray, (k, k)
        Of the parameters, see ``parameters``; from the scatter of the residuals between patches of neighbouring points
        where there are 400, else as if they were independent. Of a zone: from repeated fits on drawn residuals.
    parameters : tuple of str
        Rotations about the local x and y axes in radians, translations along the local axes, radius, half angle.
    frame : ndarray, (3, 3)
        Columns are the local axes; the third is ``axis``, the first of a slot points along it.
    half_length : float
        Of a slot: half the distance between the axes of its round ends. NaN for other shapes.

    Examples
    --------
    >>> from dqreg.inspection import fit_feature
    >>> angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    >>> hole = fit_feature(np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.zeros(40)]), "circle")
    >>> round(hole.diameter, 6), hole.form < 1e-12, hole.sigma("radius") < 1e-12, hole.parameters[-1]
    (4.0, True, True, 'radius')
    >>> shifted = hole.moved(pose.from_parts(np.eye(3), [5, 0, 0])).nudged(np.eye(len(hole.parameters))[-1])
    >>> (shifted.point.round(6) + 0.0).tolist(), round(shifted.radius, 6), bool(hole.reversed().axis @ hole.axis < 0)
    ([5.0, 0.0, 0.0], 3.0, True)
    """

    kind: FeatureKind
    method: FeatureMethod
    point: FloatArray
    axis: FloatArray
    radius: float
    half_angle: float
    form: float
    rms: float
    points: int
    outliers: int
    covariance: FloatArray
    parameters: tuple[str, ...]
    frame: FloatArray = dataclasses.field(repr=False)
    half_length: float = float("nan")

    @property
    def freedom(self) -> int:
        """Distances less parameters: how well the covariance itself is known."""
        rows = 2 * self.points if self.kind in ("line", "circle") else self.points
        return max(rows - len(self.parameters), 1)

    @property
    def shape(self) -> Shape:
        """Its point, frame and size alone."""
        plain = [0.0 if np.isnan(x) else x for x in (self.radius, self.half_angle, self.half_length)]
        return Shape(self.point, self.frame, *plain)

    @property
    def diameter(self) -> float:
        """Twice the radius."""
        return 2.0 * self.radius

    @property
    def width(self) -> float:
        """Distance of the flat sides of a slot; NaN for other shapes."""
        return 2.0 * self.radius if self.kind == "slot" else float("nan")

    @property
    def length(self) -> float:
        """Longest extent of a slot; NaN for other shapes."""
        return 2.0 * (self.radius + self.half_length) if self.kind == "slot" else float("nan")

    def sigma(self, parameter: str) -> float:
        """Standard deviation of one of ``parameters``; NaN where the shape has it not.

        Parameters
        ----------
        parameter : str
            Its name.

        Returns
        -------
        float
            Radians or a length.
        """
        if parameter not in self.parameters:
            return float("nan")
        k = self.parameters.index(parameter)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))

    def moved(self, T: ArrayLike) -> Feature:
        """The feature under a pose.

        Parameters
        ----------
        T : array_like, (4, 4)
            Pose.

        Returns
        -------
        Feature
            With the same size and covariance, which are in its own frame.

        Raises
        ------
        InputError
            If the pose is not (4, 4) or (3, 4), or not rigid.
        """
        T = as_pose(T, "T")
        turn = T[:3, :3]
        return dataclasses.replace(
            self, point=pose.apply(T, self.point), axis=turn @ self.axis, frame=turn @ self.frame
        )

    def reversed(self) -> Feature:
        """The same feature with its normal or axis the other way round.

        Returns
        -------
        Feature
            Its parameters turned with it.
        """
        # Half a turn about the local x axis: what lies along y and z changes sign.
        flip, other = np.diag([1.0, -1.0, -1.0]), {"tilt_y", "tilt_z", "shift_y", "shift_z", "half_angle"}
        signs = np.array([-1.0 if name in other else 1.0 for name in self.parameters])
        return dataclasses.replace(
            self,
            axis=-self.axis,
            frame=self.frame @ flip,
            half_angle=-self.half_angle,
            covariance=self.covariance * signs * signs[:, None],
        )

    def nudged(self, step: FloatArray) -> Feature:
        """The feature after a small step of its parameters.

        Parameters
        ----------
        step : ndarray, (k,)
            In the order of ``parameters``.

        Returns
        -------
        Feature
            With the same covariance.

        Raises
        ------
        ValueError
            If there are fewer numbers than parameters.
        """
        shape = self.shape.moved(self.kind, step)
        axis = self.axis if self.kind == "sphere" else shape.axis
        radius = shape.radius if "radius" in self.parameters else self.radius
        angle = shape.half_angle if "half_angle" in self.parameters else self.half_angle
        half = shape.half_length if "half_length" in self.parameters else self.half_length
        return dataclasses.replace(
            self, point=shape.point, frame=shape.frame, axis=axis, radius=radius, half_angle=angle, half_length=half
        )
