"""What speaks against a pose by the shapes of scan and target: strains, and what two scans have in common."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dqreg.solvers.motion_words import direction_words
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import (
    CLOSED_HOLE_DIAGONALS,
    FACES_APART_SHARE,
    ONE_PLANE_SHARE,
    OPPOSED_EDGE_SHARE,
    RIM_GAIN_SHARE,
    ends_limit,
    looked_through_limit,
    rims_limit,
    wavy_limit,
)


def looked_through(evidence: Evidence) -> Iterator[str]:
    """Things stand where a scanner looked through."""
    if evidence.looked_through > looked_through_limit(evidence):
        yield (
            f"{100 * evidence.looked_through:.0f} % of the points compared stand where a scanner looked through: a "
            "wrong pose, a wrong viewpoint, or things that moved between the scans"
        )


def faces_apart(evidence: Evidence) -> Iterator[str]:
    """Places that both scans show lie apart."""
    if evidence.faces_apart > FACES_APART_SHARE:
        yield (
            f"{100 * evidence.faces_apart:.0f} % of the places that both scans show lie apart by more than their noise "
            "and 0.2 % of the size: a wrong pose, or things that moved or differ between the scans"
        )


def ends_apart(evidence: Evidence) -> Iterator[str]:
    """Each scan's faces reach beyond the other's."""
    if evidence.ends_apart > ends_limit(evidence):
        yield (
            "the scans have a few planes in common at most, which fit many corners, and their faces end at different "
            f"places: {100 * evidence.ends_apart:.0f} % of each and more lie beyond the other's"
        )


def rims_apart(evidence: Evidence) -> Iterator[str]:
    """The faces of both scans in the planes that they share end at different places."""
    if evidence.rims_shared < rims_limit(evidence):
        yield (
            "the scans have a few planes in common at most, which fit many corners, and their faces end at different "
            f"places: {100 * evidence.rims_shared:.0f} % of the rims of one are rims of the other"
        )


def rims_elsewhere(evidence: Evidence) -> Iterator[str]:
    """The faces of both scans in the planes that they share would end together at another place."""
    gained, slide = evidence.rims_elsewhere
    if gained > RIM_GAIN_SHARE:
        yield (
            "the scans have three planes in common at most, and their faces would end together elsewhere: after a "
            f"slide by {evidence.length(slide)} {100 * gained:.0f} % more of the rims of "
            "one are rims of the other; two sides of a thin wall may have been laid on each other"
        )


def opposed_edges(evidence: Evidence) -> Iterator[str]:
    """Faces beside the rims that both scans show turn to opposite sides."""
    if evidence.opposed_edges > OPPOSED_EDGE_SHARE:
        yield (
            f"beside {100 * evidence.opposed_edges:.0f} % of the rims that both scans show in one plane the faces turn "
            "to opposite sides: two sides of a wall may have been laid on each other"
        )


def closed_hole(evidence: Evidence) -> Iterator[str]:
    """A hole in one scan is none in the other."""
    if evidence.closed_hole > CLOSED_HOLE_DIAGONALS * evidence.size:
        yield (
            f"a hole {evidence.length(evidence.closed_hole)} wide in a face of one scan is closed in the other, and "
            "nothing stands there: another part, or another face of it"
        )


def one_plane(evidence: Evidence) -> Iterator[str]:
    """Both scans have one face in common, or that of a part shows one alone from a side that is not known."""
    if evidence.largest_plane > ONE_PLANE_SHARE and math.isnan(evidence.faces_apart) and evidence.search:
        yield (
            "the scan lies in one plane, which holds three motions, and nothing tells its sides: turned over, or on "
            "another face, its rims may fit as well: scan more of the sides, or give normals, a viewpoint or a start"
        )
    elif evidence.largest_plane > ONE_PLANE_SHARE:
        yield (
            f"{100 * evidence.largest_plane:.0f} % of what both scans show lie in one plane, in which other poses fit "
            "as well: scan more of the sides"
        )


def deformed(evidence: Evidence) -> Iterator[str]:
    """A smooth deformation explains what no motion does."""
    if evidence.deformation:
        yield (
            f"a deformation displaces the surface of the scan by {evidence.length(evidence.deformation)} "
            f"({100 * evidence.deformation / evidence.size:.2g} % of the size, root mean square), which no motion "
            "explains: stretched, bent or distorted, other parts, or moved during a scan"
        )


def stretched(evidence: Evidence) -> Iterator[str]:
    """The scan is longer or shorter than the target."""
    if not evidence.stretch:
        return
    along = evidence.stretched_along if any(evidence.stretched_along) else None
    how = ("short", "long")[evidence.stretch > 0.0] if along else ("small", "large")[evidence.stretch > 0.0]
    words = f"{100 * abs(evidence.stretch):.2g} % too {how}" + (f" along {direction_words(along)}" if along else "")
    scaled = 'a part that shrank or a scaled file (scale="solve" or --scale solve estimates it), another part'
    cause = "another part" if along else scaled
    yield f"the scan is {words}: {cause}, or a local minimum"


def bent(evidence: Evidence) -> Iterator[str]:
    """The scan is bent or twisted against the target."""
    if evidence.bend:
        yield f"the scan is bent or twisted by {100 * evidence.bend:.2g} % of its length against the target"


def wavy(evidence: Evidence) -> Iterator[str]:
    """Neighbouring residuals have much in common."""
    if evidence.waviness > wavy_limit(evidence) * evidence.size:
        yield (
            f"neighbouring points deviate together, by {evidence.length(evidence.waviness)} "
            f"({100 * evidence.waviness / evidence.size:.2g} % of the size, one sigma): waves or dents all over, as "
            "of a scanner that shakes, another shape, or a wrong pose"
        )


def drift(evidence: Evidence) -> Iterator[str]:
    """The pose drifts along the scan."""
    if evidence.drift:
        along = f" along {direction_words(evidence.drift_along)}" if any(evidence.drift_along) else ""
        # Of two exposures no direction is known.
        lacks = "it shows a face that the open target lacks, or " if evidence.has_border and not along else ""
        yield (
            f"the pose drifts by {evidence.length(evidence.drift)}{along} and "
            f"{math.degrees(evidence.drift_rad):.2g} degrees within the scan: {lacks}part or scanner moved "
            "during it or between two exposures, or its views do not fit"
        )
