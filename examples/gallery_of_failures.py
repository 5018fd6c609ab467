"""What goes wrong in practice, what dqreg says of it, and what to do.

Each case is a virtual scan of a part. Where the pose cannot be known, the verdict has to say so.

python examples/gallery_of_failures.py              # prints the gallery
python examples/gallery_of_failures.py pictures/    # with a picture of each
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, scan_mesh
from dqreg.synth.parts import box, bracket, cylinder

VIEWS = [(1.0, 1.0, 1.0), (-1.0, 0.3, -0.8)]
BRACKET, BLOCK, SHAFT = (
    dqreg.Mesh(*shape) for shape in (bracket(), box((90.0, 60.0, 30.0)), cylinder(diameter=20.0, height=80.0))
)


# Middle of the block's upper face.
TOP = np.array([0.0, 0.0, 15.0])


@dataclasses.dataclass(frozen=True)
class Failure:
    """A scan that something is wrong with, and what to do about it."""

    name: str
    scan: np.ndarray
    part: dqreg.Mesh
    start: Any
    remedy: str


def scanned(part: dqreg.Mesh, rng: np.random.Generator) -> np.ndarray:
    scanner, noise = Scanner(VIEWS, pixels=120), Noise(range_sigma=3e-4 * part.diagonal)
    return scan_mesh(part.vertices, part.faces, scanner, noise, rng=rng).points


def off(points: np.ndarray, degrees: float, share: float, rng: np.random.Generator) -> np.ndarray:
    """The points turned by an angle about their middle and shifted by a share of their size."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return pose.apply(disturbance(rng, np.deg2rad(degrees), share * size, points.mean(axis=0)), points)


def gallery(seed: int = 0) -> Iterator[Failure]:
    rng = np.random.default_rng(seed)
    whole = scanned(BRACKET, rng)
    patch = np.column_stack([rng.uniform(-15.0, 15.0, (6_000, 2)), rng.normal(0.0, 0.02, 6_000)]) + TOP
    yield Failure("plane only", off(patch, 2.0, 0.01, rng), BLOCK, "identity", "scan more sides, or lock what the "
                  'plane leaves free: dof="rx ry tz"')  # fmt: skip
    sides = sample_mesh(SHAFT, 20_000, rng)
    sides = sides.points[np.abs(sides.normals[:, 2]) < 0.5] + rng.normal(0.0, 0.02, (1, 3))
    yield Failure("round part", off(sides, 2.0, 0.01, rng), SHAFT, "identity", "scan an end, or a feature that is not "
                  "round")  # fmt: skip
    yield Failure("wrong part", off(whole, 5.0, 0.02, rng), BLOCK, "identity", "check the part number")
    yield Failure("wrong units", off(whole, 5.0, 0.02, rng) / 25.4, BRACKET, "identity", 'name the unit: source_units='
                  '"inch", target_units="mm"')  # fmt: skip
    yield Failure("start too far off", off(whole, 150.0, 0.1, rng), BRACKET, "identity", "nothing: a second try found "
                  "the pose; start=None finds it at once")  # fmt: skip
    yield Failure("symmetric part", off(scanned(BLOCK, rng), 60.0, 0.3, rng), BLOCK, None, "any of the alternatives "
                  "will do, or choose by a feature")  # fmt: skip


def main(folder: Path | None = None) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Level (or the error) and codes of each case."""
    answers: dict[str, tuple[str, tuple[str, ...]]] = {}
    for case in gallery():
        try:
            result = dqreg.register(case.scan, case.part, case.start, effort="fast")
        except dqreg.DqregError as error:
            level, codes, reasons = type(error).__name__, (), (str(error),)
        else:
            level, codes, reasons = result.verdict.level, result.verdict.codes, result.verdict.reasons
            if folder is not None:
                picture(result, folder / f"failure_{case.name.replace(' ', '_')}.png")
        answers[case.name] = level, codes
        print(f"{case.name}: {level}", *reasons, f"what to do: {case.remedy}", sep="\n  ")
    return answers


def picture(result: dqreg.Registration, path: Path) -> None:
    from dqreg.report.pictures import parse_panels, save_picture
    from dqreg.report.report_data import collect

    if result.verdict.level != "failed":
        save_picture(collect(result, result.inputs, None, None), path, parse_panels("best"))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else None)
