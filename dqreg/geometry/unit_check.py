"""Lengths of source and target that look as if they were in different units.

A scan may be smaller than its part (a partial view, a patch) and larger (the part stands in a scene), so a ratio of
sizes alone says little until it is absurd. Three kinds of evidence, from the standard deviations along the principal
axes of either side (of the nearest 95 % of the points, so that outliers do not matter):

- beyond a factor of 150 no scan belongs to its part; the nearest ratio of units is named;
- near 10, 25.4 or 100 the *shapes* must agree as well: the deviations in about that same ratio, as for a scan of the
  whole part. A patch of a part or a scene around it has other proportions;
- near 3.28 (feet and metres), 2.54, 12, 30.48 or 39.37 all three deviations must agree to 5 %; near the last three the
  shapes suffice, as above, where the scan is the smaller side, or has so few points that of a part amid a scene a
  hundred would be left, which is no scan of it;
- between two clouds the *spacing* must speak the same language: a unit scales it along with the size, while a
  small scan of a large object, or a scene about a model, has nearly the spacing of the other side.

Measured on nine CAD parts: with 1, 2 and 3 views 56, 74 and 85 % of mistakes by 10 or 25.4 are seen, and of those by
304.8 or 1000 all; on 17 parts with 1, 3 and 6 views 0, 16 and 57 % of those by 2.54 to 39.37; of random scenes 4 to
140 times as large as the part 2 % look like a mistake, of patches of 0.3 to 10 % of a part 1 %, of 59 pairs of real
scans (LiDAR, scenes, partial views) none. What is not seen here does not fit later, and the verdict of the registration
says so.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg.errors import UnitsError
from dqreg.files.units import MIXED, MIXED_RARELY, factor
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.sampling import places_on
from dqreg.geometry.spacing import measure_spacing

# A larger ratio of sizes has no other reading than a mistake.
ABSURD_RATIO = 150.0
# An absurd ratio holds a unit and, for a scan of a part of the object, up to that factor.
MAX_PART_RATIO = 5.0
# A ratio of units that near to the ratio of sizes comes first.
CLOSE_RATIO = 1.25
# Agreement of the two large principal deviations with the ratio of units,
UNIT_AGREEMENT_RATIO = 1.18
# and the least and the most of the third: a scan from a few sides is thinner than its part, never thicker. A scan much
# smaller than its part must not be flat either: it would be a patch.
MIN_THICKNESS_RATIO, MAX_THICKNESS_RATIO = 0.45, 1.18
# Agreement of all three deviations with the ratio of units that are confused less often.
CLOSE_AGREEMENT_RATIO = 1.05
# A part that is so many points of a scan at most was not scanned: then the ratio of sizes is none of a scene to a part,
# and shapes that agree tell units whose ratio is at least so large, however seldom they are confused.
UNSCANNED_POINTS, FAR_APART = 100, 10.0
# Spacings of two clouds agree with the ratio of units within that factor: sensors differ; nor are they nearer to equal.
MAX_SPACING_RATIO = 3.0
SPREAD_SAMPLE, KEPT_SHARE = 5_000, 0.95
# Sizes of so few points that differ by less than this are no mistake: the least ratio of units is 2.54, and half of the
# points of a body are within 0.5 to 1.3 of its spread, whatever its strays are.
FEW_POINTS = 500
LEAST_ALIKE, MOST_ALIKE = 0.52, 1.26


@dataclasses.dataclass(frozen=True)
class UnitMistake:
    """A likely mistake of units."""

    ratio: float  # Size of the source by the size of the target, in the numbers as they are
    factor: float  # The ratio of units it is taken for, source numbers by target numbers
    # source_units, target_units: Units under which the sizes would agree
    source_units: str
    target_units: str
    sentence: str  # What was found, and what to do


def require_same_units(
    source: PointCloud | Mesh,
    target: PointCloud | Mesh,
    source_units: str | None = None,
    target_units: str | None = None,
    target_spreads: FloatArray | None = None,
) -> None:
    """Raise where source and target look as if they were in different units.

    Where both units are known, the source is in the target's unit already, and the units may be the mistake.
    """
    if source_units is not None and target_units is not None:
        require_right_units(source, target, source_units, target_units, target_spreads)
        return
    mistake = find_unit_mistake(source, target, source_units, target_units, target_spreads)
    if mistake is not None:
        raise UnitsError(mistake.sentence)


def find_unit_mistake(
    source: PointCloud | Mesh,
    target: PointCloud | Mesh,
    source_units: str | None = None,
    target_units: str | None = None,
    target_spreads: FloatArray | None = None,
) -> UnitMistake | None:
    """The likely mistake of units between two sides, or None."""
    if source_units is not None and target_units is not None:
        return None
    if target_spreads is not None and _is_alike(source, target_spreads):
        return None
    spreads = principal_spreads(source), principal_spreads(target) if target_spreads is None else target_spreads
    sizes = tuple(float(np.linalg.norm(spread)) for spread in spreads)
    if not min(sizes) > 0.0:
        return None
    ratio = sizes[0] / sizes[1]
    known = (source_units, target_units) if ratio > 1.0 else (target_units, source_units)
    # The larger numbers are in the finer unit.
    pairs, rare = (
        [(coarse, fine) for coarse, fine in mixed if known[0] in (None, fine) and known[1] in (None, coarse)]
        for mixed in (MIXED, MIXED_RARELY)
    )
    seen = [pair for pair in rare if _same_spreads(*spreads, ratio, factor(*pair))]
    loose = [pair for pair in pairs if _same_shape(*spreads, ratio, factor(*pair))]
    loose += [pair for pair in rare if _is_rare_mistake(source, *spreads, ratio, factor(*pair)) and pair not in seen]
    # Ten is near to twelve: the ratio itself says which of them comes first.
    seen += sorted(loose, key=lambda pair: abs(np.log(max(ratio, 1.0 / ratio) / factor(*pair))))
    over = max(ratio, 1.0 / ratio)
    if over > ABSURD_RATIO:
        # A unit that explains no such ratio is the mistake itself: of a depth image it is a guess.
        seen = seen or _explanations(over, pairs or list(MIXED), whole=ratio < 1.0)
    else:
        seen = [pair for pair in seen if _same_spacing(source, target, ratio, factor(*pair))]
    if not seen:
        return None
    coarse, fine = seen[0]
    units = factor(coarse, fine)
    named = (fine, coarse) if ratio > 1.0 else (coarse, fine)
    return UnitMistake(ratio, units if ratio > 1.0 else 1.0 / units, *named, _sentence(ratio, sizes, seen))


def require_right_units(
    source: PointCloud | Mesh,
    target: PointCloud | Mesh,
    source_units: str,
    target_units: str,
    target_spreads: FloatArray | None = None,
) -> None:
    """Raise where sizes agree without the conversion that two units ask for, and with it cannot; source: converted."""
    converted = factor(source_units, target_units)
    if converted == 1.0:
        return
    spreads = principal_spreads(source), principal_spreads(target) if target_spreads is None else target_spreads
    sizes = tuple(float(np.linalg.norm(spread)) for spread in spreads)
    if not min(sizes) > 0.0:
        return
    ratio = sizes[0] / sizes[1]
    as_is, over = ratio / converted, max(converted, 1.0 / converted)
    absurd = max(ratio, 1.0 / ratio) > ABSURD_RATIO and 1.0 / MAX_PART_RATIO <= as_is <= MAX_PART_RATIO
    if not absurd:
        # A conversion the other way brought the sizes nearer.
        if (ratio > 1.0) != (converted > 1.0) or not _same_shape(*spreads, ratio, over):
            return
        if not _same_spacing(source, target, ratio, over):
            return
    size = f"{ratio:.4g} times as large as" if ratio > 1.0 else f"{1.0 / ratio:.4g} times smaller than"
    raise UnitsError(
        f"with the source in {source_units} and the target in {target_units}, the source is {size} the target; with "
        f"the numbers as they are, it is {as_is:.3g} times as large: one of the units is wrong. Name the unit that "
        f"both are in for each, such as --source-units {target_units} --target-units {target_units}; if the units are "
        'right as they are, say units="ignore" (--units ignore)'
    )


def principal_spreads(geometry: PointCloud | Mesh) -> FloatArray:
    """Standard deviations along the principal axes, the largest first, outliers left out."""
    from dqreg.kernels.clouds.spreads import scatter_of_most
    from dqreg.kernels.threads import as_plain

    if isinstance(geometry, Mesh):
        points = places_on(geometry, SPREAD_SAMPLE, np.random.default_rng(0))[0]
    else:
        points = geometry._at(sample_rows(len(geometry), SPREAD_SAMPLE))
    variances = np.linalg.eigvalsh(scatter_of_most(as_plain(points), KEPT_SHARE))[::-1]
    spreads: FloatArray = np.sqrt(np.maximum(variances, 0.0))
    return spreads


def _is_alike(source: PointCloud | Mesh, target_spreads: FloatArray) -> bool:
    """Whether a few points say that the sizes differ by far less than any two units do."""
    if isinstance(source, Mesh):
        return False
    columns = np.ascontiguousarray(source._at(sample_rows(len(source), FEW_POINTS)).T)
    columns -= np.partition(columns, len(columns.T) // 2, axis=1)[:, len(columns.T) // 2, None]
    size = median(np.sqrt(np.einsum("ij,ij->j", columns, columns)))
    other = float(np.linalg.norm(target_spreads))
    return LEAST_ALIKE <= size / other <= MOST_ALIKE if other > 0.0 else False


def _explanations(over: float, pairs: list[tuple[str, str]], whole: bool) -> list[tuple[str, str]]:
    """Pairs of units that explain an absurd ratio, the likely first; ``whole``: the larger side is the target."""
    # A scan of a part of the object makes the ratio smaller where the scan has the larger numbers, else larger.
    low, high = (over / MAX_PART_RATIO, over / 0.8) if whole else (0.8 * over, over * MAX_PART_RATIO)
    near = sorted(pairs, key=lambda pair: abs(np.log(over / factor(*pair))))
    close = [pair for pair in near if abs(np.log(over / factor(*pair))) <= np.log(CLOSE_RATIO)]
    likely = [pair for pair in pairs if low <= factor(*pair) <= high and pair not in close]
    return close + likely or near[:1]


def _same_shape(source: FloatArray, target: FloatArray, ratio: float, units: float) -> bool:
    """Whether the spreads agree once the larger side is divided by a ratio of units."""
    scan = source / units if ratio > 1.0 else source * units
    if not min(scan[1], target[1]) > 0.0:
        return False
    large = np.abs(np.log(scan[:2] / target[:2])).max() <= np.log(UNIT_AGREEMENT_RATIO)
    thin = 0.0 if ratio > 1.0 else MIN_THICKNESS_RATIO
    return bool(large and thin * target[2] <= scan[2] <= MAX_THICKNESS_RATIO * target[2] + 0.02 * target[0])


def _same_spreads(source: FloatArray, target: FloatArray, ratio: float, units: float) -> bool:
    """Whether all spreads agree closely once the larger side is divided by a ratio of units."""
    scan = source / units if ratio > 1.0 else source * units
    if not min(scan[2], target[2]) > 0.0:
        return False
    return bool(np.abs(np.log(scan / target)).max() <= np.log(CLOSE_AGREEMENT_RATIO))


def _is_rare_mistake(
    source: PointCloud | Mesh, of_source: FloatArray, of_target: FloatArray, ratio: float, units: float
) -> bool:
    """Whether shapes agree at a ratio of units that are seldom confused, and nothing else explains that ratio."""
    if units < FAR_APART or not _same_shape(of_source, of_target, ratio, units):
        return False
    return ratio < 1.0 or (isinstance(source, PointCloud) and len(source) <= UNSCANNED_POINTS * units**2)


def _same_spacing(source: PointCloud | Mesh, target: PointCloud | Mesh, ratio: float, units: float) -> bool:
    """Whether the spacings of two clouds differ by the ratio of units too; a mesh has none and says nothing."""
    if isinstance(source, Mesh) or isinstance(target, Mesh):
        return True
    one, other = (measure_spacing(NeighbourTree(cloud.points), cloud.points) for cloud in (source, target))
    over = one / other if ratio > 1.0 else other / one
    within = min(MAX_SPACING_RATIO, np.sqrt(units))
    return bool(units / within <= over <= units * within)


def _sentence(ratio: float, sizes: tuple[float, ...], likely: list[tuple[str, str]]) -> str:
    size = f"{ratio:.4g} times as large as" if ratio > 1.0 else f"{1.0 / ratio:.4g} times smaller than"
    (source, target), *others = [(fine, coarse) if ratio > 1.0 else (coarse, fine) for coarse, fine in likely]
    also = "".join(f" (or {one} and {other})" for one, other in others[:1])
    return (
        f"the source is {size} the target (spread {sizes[0]:.3g} against {sizes[1]:.3g}): near "
        f"{factor(*likely[0]):g}, as if the source were in {source} and the target in {target}{also}. Name both: "
        f'source_units="{source}", target_units="{target}" (--source-units {source} --target-units {target}); if the '
        'sizes are right as they are, say units="ignore" (--units ignore)'
    )
