"""From how far off two views of a part come together: dqreg without a verdict beside small_gicp's GICP.

    python examples/cloud_basins.py PART... [--pairs 100] [--seed 0] [--degrees 0.5 3]

Each pair is two scans of a part drawn among the files, from one place or from two, and from others beside these: what
they have in common, their noise (5e-5 to 2e-3 of the size) and their points (3,000 to 40,000) are drawn too. The truth
is exact. The initial pose is turned by an angle between the two, and shifted by 0.25 % of the size for each degree.
Right is what displaces no vertex of the part by more than 1 % of its size; a round part may be wrong by its free
rotation for all. GICP has to be told how far apart correspondences may be: it is asked with three shares of the size.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import dqreg
from dqreg.geometry.opening import as_geometry
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh, worst_vertex_displacement

# Worst displacement of a vertex that is right, in sizes; largest distances of GICP.
RIGHT, SHARES = 0.01, (0.03, 0.05, 0.1)
PIXELS, AWAY, SHIFT_PER_DEGREE = 250, 1.5, 0.0025


@dataclass(frozen=True)
class Pair:
    """Two views in one frame, so that the truth is the identity, and a pose to begin with."""

    part: dqreg.Mesh
    source: np.ndarray  # (n, 3)
    target: np.ndarray  # (m, 3)
    T_start: np.ndarray  # (4, 4)

    def error(self, T_target_source: np.ndarray) -> float:
        """Worst displacement of a vertex, in sizes; infinite where no pose was found."""
        if not np.isfinite(T_target_source).all():
            return np.inf
        return worst_vertex_displacement(T_target_source, np.eye(4), self.part.vertices) / self.part.diagonal


def drawn(parts: list[dqreg.Mesh], rng: np.random.Generator, degrees: tuple[float, float]) -> Pair:
    """Two views of one of the parts."""
    part = parts[rng.integers(len(parts))]
    noise, count = Noise(range_sigma=10 ** rng.uniform(-4.3, -2.7) * part.diagonal), int(rng.integers(3_000, 40_000))
    places, beside = rng.normal(size=(rng.integers(1, 3), 3)), rng.uniform(0.0, 0.6)
    places *= AWAY / np.linalg.norm(places, axis=1, keepdims=True)
    clouds = []
    for one in (places, places + beside * AWAY * rng.normal(size=places.shape)):
        scanner = Scanner([tuple(place) for place in one], pixels=PIXELS)
        clouds.append(rng.permutation(scan_mesh(part.vertices, part.faces, scanner, noise, rng=rng).points)[:count])
    angle = rng.uniform(*degrees)
    T_start = disturbance(rng, np.deg2rad(angle), SHIFT_PER_DEGREE * angle * part.diagonal, part.centre)
    return Pair(part, clouds[0], clouds[1], T_start)


def gicp(share: float) -> Callable[[Pair], np.ndarray]:
    """small_gicp's GICP with voxels as wide as the points are apart."""
    import small_gicp

    def run(pair: Pair) -> np.ndarray:
        spacing = float(np.median(cKDTree(pair.target).query(pair.target[:500], 2)[0][:, 1]))
        options = {"downsampling_resolution": spacing, "max_correspondence_distance": share * pair.part.diagonal}
        return small_gicp.align(
            pair.target, pair.source, pair.T_start, registration_type="GICP", **options
        ).T_target_source

    return run


def ours(pair: Pair, effort: str) -> np.ndarray:
    """Dqreg with no length given."""
    return dqreg.register(pair.source, pair.target, pair.T_start, effort=effort, verdict=False).T_target_source


def engines() -> dict[str, Callable[[Pair], np.ndarray]]:
    """Those that are installed."""
    found: dict[str, Callable[[Pair], np.ndarray]] = {
        f"dqreg, {effort}": lambda pair, effort=effort: ours(pair, effort) for effort in ("fast", "normal")
    }
    try:
        return found | {f"GICP, {100 * share:.0f} % of the size": gicp(share) for share in SHARES}
    except ImportError:
        return found


def pairs(parts: list[dqreg.Mesh], count: int, seed: int, degrees: tuple[float, float]) -> Iterator[Pair]:
    """So many pairs, each of a seed of its own."""
    for k in range(count):
        yield drawn(parts, np.random.default_rng([seed, k]), degrees)


def main(arguments: list[str] | None = None) -> dict[str, np.ndarray]:
    """Print how many are right, and their errors; returns all errors, in sizes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", type=Path, nargs="+")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--degrees", type=float, nargs=2, default=(0.5, 3.0))
    given = parser.parse_args(arguments)
    # The unit is that of the file: nothing here has a length of its own.
    parts = [part for part in (as_geometry(path, "m") for path in given.parts) if isinstance(part, dqreg.Mesh)]
    asked = engines()
    errors = np.array(
        [
            [pair.error(run(pair)) for run in asked.values()]
            for pair in pairs(parts, given.pairs, given.seed, tuple(given.degrees))
        ]
    )
    common = (errors < RIGHT).all(axis=1)
    print(f"{'':>24}{f'right of {given.pairs}':>16}{'median error where all are [1e-6 S]':>40}")
    for name, column in zip(asked, errors.T, strict=True):
        print(f"{name:>24}{np.count_nonzero(column < RIGHT):>16}{1e6 * np.median(column[common]):>40.0f}")
    return dict(zip(asked, errors.T, strict=True))


if __name__ == "__main__":
    main()
