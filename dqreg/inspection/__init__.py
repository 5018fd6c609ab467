"""What a registered scan says of the part: signed deviations, their statistics and worst places, and their files."""

from __future__ import annotations

from dqreg.inspection.deviation_files import colours_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.measure import measure_deviations, why_unsigned
from dqreg.inspection.statistics import Band, Bands, Place, Summary

__all__ = ["Band", "Bands", "Deviations", "Place", "Summary", "colours_of", "measure_deviations", "why_unsigned"]
