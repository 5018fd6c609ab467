"""How sure the pose is: covariance, observability, evidence, and the verdict with its reasons."""

from __future__ import annotations

from dqreg.errors import moved_name
from dqreg.trust.covariance import covariance_of, observe_directions, without_free_motion
from dqreg.trust.evidence import Evidence
from dqreg.trust.information import Information, information_of
from dqreg.trust.verdict import judge

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


def __getattr__(name: str) -> object:
    # Deviations have moved to a room above.
    return moved_name(__name__, name)
