"""Questions of the verdict on the shapes of scan and target: strains, and what two scans have in common."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dqreg.solvers.motion_words import direction_words
from dqreg.trust.deformation import BETWEEN_CLOUDS, ON_A_PART
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import (
    CLOSED_HOLE_DIAGONALS,
    FACES_APART_SHARE,
    ONE_PLANE_SHARE,
    OPPOSED_EDGE_SHARE,
    RIM_GAIN_SHARE,
    ends_limit,
    rims_limit,
)
from dqreg.trust.question import asks, if_asked, in_sizes
from dqreg.trust.strain import MIN_BEND, MIN_DRIFT_DIAGONALS, MIN_STRAIN

# Said of figures that exist beyond their limits only.
UNLESS = "; 0 unless it is above the limit and significant"


def _told(value: float, least: float) -> tuple[float, float]:
    """A figure that is 0 unless it was told, and from where on it is: a smaller one by a test that asks for no size."""
    value = if_asked(value)
    return value, 0.0 if value > 0.0 and not value > least else least


@asks("stretched", f"Strain against the target{UNLESS}", "at most", "1", lambda e: _told(abs(e.stretch), MIN_STRAIN))
def stretched(evidence: Evidence) -> Iterator[str]:
    """The scan is longer or shorter than the target."""
    along = evidence.stretched_along if any(evidence.stretched_along) else None
    how = ("short", "long")[evidence.stretch > 0.0] if along else ("small", "large")[evidence.stretch > 0.0]
    words = f"{100 * abs(evidence.stretch):.2g} % too {how}" + (f" along {direction_words(along)}" if along else "")
    scaled = 'a part that shrank or a scaled file (scale="solve" or --scale solve estimates it), another part'
    cause = "another part" if along else scaled
    yield f"the scan is {words}: {cause}, or a local minimum"


@asks(
    "bent", f"Bend, sagitta over length{UNLESS}", "at most", "1", lambda e: _told(e.bend, MIN_BEND * e.deviation_ratio)
)
def bent(evidence: Evidence) -> Iterator[str]:
    """The scan is bent or twisted against the target."""
    yield f"the scan is bent or twisted by {100 * evidence.bend:.2g} % of its length against the target"


# Of several limits, each with a significance of its own, the smallest.
LEAST_ON_A_PART, LEAST_BETWEEN_CLOUDS = (
    min(limit.shown for limit in (*limits.few, *limits.many)) for limits in (ON_A_PART, BETWEEN_CLOUDS)
)


def _deformation(evidence: Evidence) -> tuple[float, float]:
    is_part = math.isnan(evidence.faces_apart)
    least = evidence.deviation_ratio * (LEAST_ON_A_PART if is_part else LEAST_BETWEEN_CLOUDS)
    value = in_sizes(evidence, evidence.deformation)
    return _told(value, least) if evidence.deformation else (value, least)


@asks(
    "deformed", f"Smooth deformation of the scan against the target, of the size{UNLESS}", "at most", "1", _deformation
)
def deformed(evidence: Evidence) -> Iterator[str]:
    """A smooth deformation explains what no motion does."""
    yield (
        f"a deformation displaces the surface of the scan by {evidence.length(evidence.deformation)} "
        f"({100 * evidence.deformation / evidence.size:.2g} % of the size, root mean square), which no motion "
        "explains: stretched, bent or distorted, other parts, or moved during a scan"
    )


def _drift(evidence: Evidence) -> tuple[float, float]:
    value = in_sizes(evidence, evidence.drift) if evidence.size > 0.0 else evidence.drift
    # The shift between two exposures counts whatever its size.
    return _told(value, MIN_DRIFT_DIAGONALS * evidence.deviation_ratio)


@asks("drift", f"Drift of the pose along the scan, of the size{UNLESS}", "at most", "1", _drift)
def drift(evidence: Evidence) -> Iterator[str]:
    """The pose drifts along the scan."""
    along = f" along {direction_words(evidence.drift_along)}" if any(evidence.drift_along) else ""
    # Of two exposures no direction is known.
    lacks = "it shows a face that the open target lacks, or " if evidence.has_border and not along else ""
    yield (
        f"the pose drifts by {evidence.length(evidence.drift)}{along} and "
        f"{math.degrees(evidence.drift_rad):.2g} degrees within the scan: {lacks}part or scanner moved "
        "during it or between two exposures, or its views do not fit"
    )


@asks(
    "faces_apart",
    "Places that both scans show and that lie apart",
    "at most",
    "1",
    lambda e: (e.faces_apart, FACES_APART_SHARE),
)
def faces_apart(evidence: Evidence) -> Iterator[str]:
    """Places that both scans show lie apart."""
    yield (
        f"{100 * evidence.faces_apart:.0f} % of the places that both scans show lie apart by more than their noise "
        "and 0.2 % of the size: a wrong pose, or things that moved or differ between the scans"
    )


# What is said of faces that end at different places begins alike.
PLANES_END = "the scans have a few planes in common at most, which fit many corners, and their faces end at different "


@asks(
    "ends_apart",
    "Faces in the only common planes that reach beyond the other scan",
    "at most",
    "1",
    lambda e: (e.ends_apart, ends_limit(e)),
)
def ends_apart(evidence: Evidence) -> Iterator[str]:
    """Each scan's faces reach beyond the other's."""
    yield f"{PLANES_END}places: {100 * evidence.ends_apart:.0f} % of each and more lie beyond the other's"


@asks(
    "rims_apart",
    "Rims of faces in the only common planes that both scans show",
    "at least",
    "1",
    lambda e: (e.rims_shared, rims_limit(e)),
)
def rims_apart(evidence: Evidence) -> Iterator[str]:
    """The faces of both scans in the planes that they share end at different places."""
    yield f"{PLANES_END}places: {100 * evidence.rims_shared:.0f} % of the rims of one are rims of the other"


@asks(
    "rims_elsewhere",
    "Rims of those faces that both scans show after a slide, more than at the pose",
    "at most",
    "1",
    lambda e: (e.rims_elsewhere[0], RIM_GAIN_SHARE),
)
def rims_elsewhere(evidence: Evidence) -> Iterator[str]:
    """The faces of both scans in the planes that they share would end together at another place."""
    gained, slide = evidence.rims_elsewhere
    yield (
        "the scans have three planes in common at most, and their faces would end together elsewhere: after a "
        f"slide by {evidence.length(slide)} {100 * gained:.0f} % more of the rims of "
        "one are rims of the other; two sides of a thin wall may have been laid on each other"
    )


@asks(
    "opposed_edges",
    "Rims of both scans in one plane beside which the faces turn to opposite sides",
    "at most",
    "1",
    lambda e: (e.opposed_edges, OPPOSED_EDGE_SHARE),
)
def opposed_edges(evidence: Evidence) -> Iterator[str]:
    """Faces beside the rims that both scans show turn to opposite sides."""
    yield (
        f"beside {100 * evidence.opposed_edges:.0f} % of the rims that both scans show in one plane the faces turn "
        "to opposite sides: two sides of a wall may have been laid on each other"
    )


@asks(
    "closed_hole",
    "Diameter of a hole in one scan's face that the other's face closes, of the size",
    "at most",
    "1",
    lambda e: (in_sizes(e, e.closed_hole), CLOSED_HOLE_DIAGONALS),
)
def closed_hole(evidence: Evidence) -> Iterator[str]:
    """A hole in one scan is none in the other."""
    yield (
        f"a hole {evidence.length(evidence.closed_hole)} wide in a face of one scan is closed in the other, and "
        "nothing stands there: another part, or another face of it"
    )


@asks(
    "one_plane",
    "Places that both scans show in one plane",
    "at most",
    "1",
    lambda e: (e.largest_plane, ONE_PLANE_SHARE),
)
def one_plane(evidence: Evidence) -> Iterator[str]:
    """Both scans have one face in common, or that of a part shows one alone from a side that is not known."""
    if math.isnan(evidence.faces_apart) and evidence.search:
        yield (
            "the scan lies in one plane, which holds three motions, and nothing tells its sides: turned over, or on "
            "another face, its rims may fit as well: scan more of the sides, or give normals, a viewpoint or a start"
        )
    else:
        yield (
            f"{100 * evidence.largest_plane:.0f} % of what both scans show lie in one plane, in which other poses fit "
            "as well: scan more of the sides"
        )
