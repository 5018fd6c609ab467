"""How well scan and target agree at a pose, measured on an unbiased sample of the scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray, median, root_mean_square, share_of
from dqreg._records import replaced
from dqreg.geometry import CloudSurface, Scan, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.scan_measures import THINNED_POINTS
from dqreg.geometry.vector_rows import nonzero_rows
from dqreg.icp import Alignment, Correspondences, smallest_kernel_scale
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.icp.rejectors import at_boundary
from dqreg.registration.evidence.even_correspondences import LATE_POINTS, evenly_asked
from dqreg.registration.evidence.local_evidence import LocalEvidence, share
from dqreg.registration.evidence.surroundings import TOGETHER, Surroundings, displaced_of, surroundings_of
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust.chance import COUNTED_POINTS, places_of, random_ratio
from dqreg.trust.deformation import ON_A_PART, deformation_of, may_be_deformed
from dqreg.trust.deformed_faces import in_their_face
from dqreg.trust.evidence import PART_DEVIATION_DIAGONALS, Evidence, deviation_ratio
from dqreg.trust.limits import DEVIATING_PATCH_SHARE, MIN_NOISE_DIAGONALS
from dqreg.trust.patch_tests import (
    INLIER_SIGMAS,
    PATCH_POINTS,
    isolated,
    patches_off,
    share_together,
    stretch_of,
)
from dqreg.trust.strain import MIN_BEND, strain_of
from dqreg.trust.waviness import waviness_of

# A scan of fewer points does not know its own noise: neighbours stand on different faces. The pattern of the distances
# has a say there; on denser scans clutter makes patterns of its own, and the noise is known.
SPARSE = 1_000
# Fraction of the largest distance within which a point counts as the part's: farther off stands the table.
NEAR = 0.25
# Patches that deviate are measured by so many standard deviations of most inliers at most, and by this share of the
# size at least.
USUAL, LEAST = 3.0, 3e-4
# What displaces faces of a part by no more than made parts deviate leaves the pose where it is: half of what patches
# may, and what strains displace the surface, root mean square, or by so many times as much anywhere. A plate of 80 x 60
# x 6 made 0.02 too thick was strained by 0.3 %, and a step of a block made 0.05 too high was another part.
LARGEST_TO_USUAL = 2.0
# Points from which the strain is fitted; share of strays from which on they may draw the fit: scans with 10 % of them
# come to 0.09 and more, scans without, of other parts too, to 0.011.
STRAINED, SOME_STRAYS = 3_000, 0.05


def near_limit(max_distance: float) -> float:
    """Distance within which a point counts as the part's."""
    return NEAR * max_distance


def agreement_of(
    run: Alignment,
    scan: Scan,
    surface: Surface,
    max_distance: float,
    *,
    has_border: bool = False,
    pairs: Correspondences | None = None,
    axis: bool = False,
    given_normals: bool = False,
    expected: float = 0.0,
) -> Evidence:
    """Measure it at the end of a run; what needs more than the run is not known yet.

    Pairs are those that `evenly_asked` answers. A strain that is no fault has no axis unless that is asked for. Normals
    that came with a cloud are witnesses of their own. A part is expected to deviate by a length.
    """
    mixture, near = run.mixture, near_limit(max_distance)
    width = min(max(INLIER_SIGMAS * mixture.scale, expected), near)
    pairs = evenly_asked(run, scan, surface, mixture.scale) if pairs is None else pairs
    on = pairs.distances <= width
    here, aside = np.flatnonzero(on), pairs.point_to_plane[on]
    close, around = _close(pairs, surface, mixture.scale, width, near, has_border=has_border)
    alone = isolated(pairs.scan, on, scan if len(scan) <= THINNED_POINTS else None)
    # Where nothing is left out, as a rule, nothing is copied.
    kept = np.flatnonzero(~(around.elsewhere | alone)) if alone.any() or around.elsewhere.any() else slice(None)
    is_part, size = not isinstance(surface, CloudSurface), surface.diagonal
    ratio = deviation_ratio(expected, size)
    scale = _usual_scale(aside, surface, mixture.scale) if is_part else mixture.scale
    asked = pairs.scan.points[kept], pairs.distances[kept], pairs.point_to_plane[kept], close[kept]
    counted, off_wholly = patches_off(*asked, scale)
    off, deformed = share(off_wholly, counted), (0.0, 0.0)
    local = LocalEvidence.at_end(run, scan, surface, pairs, width, has_border=has_border, given_normals=given_normals)
    # Against a part, what differs from point to point is noise: the curvature of its faces is known.
    normals = np.take(pairs.closest.normals, here, axis=0)
    waviness, local_noise = waviness_of(aside, normals) if is_part else (0.0, np.nan)
    noise = local_noise if np.isfinite(local_noise) else mixture.scale
    shape = _Shape()
    # Between the points of two clouds, tangent planes are guesses.
    if is_part:
        asked_of, sparse = (on, False) if has_border else (close & ~alone, len(scan) < SPARSE)
        about = {"clutter": has_border or bool(around.elsewhere.any()), "strays": share_of(alone) > SOME_STRAYS}
        shape = _shape_of(pairs, asked_of, noise, size, ratio, **about, sparse=sparse, faults=not axis)
        # Neighbours of a sparse scan tell faces from outliers no better than chance; their heights do.
        off = off if has_border else max(off, displaced_of(pairs, close, width, noise, surface, ratio))
        if off > DEVIATING_PATCH_SHARE:
            off_far = patches_off(*asked, max(scale, PART_DEVIATION_DIAGONALS * size * ratio))[1]
            deformed = _deformed(pairs, on, kept, off_wholly, off_far, counted)
    return replaced(
        _amid(around, _counted(run, surface, pairs, close, max_distance, has_border=has_border, expected=expected)),
        patches=int(np.count_nonzero(counted)),
        patches_off=off,
        patches_deformed=deformed[0],
        share_deformed=deformed[1],
        strays=local.strays,
        normals_apart=local.normals_apart,
        expected=local.noise,
        stretch=shape.stretch,
        stretched_along=shape.stretched_along,
        bend=shape.bend,
        deformation=shape.deformation,
        waviness=waviness,
        local_noise=local_noise,
        share_together=_together(pairs, close, kept, noise, ratio * min(scan.diagonal, size)) if is_part else 0.0,
        random_ratio=_random_ratio(pairs, on, surface),
    )


