"""`PoseCost`: one quadratic cost of a pose over points, planes, lines, directions and priors; it adds up."""

from __future__ import annotations

import dataclasses
import numbers

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.solvers.dof import Freedom
from dqreg.solvers.dof_words import as_frame
from dqreg.solvers.fit import PoseFit
from dqreg.solvers.minimise import minimise
from dqreg.solvers.pose_cost_rows import form_of, prior_form
from dqreg.solvers.quadratic import QuadraticForm, derivatives, direction_form, line_form, plane_form, point_form


@dataclasses.dataclass(frozen=True, eq=False)
class PoseCost:
    """Sum of squares of any number of features of any kind, as a function of the pose.

    ``E = y^T M y`` with ``y = (vec R, t, 1)``: one 13x13 matrix. Costs add up: those of several kinds of features, of
    the chunks of a cloud too large for the memory (``sum(PoseCost.planes(*c) for c in chunks)``), of threads and
    machines. Made by `points`, `planes`, `lines`, `directions` and `prior`; weights are ``1 / variance`` where the
    cost shall be one of maximum likelihood, as it must be next to a prior.

    Attributes
    ----------
    form : QuadraticForm
        The matrix, about an origin near the features on either side, so that far coordinates cost no digits.

    Raises
    ------
    InputError
        By its methods, where a shape or count is wrong, a number not finite, a weight negative, a normal or direction
        with weight of length zero, a pose not rigid, or a covariance not symmetric and positive definite.

    Examples
    --------
    >>> p = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    >>> q = p + [1.0, 2.0, 3.0]
    >>> cost = PoseCost.planes(p, q, [[0, 0, 1], [0, 0, 1], [0, 0, 1], [1, 0, 0]]) + PoseCost.points(p, q, weights=0.1)
    >>> cost.minimise().T_target_source[:3, 3].round(9).tolist()
    [1.0, 2.0, 3.0]
    >>> cost.recentred([0, 0, 0], [1, 2, 3]).value(np.eye(4)) < 1e-12
    True
    >>> PoseCost.lines([[0, 0, 0]], [[3, 4, 0]], [[0, 2, 0]]).value(np.eye(4))
    9.0
    >>> known = PoseCost.prior(np.eye(4), [0.01] * 3 + [4] * 3) + PoseCost.directions([[1, 0, 0]], [[0, 1, 0]])
    >>> [round(float(x[2, 2])) for x in (known.information(np.eye(4)), known.hessian(np.eye(4)))]
    [101, 200]
    >>> known.gradient(np.eye(4)).round(9)[2].item()
    -2.0
    """

    form: QuadraticForm

    @classmethod
    def points(cls, p: ArrayLike, q: ArrayLike, weights: ArrayLike | None = None) -> PoseCost:
        """``sum w |R p + t - q|^2``: points onto points.

        Parameters
        ----------
        p, q : array_like, (n, 3)
            Source points and the target points that correspond. Arrays on disk (memory maps) are read in slices.
        weights : array_like, (n,) or float, optional
            1 where not given; 0 rejects a row.

        Returns
        -------
        PoseCost
            Zero where there are no rows.
        """
        rows = {"p": p, "q": q}
        return cls(form_of(rows, weights, lambda x, w, o: point_form(x[0], x[1], w, o), isotropic=True))

    @classmethod
    def planes(cls, p: ArrayLike, q: ArrayLike, normals: ArrayLike, weights: ArrayLike | None = None) -> PoseCost:
        """``sum w (n . (R p + t - q))^2``: points onto planes.

        Parameters
        ----------
        p, q, normals : array_like, (n, 3)
            Source points, a point of each target plane, its normal in the target frame, of any length and sign.
        weights : array_like, (n,) or float, optional
            As in `points`.

        Returns
        -------
        PoseCost
        """
        rows = {"p": p, "q": q, "normals": normals}
        return cls(form_of(rows, weights, lambda x, w, o: plane_form(x[0], x[1], x[2], w, o), unit="normals"))

    @classmethod
    def lines(cls, p: ArrayLike, q: ArrayLike, directions: ArrayLike, weights: ArrayLike | None = None) -> PoseCost:
        """``sum w |(I - d d^T)(R p + t - q)|^2``: points onto lines.

        Parameters
        ----------
        p, q, directions : array_like, (n, 3)
            Source points, a point of each target line, its direction in the target frame, of any length and sign.
        weights : array_like, (n,) or float, optional
            As in `points`.

        Returns
        -------
        PoseCost
        """
        rows = {"p": p, "q": q, "directions": directions}
        return cls(form_of(rows, weights, lambda x, w, o: line_form(x[0], x[1], x[2], w, o), unit="directions"))

    @classmethod
    def directions(cls, m: ArrayLike, n: ArrayLike, weights: ArrayLike | None = None) -> PoseCost:
        """``sum w |R m - n|^2``: directions onto directions.

        Parameters
        ----------
        m, n : array_like, (n, 3)
            Source and target directions, weighed as given: none is scaled to unit length.
        weights : array_like, (n,) or float, optional
            As in `points`.

        Returns
        -------
        PoseCost
        """
        rows = {"m": m, "n": n}
        return cls(form_of(rows, weights, lambda x, w, _: direction_form(x[0], x[1], w), placed=False, isotropic=True))

    @classmethod
    def prior(cls, T: ArrayLike, covariance: ArrayLike, frame: ArrayLike | None = None) -> PoseCost:
        """``e^T C^-1 e`` for a pose known beforehand, e its left increment; least, and zero, at that pose alone.

        To stay a quadratic form of (vec R, t), exact under `+`, the rotation enters by ``2 sin(a/2)`` in place of its
        angle a, the translation as that of the frame's origin: the same to second order, and no second minimum.

        Parameters
        ----------
        T : array_like, (4, 4)
            T_target_source of the prior.
        covariance : array_like, (6, 6) or (6,)
            Of the increment in the frame, ``T_true = F exp(e) inverse(F) T``: rotation vector in radians, then
            translation of the frame's origin, along the frame's axes. Or the six variances. Infinite: nothing is known.
        frame : array_like, (4, 4) or (3,), optional
            F, T_target_frame; or its origin alone. Default: the target's own frame. For the covariance of a
            `Registration` give its ``settings["centre"]``.

        Returns
        -------
        PoseCost
            Its information at T in the same frame is the inverse of the covariance.
        """
        return cls(prior_form(as_pose(T, "T"), covariance, as_frame(frame, "frame")))

    def __add__(self, other: object) -> PoseCost:
        if isinstance(other, PoseCost):
            return PoseCost(self.form + other.form)
        # sum() begins with 0.
        if isinstance(other, int) and other == 0:
            return self
        return NotImplemented

    __radd__ = __add__

    def __mul__(self, factor: object) -> PoseCost:
        if not isinstance(factor, numbers.Real):
            return NotImplemented
        if not 0.0 <= float(factor) < np.inf:
            raise InputError(f"a cost may be multiplied by a finite number of 0 or more; got {factor!r}")
        return PoseCost(self.form * float(factor))

    __rmul__ = __mul__

    def value(self, T: ArrayLike) -> float:
        """Cost of a pose.

        Parameters
        ----------
        T : array_like, (4, 4)
            T_target_source.

        Returns
        -------
        float
            Never negative; exact to some 1e-15 of the sums it is a difference of.
        """
        return max(self.form.value(as_pose(T, "T")), 0.0)

    def gradient(self, T: ArrayLike, frame: ArrayLike | None = None) -> FloatArray:
        """Gradient of the cost by the left twist of ``T' = F exp(twist) inverse(F) T``.

        Parameters
        ----------
        T : array_like, (4, 4)
            T_target_source.
        frame : array_like, (4, 4) or (3,), optional
            F, T_target_frame; or its origin alone. Default: the target's own frame.

        Returns
        -------
        ndarray, (6,)
            Rotation first, then translation.
        """
        return self.form.twists_from(as_frame(frame, "frame")).T @ derivatives(self.form, as_pose(T, "T"))[0]

    def hessian(self, T: ArrayLike, frame: ArrayLike | None = None) -> FloatArray:
        """Exact second derivatives of the cost by the left twist.

        Parameters
        ----------
        T, frame
            As in `gradient`.

        Returns
        -------
        ndarray, (6, 6)
            Symmetric; rotation first.
        """
        A = self.form.twists_from(as_frame(frame, "frame"))
        return A.T @ derivatives(self.form, as_pose(T, "T"))[1] @ A

    def information(self, T: ArrayLike, frame: ArrayLike | None = None) -> FloatArray:
        """Gauss-Newton information ``J^T W J``, J the derivative of the residuals by the left twist.

        Half the Hessian, less what the residuals themselves add to it. With weights ``1 / variance`` its inverse is
        the covariance of the pose, and the information of a sum is the sum of the informations.

        Parameters
        ----------
        T, frame
            As in `gradient`.

        Returns
        -------
        ndarray, (6, 6)
            Symmetric, positive semidefinite; rotation first.
        """
        A = self.form.twists_from(as_frame(frame, "frame"))
        return 0.5 * A.T @ derivatives(self.form, as_pose(T, "T"))[2] @ A

    def minimise(
        self, near: ArrayLike | None = None, dof: Freedom | str | None = None, reference: ArrayLike | None = None
    ) -> PoseFit:
        """Pose of least cost.

        Parameters
        ----------
        near : array_like, (4, 4), optional
            Initial pose of Newton's method; unconstrained degrees of freedom keep its values. Default: the global
            minimum, in closed form for points and directions alone, else by Newton's method from the best of a fixed
            grid of rotations; of equal minima the one of the smallest rotation from the reference, or the identity.
        dof : Freedom or str, optional
            Degrees of freedom away from the reference, `Freedom` or its words: ``"rz tx ty"``. Default: all.
        reference : array_like, (4, 4), optional
            Pose that ``dof`` counts from. Default: ``near``.

        Returns
        -------
        PoseFit

        Raises
        ------
        DegenerateGeometryError
            If, without ``near``, the cost leaves a degree of freedom unconstrained; the message names it.

        Examples
        --------
        >>> p = np.array([[1.0, 0, 0], [0, 1, 0], [2, 1, 0]])
        >>> turned = PoseCost.points(p, p @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
        >>> fit = turned.minimise(near=np.eye(4), dof="rz")
        >>> fit.status, (fit.T_target_source.round(9) + 0.0)[:2, :2].tolist()
        ('converged', [[0.0, -1.0], [1.0, 0.0]])
        """
        begin = None if near is None else as_pose(near, "near")
        base = begin if reference is None else as_pose(reference, "reference")
        if dof is not None and base is None:
            raise InputError("dof= counts from a reference pose: give reference= or near=")
        if dof is None and reference is not None:
            raise InputError("reference= is the pose that dof= counts from: give dof= too, or near= instead")
        return minimise(self.form, begin, None if dof is None else Freedom.parse(dof), base)

    def recentred(self, origin_source: ArrayLike, origin_target: ArrayLike) -> PoseCost:
        """The same cost for poses between coordinates that count from other points.

        Parameters
        ----------
        origin_source, origin_target : array_like, (3,)
            The points, in the old coordinates of either side, that are zero in the new.

        Returns
        -------
        PoseCost
        """
        source, target = as_frame(origin_source, "origin_source"), as_frame(origin_target, "origin_target")
        return PoseCost(self.form.between(source[:3, 3], target[:3, 3]))
