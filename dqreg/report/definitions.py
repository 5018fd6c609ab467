"""What each kind of characteristic is, in one line: a figure on a sheet is defined on it."""

from __future__ import annotations

from dqreg.inspection import Inspection

# What zones of position and orientation hold (ISO 1101).
HELD = (
    "the surface of a flat face (medians of neighbouring points, and the fitted plane to its rim), or the fitted axis "
    "of another from end to end"
)
# Of each kind of a plan.
DEFINITIONS = {
    "diameter": "of the circle, cylinder or sphere that is fitted to the points of the face (least squares, unless "
    "another fit is named).",
    "distance": "of two fitted features: of planes along the bisector of their normals, in the middle of both faces of "
    "the part (of which the smaller counts the more); of others along the normal of a plane, or across the axes.",
    "angle": "between the normals or axes of two fitted features, 0 to 90 degrees; its supplement where more than 90 "
    "are nominal.",
    "form": "flatness, cylindricity or what else the face's shape gives: width of the least zone about medians of "
    "neighbouring points of the whole face.",
    "roundness": "least distance of two circles of one centre that hold a section of the face between them; sections "
    "lie across the axis, the worst counts; medians of neighbouring points of each section.",
    "straightness": "least distance of two parallel lines that hold a line of the face between them, the worst line "
    "counts; of an axis, the diameter of the least cylinder that holds the centres of its sections.",
    "parallelism": f"width of the zone parallel to the datum that holds {HELD}.",
    "perpendicularity": f"width of the zone square to the datum that holds {HELD}.",
    "angularity": f"width of the zone at the part's own angle to the datum that holds {HELD}.",
    "position": f"diameter, or width, of the zone about the nominal place that holds {HELD}, or a sphere's centre; "
    "under the alignment above.",
    "coaxiality": "diameter of the least cylinder about the datum's axis that holds the fitted axis from end to end.",
    "circular-runout": "travel of a dial square to the face in one turn about the datum's fitted axis, in the worst of "
    "the sections; medians of neighbouring points of each.",
    "total-runout": "travel of a dial square to the nominal face over all of it, about the datum's fitted axis; "
    "medians of neighbouring points.",
    "profile": "twice the largest distance of medians of neighbouring points from the middle of the zone about the "
    "nominal face, under the alignment above.",
    "line-profile": "twice the largest distance of the outline of a section from the middle of the zone about the "
    "nominal one, under the alignment above; medians of neighbouring points along the section.",
    "thickness": "of the wall behind the face, where it differs most from the part's own.",
    "width": "of the fitted slot, across its flat sides.",
    "length": "of the fitted slot, over its round ends.",
    "slot-position": "diameter of the zone about the nominal axis of the slot's middle that holds the fitted one from "
    "end to end, under the alignment above.",
    "edge-point": "how far the edge lies beyond the nominal one there, along the face.",
}


# Of each rule of a fit that is not least squares.
FITS = {
    "minimum-zone": "the fitted feature has the least form error, of medians of neighbouring points.",
    "inscribed": "the largest that the surface leaves room for, by medians of neighbouring points without their noise.",
    "circumscribed": "the least that holds the surface, by medians of neighbouring points without their noise.",
}


def definitions_of(found: Inspection) -> list[tuple[str, str]]:
    """Definitions of the kinds and fits on a sheet, each once, in their order on it."""
    kinds = dict.fromkeys(row.kind for row in found.characteristics)
    fits = dict.fromkeys([*(row.fit for row in found.characteristics), *(datum.fit for datum in found.plan.datums)])
    # What was refused beside the characteristics is of no kind that is measured.
    return [
        (word, known[word]) for words, known in ((kinds, DEFINITIONS), (fits, FITS)) for word in words if word in known
    ]
