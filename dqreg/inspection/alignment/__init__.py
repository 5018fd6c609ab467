"""Alignments of a registered scan: datum reference frames, reference points, chosen faces of the part."""

from __future__ import annotations

from dqreg.inspection.alignment.datums import Datum, DatumAlignment, align_datums
from dqreg.inspection.alignment.points import PointAlignment, align_points
from dqreg.inspection.alignment.surface_fit import SurfaceAlignment, align_surface
from dqreg.inspection.alignment.surface_rows import FaceTerms

__all__ = [
    "Datum",
    "DatumAlignment",
    "FaceTerms",
    "PointAlignment",
    "SurfaceAlignment",
    "align_datums",
    "align_points",
    "align_surface",
]
