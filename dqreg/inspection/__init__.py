"""What a registered scan says of the part: signed deviations, worst places, whether it is within tolerance, files."""

from __future__ import annotations

from dqreg.inspection.alignment import Datum, DatumAlignment, PointAlignment, align_datums, align_points
from dqreg.inspection.decision import Decision, OutOfTolerance, decide
from dqreg.inspection.deviation_files import colours_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.features import Feature, fit_feature
from dqreg.inspection.measure import measure_deviations, why_unsigned
from dqreg.inspection.membership import Counts
from dqreg.inspection.part_faces import Face, nearest_face, part_faces
from dqreg.inspection.regions import Region
from dqreg.inspection.statistics import Band, Bands, Place, Summary

__all__ = [
    "Band",
    "Bands",
    "Counts",
    "Datum",
    "DatumAlignment",
    "Decision",
    "Deviations",
    "Face",
    "Feature",
    "OutOfTolerance",
    "Place",
    "PointAlignment",
    "Region",
    "Summary",
    "align_datums",
    "align_points",
    "colours_of",
    "decide",
    "fit_feature",
    "measure_deviations",
    "nearest_face",
    "part_faces",
    "why_unsigned",
]
