"""Whether an answer may be trusted: covariance, what the matches hold, and the verdict with its reasons."""

from __future__ import annotations

from dqreg.trust.covariance import Information, covariance_of, information_of
from dqreg.trust.observability import observe_directions
from dqreg.trust.verdict import Evidence, judge

__all__ = ["Evidence", "Information", "covariance_of", "information_of", "judge", "observe_directions"]
