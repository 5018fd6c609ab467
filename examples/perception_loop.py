"""A part that moves before a sensor: prepared once, registered frame after frame, with a covariance for the filter.

The first frame is found from nothing; each later one starts at the last pose. A frame that is not accepted is found
from nothing again instead of being believed.

python examples/perception_loop.py
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import dqreg
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement
from dqreg.synth.parts import bracket


def frames(count: int, seed: int = 0) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points of each frame in the sensor's frame, and the truth, which a robot would not have."""
    rng = np.random.default_rng(seed)
    vertices, faces = bracket()
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    T_part_sensor = random_pose(rng, size, vertices.mean(axis=0))
    scanner = Scanner([(1.0, 1.0, 1.0), (-1.0, 0.3, 0.6)], pixels=120)
    for _ in range(count):
        T_part_sensor = pose.exp(rng.normal(0.0, 1.0, 6) * ([0.02] * 3 + [0.004 * size] * 3)) @ T_part_sensor
        on_part = scan_mesh(vertices, faces, scanner, Noise(range_sigma=3e-4 * size), rng=rng).points
        yield pose.apply(pose.inverse(T_part_sensor), on_part), T_part_sensor


def main(count: int = 10) -> list[float]:
    part = dqreg.Mesh(*bracket())
    target = dqreg.prepare_target(part)  # trees and tables: once, and safe to share between threads
    options = {"effort": "fast", "keep_inputs": False}  # and time_limit=0.1, where a late answer is worth nothing
    T_last, errors = None, []
    for number, (points, T_truth) in enumerate(frames(count)):
        began = time.perf_counter()
        result = target.register(points, T_last, **options)
        if result.verdict.level != "accepted" and T_last is not None:
            result = target.register(points, None, **options)
        milliseconds = 1e3 * (time.perf_counter() - began)
        T_last = result.T_target_source if result.verdict.level == "accepted" else None

        # Rotation vector first, then translation, about the middle of the part; radians and the part's unit.
        sigmas = np.sqrt(np.diag(result.covariance))
        errors.append(worst_vertex_displacement(result.T_target_source, T_truth, part.vertices))
        print(
            f"frame {number}: {result.verdict.level}, {len(points)} points, {milliseconds:.0f} ms, sigmas "
            f"up to {np.rad2deg(sigmas[:3].max()):.1e} degrees and {sigmas[3:].max():.1e} mm, truly off by "
            f"{errors[-1]:.1e} mm"
        )
    return errors


if __name__ == "__main__":
    main()
