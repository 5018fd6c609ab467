"""Registration to what the scanner could see: hidden faces of a part do not attract."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.registration.fit import Fit
from dqreg.registration.target_index import TargetIndex

# Runs at most: each starts with what can be seen at the pose of the last one.
RUNS = 3
# Scale of the kernel to start with, in scales at the end of the last run and in sizes of the part: the hidden faces may
# have held the pose off by the thickness of a wall.
WIDER, WIDEST = 3.0, 0.01


def on_visible_faces(fit: Fit, viewpoints: FloatArray) -> Fit:
    """Register again, to the faces that can be seen at the pose found, until those stay the same.

    Shapes: viewpoints (k, 3), in the caller's source frame.
    """
    for _ in range(RUNS):
        if not fit.found or fit.problem.watch.is_over or fit.run.status == "stopped by observer":
            break
        target = fit.problem.visible_from(viewpoints, fit.T_target_source)
        if _same_faces(target, fit.target):
            break
        kernel_scale = max(WIDER * fit.run.mixture.scale, WIDEST * target.surface.diagonal)
        fit = fit.resumed(
            fit.T_target_source,
            None if fit.settings.fine is None else kernel_scale,
            prepared=dataclasses.replace(fit.prepared, surface=target.surface),
            target=target,
        )
    return fit


def _same_faces(one: TargetIndex, other: TargetIndex) -> bool:
    if one.visible is None or other.visible is None:
        return one.visible is other.visible
    return np.array_equal(one.visible, other.visible)
