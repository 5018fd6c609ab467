"""Deviations of a registered scan: what a result knows of its two sides, handed to the measurement."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.inspection import Deviations, measure_deviations
from dqreg.inspection.deviations.facing_sides import Facing
from dqreg.registration.evidence.evidence import near_limit
from dqreg.registration.options.option_checks import require_flag
from dqreg.registration.problem.problem import SourceAndTarget
from dqreg.rigid import pose


def scan_deviations(
    inputs: SourceAndTarget | None,
    T_target_source: FloatArray,
    covariance: FloatArray,
    settings: dict[str, Any],
    *,
    reach: float | None,
    keep: bool,
    **options: Any,
) -> Deviations:
    """Deviations of all points of the scan under a pose; see `Registration.deviations`."""
    require_flag("keep", keep)
    if inputs is None:
        raise InputError(
            "this result does not hold its two sides (it was loaded, or made with keep_inputs=False); "
            "call result.attached(source, target).deviations()"
        )
    target = inputs.target
    found = measure_deviations(
        inputs.placed(T_target_source),
        target.geometry,
        target.surface,
        origin=target.origin,
        reach=reach,
        # A result of old has the largest distance of a correspondence alone.
        limit=settings.get("reach", near_limit(settings["max_distance"])),
        units=settings.get("target_units"),
        spacing=settings.get("source_spacing"),
        noise=None if keep else settings.get("source_noise"),
        covariance=covariance,
        centre=np.array(settings.get("centre", target.origin)),
        copy=False,
        facing=_facing(inputs, T_target_source),
        **options,
    )
    return dataclasses.replace(found, scale_solved=True) if settings.get("scale_solved") else found


def _facing(inputs: SourceAndTarget, T_target_source: FloatArray) -> Facing | None:
    """Which way the scan looks: by normals that have a side, or by the place that its file says it was seen from."""
    cloud = inputs.source.cloud
    if cloud.normals is not None:
        return Facing.by_normals(cloud.normals, T_target_source[:3, :3])
    if cloud.viewpoint is not None:
        return Facing.by_sight(pose.apply(inputs.to_centred(T_target_source), cloud.viewpoint[None])[0])
    return None
