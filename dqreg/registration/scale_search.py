"""Global search of the scale: a few scales are tried, each from its own initial pose, and the likeliest is kept.

Each is refined together with its pose on a few thousand points, and ranked there by the likelihood of the distances in
the *source's* own unit, where the noise does not change with the scale: in the target's unit the smallest copy would
always fit best.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.files.units import RATIOS
from dqreg.geometry import Mesh, Surface
from dqreg.geometry.scan import Scan
from dqreg.icp import COARSE_POINTS, Correspondences, InlierMixture, find_correspondences, smallest_kernel_scale
from dqreg.registration.initial_pose import GlobalSearch
from dqreg.registration.problem.problem import SourceAndTarget
from dqreg.rigid import pose
from dqreg.solvers.robust import GemanMcClure
from dqreg.solvers.scale import ScaleStep, SurfaceMatches, scale_step
from dqreg.trust.records import Reason

# Steps of the joint refinement at most.
MAX_STEPS = 40
# The largest change of scale in one of them; the change that is none.
MAX_SCALE_STEP, CONVERGED_SCALE_CHANGE = 1.03, 1e-6


@dataclasses.dataclass(frozen=True)
class ScaleCandidate:
    """A scale, its pose, and how badly both explain the scan."""

    scale: float  # What the source, in the unit it is worked with, is multiplied with
    T_centred: FloatArray  # (4, 4): Pose of the scaled source between the centred frames
    mean_nll: float  # Mean negative log-likelihood of the distances in source units; the lower the better
    held: bool  # Whether the correspondences constrain the scale
    width: float = np.inf  # Standard deviation of the inliers' distances, source units
    inlier_fraction: float = 0.0  # Of all points


def scaled(scan: Scan, scale: float) -> Scan:
    """A scan in another unit."""
    return dataclasses.replace(
        scan,
        points=scale * scan.points,
        levers=scale**2 * scan.levers,
        residuals=scale * scan.residuals,
        spacing=scale * scan.spacing,
        noise=scale * scan.noise,
        quiet=None if scan.quiet is None else scale * scan.quiet,
    )


def joint_step(
    scan: Scan,
    surface: Surface,
    scale: float,
    T_centred: FloatArray,
    weigh: Callable[[Correspondences], FloatArray],
    *,
    hold: bool = False,
) -> ScaleStep:
    """One step of scale and pose together, from the closest places of a scaled scan."""
    pairs = find_correspondences(scaled(scan, scale), surface, T_centred)
    matches = SurfaceMatches(pairs.moved, pairs.closest.points, pairs.closest.normals, weigh(pairs))
    return scale_step(matches, hold=hold)


def refine_scale(search: GlobalSearch, scale: float, T_centred: FloatArray, *, hold: bool = False) -> ScaleCandidate:
    """Scale and pose together, on a few thousand points."""
    surface = search.target.surface
    few = search.scan.thinned(COARSE_POINTS)
    floor, held = smallest_kernel_scale(few, surface), True
    for _ in range(MAX_STEPS):
        try:
            step = joint_step(
                few, surface, scale, T_centred, partial(_robust, floor=scale * floor), hold=hold or not held
            )
        except DegenerateGeometryError:
            if not held:
                break
            held = False
            continue
        if not 1.0 / MAX_SCALE_STEP <= step.factor <= MAX_SCALE_STEP:
            step = dataclasses.replace(step, factor=float(np.clip(step.factor, 1.0 / MAX_SCALE_STEP, MAX_SCALE_STEP)))
        before, T_centred, scale = T_centred, step.moved(T_centred), scale * step.factor
        moved = (
            float(pose.offset_between(before, T_centred)) + float(pose.angle_between(before, T_centred)) * few.diagonal
        )
        if abs(np.log(step.factor)) <= CONVERGED_SCALE_CHANGE and moved <= CONVERGED_SCALE_CHANGE * surface.diagonal:
            break
    return _judged(search, few, ScaleCandidate(scale, T_centred, np.inf, held and not hold), floor)


def _robust(pairs: Correspondences, floor: float) -> FloatArray:
    return GemanMcClure.of_median(pairs.distances, floor).weight(pairs.distances)


def _judged(search: GlobalSearch, few: Scan, found: ScaleCandidate, floor: float) -> ScaleCandidate:
    surface, limit = search.target.surface, search.max_distance
    distances = find_correspondences(scaled(few, found.scale), surface, found.T_centred).distances / found.scale
    near = distances[distances <= limit]
    if not len(near):
        return found
    mixture = InlierMixture.widest(limit, floor).fit(near, floor=floor, rounds=100)
    mean_nll = mixture.mean_nll(near, rejected=len(distances) - len(near))
    return dataclasses.replace(
        found,
        mean_nll=mean_nll,
        width=mixture.scale,
        inlier_fraction=mixture.inlier_fraction * len(near) / len(distances),
    )


# Sizes of target and scan agree with a ratio of units within these factors: a scan from few sides is smaller than its
# part or, of a thin one, larger.
SMALLER, LARGER = 1.45, 2.0
# Ratios that are tried at most, those nearest to the ratio of the sizes.
MOST = 3
# Scales that are tried about a ratio, where the pose has to be searched (which stands 3 % off) and where it is given.
SEARCHED, GIVEN = (1.0, 0.95, 1.05, 0.9, 1.1), (1.0, 0.96, 1.04, 0.92, 1.08, 0.88, 1.12)
# And those between them, where none of the first fits.
BETWEEN = (0.975, 1.025, 0.925, 1.075, 0.875, 1.125)
# Poses that are followed at each; and the distances of a fit, in the scan's own noise.
FOLLOWED, FITS = 3, 4.0
# Fraction of the points that must lie on the target for the other scales to be spared: of views without strays right
# scales came to 0.999, wrong ones to 0.953, 0.959 and 0.986, but for corners, which fit at any scale. Among strays all
# scales are tried.
EXPLAINED = 0.99
# Two scales that near to each other are one.
SAME = 3e-3
# Distances of exact data, in sizes of the part.
EXACT = 1e-6
# A scale whose mean log-likelihood is that near to the best explains the scan as well; and how far from the best scale
# it is asked whether another scale would do.
AS_GOOD, ASIDE = 0.02, 0.03


def scale_starts(ratio: float, *, searched: bool) -> tuple[list[float], list[float]]:
    """Scales to try, the likely ones first; and further ones, where none of them fits."""
    units = sorted({*RATIOS, *(1.0 / r for r in RATIOS)}, key=lambda r: (r != 1.0, abs(np.log(ratio / r))))
    likely = [r for r in units if 1.0 / SMALLER <= ratio / r <= LARGER][:MOST] or [ratio]
    first = [float(middle * step) for middle in likely for step in (SEARCHED if searched else GIVEN)]
    further = [float(middle * step) for middle in dict.fromkeys([*likely, ratio]) for step in BETWEEN]
    return first, further


def try_scale(
    search: GlobalSearch, scale: float, T_start: FloatArray | None, frames: Callable[[float], SourceAndTarget]
) -> tuple[ScaleCandidate, ...]:
    """Where a scale leads to, from the initial pose that was given or from what the search finds."""
    if T_start is None:
        again = dataclasses.replace(search, scan=scaled(search.scan, scale), max_distance=scale * search.max_distance)
        starts = [c.T_target_source for c in again.candidates()[:FOLLOWED]]
    else:
        # The pose may be that of the scaled source, or be known from elsewhere for the source as it is.
        meant, as_it_is = (frames(s).to_centred(T_start) for s in (scale, 1.0))
        same = float(np.abs(meant - as_it_is).max()) <= CONVERGED_SCALE_CHANGE * search.target.surface.diagonal
        starts = [meant] if same else [meant, as_it_is]
    return tuple(refine_scale(search, scale, T) for T in starts)


def explained(search: GlobalSearch, candidates: list[ScaleCandidate]) -> bool:
    """Whether the best of some candidates leaves little of the scan over, so that no others need to be tried."""
    return fits(search, candidates) and _likeliest(candidates).inlier_fraction >= EXPLAINED


def fits(search: GlobalSearch, candidates: list[ScaleCandidate]) -> bool:
    """Whether the best of some candidates lies on the target as closely as the scan's own noise allows."""
    if not candidates:
        return False
    scan, best, surface = search.scan, _likeliest(candidates), search.target.surface
    # From cloud to cloud the closest point is a spacing away.
    usual = scan.noise if isinstance(search.target.geometry, Mesh) else scan.noise + scan.spacing
    return best.width <= max(FITS * usual, EXACT * surface.diagonal / best.scale)


