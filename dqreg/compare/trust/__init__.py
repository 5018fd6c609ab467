"""The trust sweep: how often the verdict accepts a wrong pose, and how often a right one.

- `dqreg.compare.trust.shapes`, `periodic`, `scans`: random parts and scans of them.
- `good`, `chance`, `misfit`, `rivals`, `starts`, `clouds`, `drives`: the kinds of task; `kinds` lists them.
- `trial`: one task carried out and judged; `sweep`: all of them; `rates`, `output`: the results.
"""

from __future__ import annotations

from dqreg.compare.trust.rates import Rate, rates
from dqreg.compare.trust.sweep import TrustProgress, TrustSweep, trust_sweep
from dqreg.compare.trust.trial import Trial

__all__ = ["Rate", "Trial", "TrustProgress", "TrustSweep", "rates", "trust_sweep"]
