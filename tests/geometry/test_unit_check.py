from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dqreg.errors import UnitsError
from dqreg.files.units import factor
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.unit_check import find_unit_mistake, principal_spreads, require_same_units
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, scan_mesh
from dqreg.synth.parts import bracket

FACTORS = [2.54, 1.0 / 0.3048, 10.0, 12.0, 25.4, 30.48, 1.0 / 0.0254, 304.8, 1000.0]
RNG = np.random.default_rng(0)


@cache
def part() -> Mesh:
    mesh = Mesh(*bracket())
    return Mesh(mesh.vertices - mesh.centre, mesh.faces)


@cache
def scan(count: int = 8000) -> PointCloud:
    """Points all over the part, with noise, turned: what a scan from many sides looks like."""
    rng = np.random.default_rng(1)
    points = sample_mesh(part(), count, rng).points + rng.normal(scale=2e-4 * part().diagonal, size=(count, 3))
    return PointCloud(pose.apply(pose.random(rng, reach=50.0), points))


def times(geometry: PointCloud | Mesh, k: float) -> PointCloud | Mesh:
    if isinstance(geometry, Mesh):
        return Mesh(k * geometry.vertices, geometry.faces)
    return PointCloud(k * geometry.points)


@pytest.mark.parametrize("target", ["mesh", "cloud"])
@pytest.mark.parametrize("smaller", [False, True])
@pytest.mark.parametrize("k", FACTORS)
def test_every_likely_mistake_is_named_with_the_option_that_mends_it(k: float, smaller: bool, target: str) -> None:
    other = part() if target == "mesh" else sample_mesh(part(), 8000, np.random.default_rng(2))
    moved = times(scan(), 1.0 / k if smaller else k)
    mistake = find_unit_mistake(moved, other)
    assert mistake is not None
    assert mistake.factor == pytest.approx(1.0 / k if smaller else k)
    # Named as it says, the sizes agree.
    mended = factor(mistake.source_units, mistake.target_units) * mistake.ratio
    assert mended == pytest.approx(1.0, abs=0.05)
    with pytest.raises(UnitsError, match=f'source_units="{mistake.source_units}".*--target-units.*units="ignore"'):
        require_same_units(moved, other)


@pytest.mark.parametrize("strays", [0.0, 0.03])
def test_strays_do_not_hide_a_mistake_nor_make_one(strays: float) -> None:
    count = int(strays * len(scan()))
    wild = np.random.default_rng(3).normal(scale=1e3 * part().diagonal, size=(count, 3))
    dirty = PointCloud(np.vstack([scan().points, wild]))
    assert find_unit_mistake(dirty, part()) is None
    assert find_unit_mistake(times(dirty, 25.4), part()) is not None


@pytest.mark.parametrize("share", [1.0, 0.5, 0.15, 0.05, 0.01])
def test_patches_of_a_part_are_no_mistake(share: float) -> None:
    points = scan(40_000).points
    for row in range(0, 40_000, 8_000):
        away = np.linalg.norm(points - points[row], axis=1)
        patch = PointCloud(points[away <= np.quantile(away, share)])
        for target in (part(), scan()):
            assert find_unit_mistake(patch, target) is None
            assert find_unit_mistake(target, patch) is None


@pytest.mark.parametrize("size", [2.0, 5.0, 9.0, 14.0, 24.0, 60.0])
def test_a_part_in_a_scene_is_no_mistake(size: float) -> None:
    # A floor, a wall and the part; between two clouds the spacing tells, whatever the shape.
    rng, extent = np.random.default_rng(4), size * part().diagonal
    floor = np.column_stack([rng.uniform(-1, 1, (20_000, 2)), np.zeros(20_000)]) * extent / 2
    wall = floor[:8_000, [0, 2, 1]] * [1.0, 1.0, 0.4] + [0.0, extent / 2, 0.2 * extent]
    scene = PointCloud(np.vstack([floor, wall, scan().points]))
    for target in (part(), scan()):
        assert find_unit_mistake(scene, target) is None
        assert find_unit_mistake(target, scene) is None


def test_the_spacing_clears_two_clouds_of_one_shape() -> None:
    # A model ten times as large with the same spacing: not a change of unit, which would scale the spacing as well.
    rng = np.random.default_rng(5)
    small, large = sample_mesh(part(), 400, rng), times(sample_mesh(part(), 40_000, rng), 10.0)
    assert find_unit_mistake(large, small) is None


