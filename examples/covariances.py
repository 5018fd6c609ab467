"""How honest the covariance is: the normalised squared error over many scans, which should be six on average.

Each seed is a new scan of the same part with a known pose. Independent noise on each point first; then noise that
neighbours share, which a covariance learned from one scan sees for the better part, not in full.

    python examples/covariances.py                          # the bracket, 30 seeds
    python examples/covariances.py part.stl --seeds 200 --noise independent
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

import dqreg
from dqreg.files import read_mesh
from dqreg.rigid import pose, twist
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh
from dqreg.synth.parts import bracket

VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
NOISE = 3e-4
# Points that share one value of the noise.
NOISES = {"independent": 1, "shared by 20": 20, "shared by 500": 500}


def squared_errors(mesh: tuple, seeds: int, effort: str, pixels: int, patch: int = 1) -> np.ndarray:
    """Squared error of the pose in units of its covariance, one a seed; six unknowns make six on average."""
    vertices, faces = mesh
    part = dqreg.Mesh(vertices, faces)
    target, size = dqreg.prepare_target(part), part.diagonal
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        sigma = NOISE * size if patch == 1 else 0.0
        scan = scan_mesh(vertices, faces, Scanner(VIEWS, pixels=pixels), Noise(range_sigma=sigma), rng=rng).points
        if patch > 1:
            scan = scan + shared_noise(scan, NOISE * size, patch, rng)
        T = disturbance(rng, np.deg2rad(8.0), 0.03 * size, part.centre)
        result = target.register(pose.apply(pose.inverse(T), scan), "identity", effort=effort, keep_inputs=False)
        centre = pose.from_parts(np.eye(3), result.settings["centre"])
        error = twist.log(pose.inverse(centre) @ T @ pose.inverse(result.T_target_source) @ centre)
        found.append(error @ np.linalg.solve(result.covariance, error))
    return np.array(found)


def shared_noise(points: np.ndarray, sigma: float, patch: int, rng: np.random.Generator) -> np.ndarray:
    """Noise that the points of a cube of space share, about ``patch`` of them; along one direction for all."""
    side = np.sqrt(patch / len(points)) * np.linalg.norm(np.ptp(points, axis=0))
    cells, place = np.unique(np.floor(points / side).astype(int), axis=0, return_inverse=True)
    return rng.normal(0.0, sigma, (len(cells), 3))[place.ravel()]


def main(
    paths: list[str], seeds: int = 30, effort: str = "fast", pixels: int = 300, noises: tuple[str, ...] = tuple(NOISES)
) -> dict[tuple[str, str], float]:
    parts = {Path(p).stem: (read_mesh(p).vertices, read_mesh(p).faces) for p in paths} or {"bracket": bracket()}
    table = Table("part", "noise", "mean (6)", "median (5.3)", "within 90 % (0.90)", box=None)
    means = {}
    for name, mesh in parts.items():
        for noise in noises:
            errors = squared_errors(mesh, seeds, effort, pixels, NOISES[noise])
            means[name, noise] = float(errors.mean())
            inside = float(np.mean(errors <= chi2.ppf(0.9, 6)))
            table.add_row(name, noise, f"{errors.mean():.2f}", f"{np.median(errors):.2f}", f"{inside:.2f}")
    Console().print(table)
    return means


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--effort", default="fast")
    parser.add_argument("--noise", action="append", choices=NOISES, help="one kind only; may be given again")
    arguments = parser.parse_args()
    main(arguments.parts, arguments.seeds, arguments.effort, noises=tuple(arguments.noise or NOISES))
