"""What a registered scan says of the part: signed deviations, worst places, whether it is within tolerance, files."""

from __future__ import annotations

from dqreg.inspection.alignment import (
    Datum,
    DatumAlignment,
    FaceTerms,
    PointAlignment,
    SurfaceAlignment,
    align_datums,
    align_points,
    align_surface,
)
from dqreg.inspection.decision.coverage import FaceCoverage
from dqreg.inspection.decision.decision import Decision, decide
from dqreg.inspection.decision.places import OutOfTolerance
from dqreg.inspection.decision.regions import Region
from dqreg.inspection.deviations.deviations import Deviations
from dqreg.inspection.deviations.files import colours_of
from dqreg.inspection.deviations.measure import measure_deviations
from dqreg.inspection.deviations.outward_side import why_unsigned
from dqreg.inspection.features import EdgePoint, Feature, Torus, fit_feature
from dqreg.inspection.membership.membership import Counts
from dqreg.inspection.part_faces import Face, faces_in_box, nearest_face, part_faces
from dqreg.inspection.plan.file import Plan, read_plan
from dqreg.inspection.plan.report import PlannedReport
from dqreg.inspection.scanned_part.edge_points import edge_point
from dqreg.inspection.scanned_part.sections import Section, section_of
from dqreg.inspection.scanned_part.thickness import Thickness, thickness_of
from dqreg.inspection.sheet.aligned_part import AlignedStep
from dqreg.inspection.sheet.run import Inspection, inspect
from dqreg.inspection.sheet.sheet_rows import Characteristic
from dqreg.inspection.statistics import Band, Bands, Place, Summary
from dqreg.inspection.tolerances import Tolerance

__all__ = [
    "AlignedStep",
    "Band",
    "Bands",
    "Characteristic",
    "Counts",
    "Datum",
    "DatumAlignment",
    "Decision",
    "Deviations",
    "EdgePoint",
    "Face",
    "FaceCoverage",
    "FaceTerms",
    "Feature",
    "Inspection",
    "OutOfTolerance",
    "Place",
    "Plan",
    "PlannedReport",
    "PointAlignment",
    "Region",
    "Section",
    "Summary",
    "SurfaceAlignment",
    "Thickness",
    "Tolerance",
    "Torus",
    "align_datums",
    "align_points",
    "align_surface",
    "colours_of",
    "decide",
    "edge_point",
    "faces_in_box",
    "fit_feature",
    "inspect",
    "measure_deviations",
    "nearest_face",
    "part_faces",
    "read_plan",
    "section_of",
    "thickness_of",
    "why_unsigned",
]
