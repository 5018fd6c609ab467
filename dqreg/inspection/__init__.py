"""What a registered scan says of the part: signed deviations, worst places, whether it is within tolerance, files."""

from __future__ import annotations

from dqreg.inspection.decision import Decision, OutOfTolerance, decide
from dqreg.inspection.deviation_files import colours_of
from dqreg.inspection.deviations import Deviations
from dqreg.inspection.features import Feature, fit_feature
from dqreg.inspection.measure import measure_deviations, why_unsigned
from dqreg.inspection.membership import Counts
from dqreg.inspection.regions import Region
from dqreg.inspection.statistics import Band, Bands, Place, Summary

__all__ = [
    "Band",
    "Bands",
    "Counts",
    "Decision",
    "Deviations",
    "Feature",
    "OutOfTolerance",
    "Place",
    "Region",
    "Summary",
    "colours_of",
    "decide",
    "fit_feature",
    "measure_deviations",
    "why_unsigned",
]
