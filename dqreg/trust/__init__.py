"""Whether an answer may be trusted: covariance, what the matches hold, deviations, and the verdict with its reasons."""

from __future__ import annotations

from dqreg.trust.covariance import Information, covariance_of, information_of
from dqreg.trust.deviation import measure_deviations, why_unsigned
from dqreg.trust.deviation_bands import Band, Bands, Summary
from dqreg.trust.deviation_colours import colours_of
from dqreg.trust.deviation_places import Place
from dqreg.trust.deviation_record import Deviations
from dqreg.trust.free_motions import without_free_motion
from dqreg.trust.observability import observe_directions
from dqreg.trust.verdict import Evidence, judge

__all__ = [
    "Band",
    "Bands",
    "Deviations",
    "Evidence",
    "Information",
    "Place",
    "Summary",
    "colours_of",
    "covariance_of",
    "information_of",
    "judge",
    "measure_deviations",
    "observe_directions",
    "why_unsigned",
    "without_free_motion",
]
