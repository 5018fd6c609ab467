"""How sure the pose is: covariance, observability, evidence, and the verdict with its reasons.

Deviations live in `dqreg.inspection`; their names stay reachable here.
"""

from __future__ import annotations

import sys

from dqreg.trust.covariance import covariance_of, observe_directions, without_free_motion
from dqreg.trust.evidence import Evidence
from dqreg.trust.information import Information, information_of
from dqreg.trust.verdict import judge

# Names that moved to `dqreg.inspection`, a layer above: the root package finds them, no file here imports it.
_MOVED = ("Band", "Bands", "Deviations", "Place", "Summary", "colours_of", "measure_deviations", "why_unsigned")

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
    if name in _MOVED:
        return getattr(sys.modules["dqreg"].inspection, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
