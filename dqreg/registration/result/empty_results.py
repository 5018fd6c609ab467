"""Results of which nothing was measured: no loop was run, or none of its poses is one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import Status
from dqreg.registration.result.result import Registration
from dqreg.trust.records import Reason, Verdict


def unmeasured(
    T_target_source: FloatArray, verdict: Verdict, status: Status, variance: float, settings: Mapping[str, Any]
) -> Registration:
    """The result of a pose that was laid down, or of none: no distance, no share and no motion is known."""
    return Registration(
        T_target_source=T_target_source,
        verdict=verdict,
        status=status,
        covariance=np.full((6, 6), variance),
        observability=(),
        alternatives=(),
        history=(),
        rms=np.nan,
        inlier_fraction=np.nan,
        timings={},
        settings=dict(settings),
    )


def without_pose(reasons: tuple[Reason, ...], status: Status, settings: Mapping[str, Any]) -> Registration:
    """The result where there is no pose, and why."""
    return unmeasured(np.full((4, 4), np.nan), Verdict("failed", reasons), status, np.nan, settings)