def test_known_units_are_believed() -> None:
    moved = times(scan(), 1000.0)
    assert find_unit_mistake(moved, part(), "mm", "m") is None
    assert find_unit_mistake(moved, part(), "mm", "mm") is None
    known = find_unit_mistake(moved, part(), target_units="mm")
    assert known is not None
    assert (known.source_units, known.target_units) == ("um", "mm")
    inch = find_unit_mistake(times(scan(), 25.4), part(), source_units="m")
    assert inch is None  # there is no unit of which 25.4 go into a metre
    # Nor one of which a thousand do: the metres of a depth image in mm were a guess.
    guessed = find_unit_mistake(moved, part(), source_units="m")
    assert guessed is not None
    assert (guessed.source_units, guessed.target_units) == ("mm", "m")


@pytest.mark.parametrize("units", [("m", "mm"), ("inch", "mm"), ("mm", "m")])
def test_units_that_are_named_wrong_are_told_by_the_sizes(units: tuple[str, str]) -> None:
    # Scan and part are in one unit, and the scan is said to be in another: it was multiplied by that.
    converted = times(scan(), factor(*units))
    with pytest.raises(UnitsError, match=f"--source-units {units[1]} --target-units {units[1]};.*--units ignore"):
        require_same_units(converted, part(), *units)
    # As it was meant: the numbers differ by the factor, and after the conversion the sizes agree.
    require_same_units(scan(), part(), *units)
    # A patch of the part, or a scene about it, has other sizes whatever the units.
    patch = PointCloud(scan().points[np.linalg.norm(scan().points - scan().points[0], axis=1) < 15.0])
    require_same_units(patch, part(), *units)


def test_spreads_do_not_depend_on_the_pose_and_scale_with_the_numbers() -> None:
    turned = PointCloud(pose.apply(pose.random(np.random.default_rng(6), reach=1e4), scan().points))
    np.testing.assert_allclose(principal_spreads(turned), principal_spreads(scan()), rtol=1e-2)
    np.testing.assert_allclose(principal_spreads(times(scan(), 7.0)), 7.0 * principal_spreads(scan()), rtol=1e-9)


def test_points_on_a_line_or_in_one_place_are_for_others_to_refuse() -> None:
    line = PointCloud(np.arange(30.0)[:, None] * [1.0, 0.0, 0.0])
    assert find_unit_mistake(line, times(line, 10.0)) is None
    assert find_unit_mistake(PointCloud(np.ones((5, 3))), part()) is None


# Directions from which a part is seen: its shape is known to 18 %, not to 5 %.
SEEN = ((0.0, 0.0, 1.0), (1.0, 0.5, 1.0), (-1.0, -1.0, 0.6))


@pytest.mark.parametrize("smaller", [False, True])
@pytest.mark.parametrize(("coarse", "fine"), [("ft", "inch"), ("ft", "cm"), ("m", "inch")])
def test_units_that_are_seldom_confused_are_told_of_a_scan_from_some_sides(
    coarse: str, fine: str, smaller: bool
) -> None:
    points = scan_mesh(
        *bracket(), Scanner(views=SEEN, pixels=80), Noise(range_sigma=0.03), rng=np.random.default_rng(0)
    ).points
    k = factor(coarse, fine)
    moved = PointCloud(points / k if smaller else points * k)
    mistake = find_unit_mistake(moved, part())
    assert mistake is not None
    assert (mistake.source_units, mistake.target_units) == ((coarse, fine) if smaller else (fine, coarse))
    known = find_unit_mistake(moved, part(), target_units=fine if smaller else coarse)
    assert known is not None
    assert known.source_units == mistake.source_units


def test_a_dense_scene_of_the_proportions_of_its_part_is_no_mistake() -> None:
    # Twelve times as large and as thick, but of so many points that the part amid it is a scan of its own.
    scene = scan_mesh(
        *bracket(), Scanner(views=SEEN[:2], pixels=200), Noise(range_sigma=0.03), rng=np.random.default_rng(0)
    )
    assert find_unit_mistake(PointCloud(12.0 * scene.points), part()) is None
