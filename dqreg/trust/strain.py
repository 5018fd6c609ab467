"""What is left between scan and target beside the pose, fitted with its covariance: a strain, a bend, a drift."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from dqreg._arrays import FloatArray, median, root_mean_square
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import second_moment
from dqreg.solvers.motion_words import Vector
from dqreg.solvers.quadratic import JACOBIAN_ROWS, plane_rows
from dqreg.trust.robust_fit import TINY, robust_fit, weighted_rms, weights_of, without_motion

# Correspondences without which no strain is asked for.
MIN_CORRESPONDENCES = 300
# Of a symmetric 3 x 3 tensor.
COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Smaller strains are no fault: parts shrink, and sensors are calibrated to as much.
MIN_STRAIN, MIN_BEND = 0.003, 0.002
# What is below this share of those after two rounds of the robust fit, and at its end, is not looked at any further.
NEGLIGIBLE_SHARE = 0.3
# Points that are asked first, where there are twice as many; below that share, nothing more is looked at. A fault that
# all show to eight of their standard deviations is four of these off it.
FIRST_POINTS, NEGLIGIBLE_SHARE_OF_FIRST = 1_000, 0.15
# What is below this share of them is no fault, however it is rounded.
NO_FAULT_SHARE = 1.0 - 1e-9
# Larger ones are none: both sides of a sheet came together.
MAX_STRAIN = 0.5
# Standard deviations that are no chance: the largest of many directions, of noise that is not quite independent. Beside
# other objects, and at an open target, the points left out make a pattern too: scans of a range scanner and of a LiDAR
# at the true pose came to 10.1 there, to 6.6 on a part alone.
STRAIN_SIGMAS, STRAIN_SIGMAS_IN_CLUTTER = 8.0, 15.0
# Principal strains are alike, a scale, where the smallest is more than this share of the largest.
SCALE_STRAIN_RATIO = 0.6
# Share of a drift that is the shift of the middle, where it has a direction.
MIDDLE_SHIFT_SHARE = 0.5
# Of a drift along the scan: correspondences without which none is asked for.
MIN_DRIFT_CORRESPONDENCES = 500
# Displacements, in sizes of the target, and standard deviations from which on it matters and is no chance. Scans in the
# order of lines or views bend along it too.
MIN_DRIFT_DIAGONALS, DRIFT_SIGMAS = 0.003, 15.0
# Of a covariance, below which it is rounding.
ROUNDING_SHARE = 1e-12


@dataclasses.dataclass(frozen=True)
class Strain:
    """The most significant strain of the scan against the target, and its bend; zeros where nothing was fitted."""

    value: float = 0.0  # Relative elongation; below zero where the scan is shorter
    sigma: float = math.inf  # Its standard deviation
    along: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Principal axis; zeros for a scale
    # Sagitta over length, along the longest axis of the scan; of a torsion, the displacement of an end
    bend: float = 0.0
    bend_sigma: float = math.inf
    significant: float = STRAIN_SIGMAS  # Standard deviations from which on they are no chance
    # Displacement along the normals by all of them that no motion explains, root mean square and largest of all points:
    # those that the fit leaves out are displaced as well
    shown: float = 0.0
    most: float = 0.0

    @property
    def is_strained(self) -> bool:
        """Whether the elongation matters and is significant."""
        return MIN_STRAIN <= abs(self.value) <= MAX_STRAIN and abs(self.value) >= self.significant * self.sigma

    @property
    def is_bent(self) -> bool:
        """Whether the bend matters and is significant."""
        return self.bend >= MIN_BEND and self.bend >= self.significant * self.bend_sigma


def strain_of(
    points: FloatArray,
    normals: FloatArray,
    residuals: FloatArray,
    *,
    clutter: bool = False,
    strays: bool = False,
    faults: bool = False,
    least: float = 0.0,
    nearer: float = math.inf,
) -> Strain:
    """Strain from distances along the target's normals, fitted together with the motion and the bend that remain.

    Without clutter, all points have a say to begin with: a face that is off may be what a strain explains. With it, and
    beside strays where the fit to them explains more points, those on the target have. Where faults alone are asked
    for, what is too small for one is none, as is what displaces the surface by less than a least length, and its
    covariance is not asked. Where the fit leaves the usual point more than so many times as far off as no strain, a few
    places far off may have drawn it: it has to show from those on the target.

    Shapes: points (n, 3) in the order of a space-filling curve, normals (n, 3), residuals (n,).
    """
    if len(residuals) < MIN_CORRESPONDENCES or _is_hardly_any(points, normals, residuals, clutter=clutter):
        return Strain()
    model = _Model.of(points, normals)
    if model is None:
        return Strain()
    rows, lever, factor, is_small = model.rows, model.lever, model.factor, model.is_small
    first = weights_of(residuals) if clutter else np.ones(len(residuals))
    fit = robust_fit(rows, residuals, lever, first, is_small)
    if strays and not clutter and not is_small(fit.fitted):
        # Strays beside two faces stretch the fit to all; of a scan without them, they are the faces of another part.
        others = robust_fit(rows, residuals, lever, weights_of(residuals), is_small)
        fit = min((fit, others), key=lambda each: median(np.abs(each.left)))
    least_share = NO_FAULT_SHARE if faults else NEGLIGIBLE_SHARE
    if not is_small(fit.fitted, least_share) and median(np.abs(fit.left)) > nearer * median(np.abs(residuals)):
        fit = robust_fit(rows, residuals, lever, weights_of(residuals), is_small)
    fitted = fit.fitted
    if is_small(fitted, least_share):
        return Strain()
    left = without_motion(fitted[6:] @ rows[6:], rows[:6], fit.weights)
    if weighted_rms(left, fit.weights) < least:
        return Strain()
    scatter = fit.scatter(points, normals)
    if scatter is None:
        return Strain()
    value, sigma, along = _principal(fitted[6:12] / lever, scatter[6:12, 6:12] / lever**2)
    bends = np.abs(fitted[12:]) * factor
    sigmas = np.sqrt(np.diag(scatter)[12:]) * factor
    k = int(np.argmax(bends / sigmas)) if (sigmas > 0.0).all() else 0
    significant = STRAIN_SIGMAS_IN_CLUTTER if clutter else STRAIN_SIGMAS
    shown = root_mean_square(left), float(np.abs(left).max())
    return Strain(value, sigma, along, float(bends[k]), float(sigmas[k]), significant, *shown)


@dataclasses.dataclass(frozen=True, eq=False)
class _Model:
    """Motions, strains, bends and a torsion of some points, as rows of a fit."""

    rows: FloatArray  # (15, n): See `_rows`
    lever: float  # Length that rotations are over
    factor: FloatArray  # (3,): From the last three unknowns to sagittas over lengths

    @staticmethod
    def of(points: FloatArray, normals: FloatArray) -> _Model | None:
        """Of points and normals, (n, 3); None where all points are one."""
        # The bits of the mean along columns in a quarter of the time.
        middle = np.einsum("ij->j", points) / len(points)
        arms = points - middle
        squares, axes = np.linalg.eigh(second_moment(np.ascontiguousarray(arms.T)) / len(points))
        lever = math.sqrt(max(float(squares.sum()), 0.0))
        if not lever > 0.0:
            return None
        rows = _rows(points, middle, arms, normals, axes[:, ::-1], lever)
        length = float(np.ptp(arms @ axes[:, 2]))
        # The row is the square of the place along the axis over the lever; a sagitta is over the square of half the
        # length. Of a torsion, the displacement of the ends at the usual distance from the axis.
        radius = math.sqrt(max(float(squares[0] + squares[1]), 0.0))
        return _Model(rows, lever, np.array([0.25 * length, 0.25 * length, 0.5 * radius]) / lever**2)

    def is_small(self, fitted: FloatArray, share: float = NEGLIGIBLE_SHARE) -> bool:
        """Whether strains and bends of a fit are all below a share of those that are faults."""
        # No principal strain is larger than the root of the sum of all squares.
        square = float(fitted[6:12] ** 2 @ (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)) / self.lever**2
        bends = np.abs(fitted[12:]) * self.factor
        return square <= (share * MIN_STRAIN) ** 2 and bool((bends <= share * MIN_BEND).all())


def _is_hardly_any(points: FloatArray, normals: FloatArray, residuals: FloatArray, *, clutter: bool) -> bool:
    """Whether some of many points show so little strain that all of them show none, in a third of the time."""
    if len(residuals) < 2 * FIRST_POINTS:
        return False
    rows = sample_rows(len(residuals), FIRST_POINTS)
    points, normals, residuals = np.take(points, rows, axis=0), np.take(normals, rows, axis=0), residuals[rows]
    model = _Model.of(points, normals)
    if model is None:
        return False
    first = weights_of(residuals) if clutter else np.ones(len(residuals))
    is_small = functools.partial(model.is_small, share=NEGLIGIBLE_SHARE_OF_FIRST)
    return is_small(robust_fit(model.rows, residuals, model.lever, first, is_small, rounds=2).fitted)


def _rows(
    points: FloatArray, middle: FloatArray, arms: FloatArray, normals: FloatArray, axes: FloatArray, lever: float
) -> FloatArray:
    """Displacements along the normals by the six motions, unit strains, two bends and a torsion of the first axis.

    Shapes: arms (n, 3), the points from their middle; returns (15, n).
    """
    from dqreg.kernels.evidence.plane_rows import plane_row_columns, strain_row_columns
    from dqreg.kernels.threads import as_plain, over_chunks

    rows, count, normals = np.zeros((15, len(arms))), len(arms), as_plain(normals)
    over_chunks(plane_row_columns, count, as_plain(points), normals, middle, lever, rows[:6], chunk=JACOBIAN_ROWS)
    over_chunks(
        strain_row_columns, count, as_plain(arms), normals, as_plain(axes), lever, rows[6:], chunk=JACOBIAN_ROWS
    )
    return rows


def _principal(strain: FloatArray, covariance: FloatArray) -> tuple[float, float, tuple[float, float, float]]:
    """The most significant principal strain, its standard deviation and axis; the mean of them where they are alike."""
    E = np.zeros((3, 3))
    for value, (i, j) in zip(strain, COMPONENTS, strict=True):
        E[i, j] = E[j, i] = value
    found, axes = np.linalg.eigh(E)
    gradients = np.array([[a[i] * a[j] * (1.0 if i == j else 2.0) for i, j in COMPONENTS] for a in axes.T])
    values = np.asarray(found, dtype=np.float64)
    if abs(np.sign(values).sum()) == 3.0 and np.abs(values).min() > SCALE_STRAIN_RATIO * np.abs(values).max():
        values, gradients, axes = np.full(1, values.mean()), gradients.mean(axis=0, keepdims=True), np.zeros((3, 1))
    sigmas = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradients, covariance, gradients), np.finfo(float).tiny))
    # Of strains that matter, the most significant one.
    z = np.abs(values) / sigmas
    k = int(np.argmax(np.where(np.abs(values) >= MIN_STRAIN, z, 1e-3 * z)))
    axis = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
    return float(values[k]), float(sigmas[k]), (float(axis[0]), float(axis[1]), float(axis[2]))


@dataclasses.dataclass(frozen=True)
class Drift:
    """How the pose changes from the first point of a scan to the last; zeros where nothing was fitted."""

    rotation_rad: float = 0.0
    displacement: float = 0.0  # Root mean square over the points, a length
    significance: float = 0.0  # Standard deviations
    along: Vector = (0.0, 0.0, 0.0)  # Direction in which the middle of the points moves, zeros where it mostly turns

    def matters(self, size: float) -> bool:
        """Whether it is significant, and not small against a size."""
        return self.significance >= DRIFT_SIGMAS and self.displacement >= MIN_DRIFT_DIAGONALS * size


def drift_of(points: FloatArray, normals: FloatArray, residuals: FloatArray, times: FloatArray) -> Drift:
    """Drift from distances along the target's normals, fitted together with the motion that remains.

    Shapes: points (n, 3) in the order of a space-filling curve, normals (n, 3), residuals (n,), times (n,) from -1/2 to
    1/2.
    """
    if len(residuals) < MIN_DRIFT_CORRESPONDENCES:
        return Drift()
    middle = points.mean(axis=0)
    lever = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if not lever > 0.0:
        return Drift()
    still = plane_rows(points, normals, middle, lever)
    fit = robust_fit(np.vstack([still, times * still]), residuals, lever, weights_of(residuals))
    scatter = fit.scatter(points, normals)
    if scatter is None:
        return Drift()
    twist = fit.fitted[6:]
    # Exact data have no scatter: then any drift is significant, and rounding is none that matters.
    least = np.eye(6) * (ROUNDING_SHARE * np.trace(scatter) + TINY)
    square = float(twist @ np.linalg.solve(scatter[6:, 6:] + least, twist))
    moved = np.cross(twist[:3] / lever, points - middle) + twist[3:]
    displacement = float(np.sqrt((moved**2).sum(axis=1).mean()))
    shift = float(np.linalg.norm(twist[3:]))
    x, y, z = (twist[3:] / shift if shift > MIDDLE_SHIFT_SHARE * displacement else np.zeros(3)).tolist()
    return Drift(float(np.linalg.norm(twist[:3])) / lever, displacement, float(np.sqrt(max(square, 0.0))), (x, y, z))
