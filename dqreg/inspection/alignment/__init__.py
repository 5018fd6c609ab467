"""Alignments other than best fit: datum reference frames and reference points."""

from __future__ import annotations

from dqreg.inspection.alignment.datums import Datum, DatumAlignment, align_datums
from dqreg.inspection.alignment.points import PointAlignment, align_points

__all__ = ["Datum", "DatumAlignment", "PointAlignment", "align_datums", "align_points"]