def _amid(around: Surroundings, found: Evidence) -> Evidence:
    """The same with what else there is around the target."""
    return replaced(
        found,
        share_on=around.share_on,
        share_other=around.share_other,
        share_contradicting=around.share_contradicting,
        share_on_faces=around.share_on_faces,
        going_on=around.going_on,
    )


def agreement_in_time(
    run: Alignment, scan: Scan, surface: Surface, max_distance: float, *, has_border: bool = False
) -> Evidence:
    """The same where the time is up and no pose is accepted: how many points are inliers, and how far off they are."""
    scale, near = run.mixture.scale, near_limit(max_distance)
    pairs = evenly_asked(run, scan, surface, scale, LATE_POINTS)
    border = surface, scale, min(INLIER_SIGMAS * scale, near), near
    close = _within_border(pairs, *border) if has_border else pairs.distances <= near
    counted = _counted(run, surface, pairs, close, max_distance, has_border=has_border)
    least = scan.spacing if has_border else smallest_kernel_scale(scan, surface)
    return replaced(counted, expected=max(noise_on(scan, surface), least))


def _counted(
    run: Alignment,
    surface: Surface,
    pairs: Correspondences,
    close: BoolArray,
    max_distance: float,
    *,
    has_border: bool,
    expected: float = 0.0,
) -> Evidence:
    """How many points are inliers, of those that count, (n,), and how far off they are; nothing else is known."""
    near = near_limit(max_distance)
    of_noise = min(INLIER_SIGMAS * run.mixture.scale, near)
    on = pairs.distances <= min(max(of_noise, expected), near)
    here, aside = np.flatnonzero(on), pairs.point_to_plane[on]
    width = root_mean_square(aside) if len(aside) else run.mixture.scale
    of_inliers = pairs.point_to_plane[pairs.distances <= of_noise] if expected > of_noise else aside
    return Evidence(
        status=run.status,
        found=run.found,
        inliers=float(run.weights.sum()),
        max_distance=max_distance,
        directions=(),
        alternatives=(),
        has_border=has_border,
        size=surface.diagonal,
        share_near=share(on, close),
        near=near,
        patches=0,
        patches_off=0.0,
        strays=0.0,
        normals_apart=0.0,
        width=width,
        expected=0.0,
        places=places_of(np.take(pairs.moved, here[sample_rows(len(here), COUNTED_POINTS)], axis=0)),
        share_on=share_of(on),
        share_other=share_of(~on),
        looking_away=pairs.looking_away(max_distance),
        expected_deviation=expected,
        _width_of_inliers=root_mean_square(of_inliers) if len(of_inliers) else width,
    )


def _close(
    pairs: Correspondences, surface: Surface, scale: float, width: float, near: float, *, has_border: bool
) -> tuple[BoolArray, Surroundings]:
    """Which points near the target count, (n,), and what those are that do not."""
    on = pairs.distances <= width
    if not has_border:
        around = surroundings_of(pairs, width, near, surface.diagonal)
        return (pairs.distances <= near) & (on | ~around.elsewhere), around
    around = Surroundings(np.zeros(len(on), dtype=bool), share_of(on), share_of(~on), 0.0, np.nan)
    return _within_border(pairs, surface, scale, width, near), around


