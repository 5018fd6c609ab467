"""Registrations with known answers for the tests of reports; small, so that each takes a fraction of a second."""

from __future__ import annotations

import functools

import numpy as np

from dqreg import Mesh, register
from dqreg.geometry import sample_mesh
from dqreg.registration.result.result import Registration
from dqreg.report.report_data import ReportData, collect
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket

NOISE = 0.05
# Height and place of the bump that `bumpy` adds, mm.
BUMP, AT = 0.8, np.array([90.0, 30.0])
T_TRUTH = twist.exp(np.array([0.05, -0.03, 0.04, 1.0, -2.0, 0.5]))
T_START = T_TRUTH @ twist.exp(np.array([0.06, 0.0, 0.03, 1.5, 0.0, 0.0]))


@functools.cache
def bumpy() -> Registration:
    """A bracket with a bump of 0.8 mm, noise of 0.05 mm, and 2 % strays; lengths in mm."""
    rng = np.random.default_rng(5)
    part = Mesh(*bracket())
    points = sample_mesh(part, 12_000, rng).points
    top = (np.abs(points[:, 2] - 10.0) < 1e-6) & (np.linalg.norm(points[:, :2] - AT, axis=1) < 9.0)
    points = points + rng.normal(0.0, NOISE, points.shape)
    points[top, 2] += BUMP
    strays = rng.uniform(-50.0, 170.0, (240, 3))
    source = pose.apply(pose.inverse(T_TRUTH), np.vstack([points, strays]))
    return register(source, part, T_START, target_units="mm")


@functools.cache
def failed() -> Registration:
    """A cloud a thousand sizes away from its target."""
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    return register(cloud, cloud + 1e4, "identity")


def data_of(result: Registration, tolerance: float | None = None) -> ReportData:
    assert result.inputs is not None
    return collect(result, result.inputs, tolerance, T_START)
