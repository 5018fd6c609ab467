"""Measured scenes from nothing, their points rounded to another last digit twenty times: one answer.

References are those of the data sets, see their notes: no truths.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg._arrays import FloatArray
from dqreg.geometry.opening import as_geometry
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose

pytestmark = [pytest.mark.real, pytest.mark.soak]

# Metres: 1.5e-5 mm, about the last digit of a float at a metre.
STEP, ROUNDINGS = 1.5e-8, 20
KITCHEN, MILK, WELD = "redkitchen_fragments", "pcl_milk_scene", "weld_tee_scan_cad"
TABLE = "table_8in10in_tee_x4y24_45"


def rounded(points: FloatArray, seed: int) -> FloatArray:
    """Points on a grid of steps, which lies differently for each seed."""
    offset = np.random.default_rng(seed).uniform(0.0, STEP, 3)
    found: FloatArray = np.round((points + offset) / STEP) * STEP - offset
    return found


def bench(folder: Path) -> tuple[FloatArray, object, FloatArray]:
    """A steel T on a weld table, to its mesh; the scan cropped to half a metre around the part."""
    scan = as_geometry(folder / WELD / f"{TABLE}.pcd", "scan").points
    inside = ((scan > (0.0, -0.9, -0.01)) & (scan < (0.5, -0.4, 0.23))).all(axis=1)
    reference = pose.inverse(np.loadtxt(folder / WELD / f"T_scan_part_fit_{TABLE}.txt"))
    return scan[inside], as_geometry(folder / WELD / "tee_nominal.stl", "part"), reference


def milk(folder: Path) -> tuple[FloatArray, object, FloatArray]:
    """A carton's view, to a cluttered scene that it is in."""
    scene = as_geometry(folder / MILK / "milk_cartoon_all_small_clorox.pcd", "scene")
    scan = as_geometry(folder / MILK / "milk.pcd", "scan").points
    return scan, scene, np.loadtxt(folder / MILK / "T_scene_milk.txt")


def kitchen(source: int, target: int) -> Callable[[Path], tuple[FloatArray, object, FloatArray]]:
    """Fragments of a room, to each other."""

    def read(folder: Path) -> tuple[FloatArray, object, FloatArray]:
        sides = [as_geometry(folder / KITCHEN / f"cloud_bin_{n}.ply", str(n)) for n in (source, target)]
        return sides[0].points, sides[1], np.loadtxt(folder / KITCHEN / f"T_{target}_{source}.txt")

    return read


SCENES = {"weld": bench, "milk": milk, "kitchen 1 on 0": kitchen(1, 0), "kitchen 4 on 1": kitchen(4, 1)}


@pytest.mark.parametrize("name", SCENES)
def test_the_last_digit_of_the_points_does_not_decide_the_answer(real_data: Path, name: str) -> None:
    scan, target, reference = SCENES[name](real_data)
    size = float(np.linalg.norm(np.ptp(scan, axis=0)))
    finite = scan[np.isfinite(scan).all(axis=1)]
    results: list[Registration] = []
    for seed in range(ROUNDINGS):
        result = dqreg.register(rounded(finite, seed), target, effort="fast")
        results.append(result)
        away = pose.offset_between(result.T_target_source, reference, at=finite.mean(axis=0)) / size
        turned = np.rad2deg(pose.angle_between(result.T_target_source, reference))
        words = f"{turned:.3f} degrees, {away:.2e} of the size; {', '.join(result.verdict.codes)}"
        sys.stdout.write(f"{name} {seed}: {result.verdict.level} {words}\n")
        sys.stdout.flush()
    # A five hundredth of the size is far below any other pose that nearly fits.
    first = results[0].T_target_source
    apart = [
        np.linalg.norm(pose.apply(one.T_target_source, finite) - pose.apply(first, finite), axis=1) for one in results
    ]
    assert np.max(apart) < 2e-3 * size
    assert len({result.verdict.level for result in results}) == 1