def _within_border(pairs: Correspondences, surface: Surface, scale: float, width: float, near: float) -> BoolArray:
    """Which points near an open target count, (n,): what lies beyond its border was not measured there."""
    on, close = pairs.distances <= width, pairs.distances <= near
    close &= on | ~at_boundary(pairs.closest, surface, scale)
    close &= on | (np.abs(pairs.point_to_plane) > width)
    return close


class _Shape(NamedTuple):
    """What differs; zeros where nothing was fitted."""

    stretch: float = 0.0  # Significant strain; below zero where the scan is shorter
    stretched_along: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Its axis; zeros for a scale
    bend: float = 0.0  # Significant bend, sagitta over length
    deformation: float = 0.0  # Displacement of the surface by a significant deformation; a length


def _shape_of(
    pairs: Correspondences,
    counted: BoolArray,
    noise: float,
    size: float,
    ratio: float,
    *,
    clutter: bool,
    strays: bool,
    sparse: bool,
    faults: bool,
) -> _Shape:
    """How the counted points, (n,), differ from a part, of a noise and size; beside clutter without deformations.

    What is smaller than what made parts deviate by, times a ratio, is none. In a sparse scan, which knows no
    covariance, a strain is a pattern of one. Faults alone have an axis, if so asked.
    """
    rows = np.flatnonzero(counted & nonzero_rows(pairs.closest.normals))
    rows = rows[sample_rows(len(rows), STRAINED)]
    # At their feet: the points themselves hold the residual that is to be explained, a strain of one along it.
    feet, normals = (np.take(x, rows, axis=0) for x in (pairs.closest.points, pairs.closest.normals))
    columns = feet, normals, pairs.point_to_plane[rows]
    strain = strain_of(*columns, clutter=clutter, strays=strays, faults=faults)
    if sparse and not strain.is_strained:
        value, along = stretch_of(*columns, PART_DEVIATION_DIAGONALS * size * ratio)
        strain = replaced(strain, value=value, sigma=0.0, along=(along[0], along[1], along[2]))
    width = root_mean_square(columns[2]) if len(rows) else 0.0
    deformation = 0.0
    if not clutter and may_be_deformed(width, noise, size * ratio):
        deformation = deformation_of(*columns, size * ratio, ON_A_PART)
    matters = max(strain.shown, strain.most / LARGEST_TO_USUAL) >= PART_DEVIATION_DIAGONALS * size * ratio
    is_strained = strain.is_strained and (sparse or matters)
    is_bent = strain.is_bent and strain.bend >= MIN_BEND * ratio
    return _Shape(strain.value if is_strained else 0.0, strain.along, strain.bend if is_bent else 0.0, deformation)


def _together(pairs: Correspondences, close: BoolArray, kept: IntArray | slice, noise: float, size: float) -> float:
    """Share of the points near a part that lie off it together, beyond the noise."""
    off = pairs.distances[kept] > TOGETHER * max(noise, MIN_NOISE_DIAGONALS * size)
    return share_together(pairs.moved[kept], off, close[kept])


def _deformed(
    pairs: Correspondences,
    on: BoolArray,
    kept: IntArray | slice,
    off: BoolArray,
    off_far: BoolArray,
    counted: BoolArray,
) -> tuple[float, float]:
    """Share of the counted patches of the kept points, (k,), that are off as faces deform, and of the points, (n,).

    Those that are not off far are of how the part was made.
    """
    bent = (off & ~off_far) | in_their_face(pairs.closest.points[kept], pairs.closest.normals[kept], off_far, counted)
    lost = ~on[kept][: PATCH_POINTS * len(bent)].reshape(-1, PATCH_POINTS)[bent]
    return share(bent, counted), np.count_nonzero(lost) / len(on)


def _usual_scale(aside: FloatArray, surface: Surface, most: float) -> float:
    """Scale of the distances along the normals of most inliers: a sparse scan has a kernel as wide as its spacing."""
    least, far = LEAST * surface.diagonal, np.abs(aside)
    # Where more than half are beyond what the most stands for, so is their median: that settles it.
    if least >= most or 2 * np.count_nonzero(far > most / (USUAL * GAUSSIAN_MEDIAN)) > len(far) or not len(far):
        return most
    return min(most, max(USUAL * GAUSSIAN_MEDIAN * median(far), least))


def _random_ratio(pairs: Correspondences, on: BoolArray, surface: Surface) -> float:
    rms = root_mean_square(pairs.distances[on]) if on.any() else 0.0
    return random_ratio(pairs.moved, share_of(on), rms, surface)