def _likeliest(candidates: list[ScaleCandidate]) -> ScaleCandidate:
    return min(candidates, key=lambda c: c.mean_nll)


def distinct_scales(candidates: list[ScaleCandidate]) -> list[ScaleCandidate]:
    """The best candidate of each scale, the best first."""
    kept: list[ScaleCandidate] = []
    for candidate in sorted(candidates, key=lambda c: c.mean_nll):
        if all(abs(np.log(candidate.scale / other.scale)) > SAME for other in kept):
            kept.append(candidate)
    return kept


def why_not_fixed(search: GlobalSearch, found: list[ScaleCandidate]) -> Reason | None:
    """Why the data do not fix the scale; None where they do."""
    best = found[0]
    free = "the scale is unobservable: planes, cones and corners look alike at any scale; give the scale"
    if not best.held:
        return Reason(free, "scale_unobservable")
    if not fits(search, found):
        return Reason(
            f"no scale that was tried fits (best at {best.scale:.6g}); give the scale, or an initial pose",
            "scale_misfit",
        )
    for factor in (1.0 - ASIDE, 1.0 + ASIDE):
        aside = refine_scale(search, factor * best.scale, best.T_centred, hold=True)
        if aside.mean_nll <= best.mean_nll + AS_GOOD:
            return Reason(
                f"{free} (at {factor * best.scale:.6g} the scan fits as well as at {best.scale:.6g})",
                "scale_unobservable",
            )
    others = [c.scale for c in found[1:] if c.mean_nll <= best.mean_nll + AS_GOOD]
    if others:
        return Reason(
            f"the scan fits at another scale as well: {', '.join(f'{s:.6g}' for s in others)}; give the scale",
            "scale_ambiguous",
        )
    return None
