"""From a frame's run to its answer: pose, covariance, what holds it, verdict."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg.odometry.align import Aligned
from dqreg.odometry.frame import Keypoints
from dqreg.odometry.kiss import rigid
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.trust import held_by
from dqreg.odometry.verdicts import FrameEvidence, frame_verdict, without_pose
from dqreg.registration.result import Registration
from dqreg.trust import observe_directions
from dqreg.trust.records import Reason


def frame_result(
    aligned: Aligned,
    surface: MapSurface,
    keys: Keypoints,
    usual: float,
    notes: tuple[Reason, ...],
    words: dict[str, Any],
) -> Registration:
    """The answer for one frame."""
    run, mixture = aligned.run, aligned.mixture
    held = held_by(run, surface, keys.reach) if aligned.found else None
    directions = observe_directions(held.information) if held else ()
    evidence = FrameEvidence(
        run.status, aligned.found, float(run.weights.sum()), aligned.on_map, usual, mixture.scale, directions
    )
    verdict = frame_verdict(evidence, notes)
    if held is None or verdict.level == "failed":
        return without_pose(verdict.reasons, run.status, words)
    T, distances = rigid(run.T_target_source), run.pairs.distances
    return Registration(
        T_target_source=T,
        verdict=verdict,
        status=run.status,
        covariance=held.covariance,
        observability=directions,
        alternatives=(),
        history=run.history,
        rms=float(np.sqrt(run.weights @ distances**2 / run.weights.sum())),
        inlier_fraction=aligned.on_map,
        timings={},
        settings={**words, "centre": T[:3, 3].tolist(), "width": mixture.scale},
    )
