"""What a registered scan says of the part: signed deviations, worst places, whether it is within tolerance, files."""

from __future__ import annotations

from dqreg.inspection.aligned_part import AlignedStep
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
from dqreg.inspection.coverage import FaceCoverage
from dqreg.inspection.decision import Decision, decide
from dqreg.inspection.deviation_files import colours_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.edge_points import edge_point
from dqreg.inspection.features import EdgePoint, Feature, Torus, fit_feature
from dqreg.inspection.measure import measure_deviations
from dqreg.inspection.membership import Counts
from dqreg.inspection.outward_side import why_unsigned
from dqreg.inspection.part_faces import Face, faces_in_box, nearest_face, part_faces
from dqreg.inspection.places import OutOfTolerance
from dqreg.inspection.plan.file import Plan, read_plan
from dqreg.inspection.plan.report import PlannedReport
from dqreg.inspection.plan.run import Inspection, inspect
from dqreg.inspection.plan.sheet_rows import Characteristic
from dqreg.inspection.regions import Region
from dqreg.inspection.sections import Section, section_of
from dqreg.inspection.statistics import Band, Bands, Place, Summary
from dqreg.inspection.thickness import Thickness, thickness_of
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
