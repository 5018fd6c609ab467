"""Roundness and straightness: the width of the zone that the profiles of a face lie in, the worst of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.angles import gaps_around
from dqreg.inspection.decision.surface_model import sigma_of
from dqreg.inspection.drawing.characteristics import Measured
from dqreg.inspection.drawing.random_field import Series, drawn_series
from dqreg.inspection.features.fit import zone_width
from dqreg.inspection.features.zone import chebyshev_step
from dqreg.inspection.line_forms.profiles import Profile
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

# A profile is the medians of so many blocks of neighbouring points at most, each of so many points at least.
MAX_BLOCKS, MIN_BLOCK_POINTS = 96, 3
# Fewer blocks than that hold as few points as there are: lobes need more of them than a circle has parameters.
FEW_BLOCKS = 24
# Undulations that are looked for all round, and along a line.
ROUND_UNDULATIONS, LINE_UNDULATIONS = 3.0, 1.5
# The end of a line, of a cubic bow, rises by that share of the zone in its length.
END_SLOPE = 6.0
# A larger share of a turn without points is no part of the face.
OPENING_SHARE = 0.25
# A gap hides no more than all but that share of an undulation.
MIN_SEEN_SHARE = 0.25
# Draws whose minimum zone is found; that of the others is narrower than their least squares one by the same share.
ZONE_DRAWS = 3
# The zone between circles follows its centre, which is moved so often at most.
MAX_CENTRE_MOVES = 5
# Bound of the steps of a zone, in widths of the profile.
MAX_STEP_WIDTHS = 1e3


def worst_form(profiles: Sequence[Profile], noise: float) -> Measured:
    """Roundness of sections or straightness of lines: of the worst of them.

    Its surface is what a random field makes of medians of neighbouring points; points that were probed by hand, whose
    ``noise`` is 0 because it is not known, are taken as they are. What lies between points counts to the uncertainty.
    """
    profiles = [each.centred() for each in profiles]
    if noise == 0.0:
        zones = np.array([[_width(each, each.values)] for each in profiles])
        hidden = max(_hidden_share(each, each) * zone for each, zone in zip(profiles, zones[:, 0], strict=True))
        return Measured(float(zones.max()), float(hidden), profiles[int(np.argmax(zones))].middle)
    own = _noise(profiles, noise) or noise
    blocks = [each.blocks(block_count(len(each.values))) for each in profiles]
    series = [
        Series(each.places, each.values, each.slopes, sigma_of(own, len(whole.values) // len(each.values)))
        for whole, each in zip(profiles, blocks, strict=True)
    ]
    drawn = drawn_series(series)
    zones = np.array([_zones(each, values) for each, values in zip(blocks, drawn.values, strict=True)])
    mean = max(_width(each, values.mean(axis=0)) for each, values in zip(blocks, drawn.values, strict=True))
    worst = profiles[int(np.argmax(zones.mean(axis=1)))].middle
    value, room = drawn.measured(zones.max(axis=0), mean)
    # Between blocks lies what is left about a section's own centre: a travel of one wave a turn is known there. Noise
    # of the blocks is no form error that a gap could hide more of.
    hidden = max(
        _hidden_share(whole, each) * min(width_of_zone(each.values, each.along, each.radius), value + room)
        for whole, each in zip(profiles, blocks, strict=True)
    )
    return Measured(value, room + hidden, worst)


def block_count(count: int) -> int:
    """Blocks of as many points."""
    return int(np.clip(count // MIN_BLOCK_POINTS, min(count, FEW_BLOCKS), MAX_BLOCKS))


def _noise(profiles: Sequence[Profile], told: float) -> float:
    """Standard deviation of a point, from how neighbours along the profiles differ; of few points as it is ``told``."""
    steps = np.concatenate([np.diff(each.values[np.argsort(each.along)]) for each in profiles])
    found = float(GAUSSIAN_MEDIAN * np.median(np.abs(steps)) / np.sqrt(2.0))
    # Few neighbours differ by the form error that lies between them.
    few = min(len(each.values) for each in profiles) < FEW_BLOCKS * MIN_BLOCK_POINTS
    return min(found, float(told)) if few else found


def _hidden_share(whole: Profile, blocks: Profile) -> float:
    """What a zone may lack, as a share of it, because its extremes lie between blocks or beyond the last one."""
    along = np.sort(blocks.along)
    if whole.radius:
        gaps = gaps_around(along)[1] / (2.0 * np.pi)
        return _between(float(gaps[gaps <= OPENING_SHARE].max(initial=0.0)) * ROUND_UNDULATIONS)
    ends = float(whole.along.min()), float(whole.along.max())
    size = (ends[1] - ends[0]) or 1.0
    beyond = END_SLOPE * max(float(along[0]) - ends[0], ends[1] - float(along[-1])) / size
    return max(beyond, _between(_largest_gap(along, whole.stretches) / size * LINE_UNDULATIONS))


def _largest_gap(along: FloatArray, stretches: FloatArray | None) -> float:
    """The longest stretch of a line without a point on it, where the face is."""
    if stretches is None:
        return float(np.diff(along).max(initial=0.0))
    low = np.maximum(along[:-1, None], stretches[:, 0])
    return float((np.minimum(along[1:, None], stretches[:, 1]) - low).max(initial=0.0))


def _between(undulations: float) -> float:
    """By how much an undulation may be higher than what stands on both sides of a gap, as a share of that."""
    seen = math.cos(math.pi * min(undulations, 0.5))
    return 1.0 / max(seen, MIN_SEEN_SHARE) - 1.0


def _zones(profile: Profile, drawn: FloatArray) -> FloatArray:
    """Width of the zone of each draw of a profile, (draws,)."""
    wide = np.ptp(drawn, axis=1)
    some = np.flatnonzero(wide > 0.0)
    some = some[:: max(len(some) // ZONE_DRAWS, 1)]
    if not len(some):
        return np.asarray(wide)
    narrow = [_width(profile, drawn[k]) for k in some]
    return np.asarray(wide * float(np.mean(np.array(narrow) / wide[some])))


def _width(profile: Profile, values: FloatArray) -> float:
    """Width of the zone of values along a profile."""
    return float(np.ptp(values)) if profile.held else width_of_zone(values, profile.along, profile.radius)


def width_of_zone(values: FloatArray, along: FloatArray, radius: float) -> float:
    """Least distance of two circles of one centre, or of two parallel lines, that hold a profile between them.

    ``values`` are beside a circle of a radius, along angles, or beside a straight line (radius 0). Shapes: (n,), (n,).
    """
    if not radius:
        size = float(np.ptp(along)) or 1.0
        slopes = np.column_stack([np.ones_like(along), (along - along.mean()) / size])
        step = _step(values, slopes)
        # The distance of the lines across them: they lean by what the profile does.
        return float(np.ptp(values + slopes @ step) / np.hypot(1.0, step[1] / size))
    points = (radius + values)[:, None] * np.column_stack([np.cos(along), np.sin(along)])
    centre, best = np.zeros(2), float(np.ptp(values))
    for _ in range(MAX_CENTRE_MOVES):
        away = points - centre
        lengths = np.linalg.norm(away, axis=1)
        step = _step(lengths - radius, np.column_stack([np.ones(len(away)), -away / lengths[:, None]]))
        centre = centre + step[1:]
        width = float(np.ptp(np.linalg.norm(points - centre, axis=1)))
        gained, best = best - width, min(best, width)
        if gained <= 1e-12 * radius:
            break
    return best


def _step(values: FloatArray, slopes: FloatArray) -> FloatArray:
    """The step that leaves the least range, (k,)."""
    unit = float(np.ptp(values)) or 1.0
    scaled = (values - values.mean()) / unit
    return unit * chebyshev_step(np.concatenate([scaled, -scaled]), np.concatenate([slopes, -slopes]), MAX_STEP_WIDTHS)


def axis_form(centres: FloatArray, covariances: FloatArray) -> Measured:
    """Straightness of an axis: the diameter of the least cylinder about the centres of its sections.

    Shapes: (k, 3), the height along the axis last, and (k, 2, 2).
    """
    heights = centres[:, 2]
    places = np.column_stack([np.zeros((len(heights), 2)), heights])
    slopes = np.column_stack([np.ones_like(heights), heights - heights.mean()])
    sigmas = np.sqrt(np.einsum("kii->ki", covariances).mean(axis=0))
    if not sigmas.all():
        return Measured(zone_width(centres, "line"), 0.0)
    drawn = drawn_series([Series(places, centres[:, k], slopes, float(sigmas[k])) for k in range(2)])
    x, y = drawn.values
    wide = 2.0 * np.hypot(x, y).max(axis=1)
    some = np.flatnonzero(wide > 0.0)
    some = some[:: max(len(some) // ZONE_DRAWS, 1)]
    narrow = [zone_width(np.column_stack([x[k], y[k], heights]), "line") / wide[k] for k in some]
    mean = zone_width(np.column_stack([x.mean(axis=0), y.mean(axis=0), heights]), "line")
    return Measured(*drawn.measured(wide * float(np.mean(narrow or [1.0])), mean))
