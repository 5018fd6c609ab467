"""Alignments to chosen faces: answers by hand, other optimisers, locked motions and priors, chains."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh, MeshSurface, PointCloud, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import Deviations, FaceTerms, SurfaceAlignment, align_surface, measure_deviations
from dqreg.inspection.alignment.surface_rows import rows_of
from dqreg.registration.register import register
from dqreg.rigid import pose, twist
from dqreg.solvers import Freedom
from dqreg.synth.parts import box

# A block with its faces at known places; 0.1 degrees and some tenths off.
PART = Mesh(*box((30.0, 20.0, 10.0)))
SURFACE = MeshSurface(PART)
T_TRUE = twist.exp([1e-3, -1e-3, 1.5e-3, 0.1, -0.2, 0.15])


def number(side: tuple[float, float, float]) -> int:
    """Face whose normal points to a side."""
    return int(faces_of(PART)[1][int(np.argmax(PART.face_normals @ side))])


TOP, BOTTOM, RIGHT, LEFT = (number(n) for n in ((0, 0, 1.0), (0, 0, -1.0), (1.0, 0, 0), (-1.0, 0, 0)))


def grid(step: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Points on all faces in a grid, away from edges, and their normals."""
    points, normals = [], []
    half = np.array([15.0, 10.0, 5.0])
    for axis in range(3):
        u, v = [k for k in range(3) if k != axis]
        across = np.meshgrid(*(np.arange(-half[k] + 0.5 * step, half[k], step) for k in (u, v)), indexing="ij")
        for sign in (-1.0, 1.0):
            face = np.zeros((across[0].size, 3))
            face[:, u], face[:, v], face[:, axis] = across[0].ravel(), across[1].ravel(), sign * half[axis]
            points.append(face)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(face), 1)))
    return np.concatenate(points), np.concatenate(normals)


POINTS, NORMALS = grid()


def scanned(change: np.ndarray, T: np.ndarray = T_TRUE) -> Deviations:
    """The grid with an error along each normal, under the inverse of a pose, so that the pose puts it right."""
    points = pose.apply(pose.inverse(T), POINTS + change[:, None] * NORMALS)
    return measure_deviations(points, PART, SURFACE, reach=3.0)


def error_of(found: SurfaceAlignment, T: np.ndarray = T_TRUE) -> np.ndarray:
    return twist.log(pose.about(found.T_target_source @ pose.inverse(T), -found.centre))


def on(side: tuple[float, float, float]) -> np.ndarray:
    return np.asarray(NORMALS @ side > 0.5)


@pytest.mark.parametrize("goal", ["best-fit", "minimax"])
def test_exact_scans_give_the_pose_back(goal: str) -> None:
    found = align_surface(scanned(np.zeros(len(POINTS))), goal)  # type: ignore[arg-type]
    assert found.converged
    assert np.abs(error_of(found)).max() < 1e-12 * PART.diagonal
    assert found.largest < 1e-12 * PART.diagonal


def test_a_thick_part_is_shared_out_by_weights_by_hand() -> None:
    # Top and bottom have as many points: the shift is the weighted mean of 0.1 and 0; minimax halves it.
    scan = scanned(np.where(on((0, 0, 1.0)), 0.1, 0.0))
    for weight in (1.0, 3.0):
        faces = {k: FaceTerms(weight if k == TOP else 1.0) for k in range(6)}
        shift = error_of(align_surface(scan, faces=faces))[5]
        assert shift == pytest.approx(-0.1 * weight / (weight + 1.0), abs=1e-12)
    found = align_surface(scan, "minimax")
    assert found.largest == pytest.approx(0.05, abs=1e-12)
    # Bands decide where they are given: half-widths of 0.01 and 0.03 share 0.1 out as 1 to 3.
    bands = {TOP: FaceTerms(1.0, -0.01, 0.01), BOTTOM: FaceTerms(1.0, -0.03, 0.03)}
    bands |= {k: FaceTerms(1.0, -1.0, 1.0) for k in range(6) if k not in bands}
    assert error_of(align_surface(scan, "minimax", faces=bands))[5] == pytest.approx(-0.075, abs=1e-12)


def test_only_the_chosen_faces_count() -> None:
    # A wrong right side does not pull where it is not chosen.
    scan = scanned(np.where(on((1.0, 0, 0)), 0.3, 0.0))
    chosen = {k: FaceTerms() for k in range(6) if k != RIGHT}
    assert np.abs(error_of(align_surface(scan, faces=chosen))).max() < 1e-11
    assert np.abs(error_of(align_surface(scan))).max() > 0.1


def test_no_search_finds_a_smaller_largest_deviation() -> None:
    rng = np.random.default_rng(0)
    # 40 probed points: no medians.
    rows = rng.choice(len(POINTS), 40, replace=False)
    points = POINTS[rows] + 0.05 * rng.normal(size=(40, 1)) * NORMALS[rows]
    scan = measure_deviations(points, PART, SURFACE, reach=3.0)
    found = align_surface(scan, "minimax")
    rows_here = rows_of(scan, None)

    def largest(step: np.ndarray) -> float:
        T = pose.about(twist.exp(step / [10, 10, 10, 1, 1, 1]), rows_here.centre) @ found.T_target_source
        return rows_here.height(T)

    assert largest(np.zeros(6)) == pytest.approx(found.largest, abs=1e-12)
    for seed in range(3):
        start = 1e-3 * np.random.default_rng(seed).normal(size=6)
        other = minimize(largest, start, method="Nelder-Mead", options={"maxfev": 1500, "xatol": 1e-12, "fatol": 1e-14})
        assert other.fun >= found.largest - 1e-10


def test_a_tolerance_fit_leaves_out_what_no_pose_brings_in() -> None:
    rng = np.random.default_rng(1)
    change = 0.01 * rng.normal(size=len(POINTS))
    # Half of the top and a third of the right side are 0.4 high.
    change[on((0, 0, 1.0)) & (POINTS[:, 0] > 0.0)] += 0.4
    change[on((1.0, 0, 0)) & (POINTS[:, 1] > 3.0)] += 0.4
    scan, faces = scanned(change), {k: FaceTerms(1.0, -0.05, 0.05) for k in range(6)}
    found, least = align_surface(scan, "tolerance", faces=faces), align_surface(scan, faces=faces)
    assert found.share_within is not None
    assert least.share_within is not None
    good = np.abs(change) < 0.05
    # As many as without the faults, and the pose to a few times what the noise leaves.
    assert found.share_within >= good.mean() - 0.002
    assert least.share_within < 0.5
    assert np.abs(error_of(found)).max() < 0.005


def test_no_gouging_is_the_constrained_best_fit() -> None:
    rng = np.random.default_rng(2)
    # Stock of 0.2 to 0.5, in waves, on every face.
    change = 0.35 + 0.15 * np.sin(POINTS @ [0.3, 0.5, 0.7])
    scan = scanned(change, twist.exp([1e-4, 2e-4, -1e-4, 0.3, -0.3, 0.25]))
    found = align_surface(scan, "outside")
    rows = rows_of(scan, None)
    rows = rows.with_medians(np.eye(4))
    values, slopes = rows.deviations(found.T_target_source)
    assert values.min() > -1e-6
    cost = float(values @ values)
    for _ in range(3):
        step = 1e-4 * rng.normal(size=6)
        other = minimize(
            lambda x: float(np.sum((values + slopes @ x) ** 2)),
            step,
            jac=lambda x: 2.0 * slopes.T @ (values + slopes @ x),
            constraints={"type": "ineq", "fun": lambda x: values + slopes @ x, "jac": lambda x: slopes},
            method="SLSQP",
        )
        assert cost <= other.fun * (1.0 + 1e-6)
    # From inside there is no pose: the stock is everywhere.
    with pytest.raises(DegenerateGeometryError, match="whole scan inside of the part: at best a place lies 0\\."):
        align_surface(scan, "inside")


@pytest.mark.parametrize("goal", ["best-fit", "tolerance", "minimax", "outside"])
def test_locked_motions_keep_every_digit_and_priors_hold(goal: str) -> None:
    rng = np.random.default_rng(3)
    change = (0.3 if goal == "outside" else 0.0) + 0.01 * rng.normal(size=len(POINTS))
    scan = scanned(change)
    faces = {k: FaceTerms(1.0, -0.1 if goal != "outside" else 0.0, 0.5) for k in range(6)}
    found = align_surface(scan, goal, faces=faces, dof="tz rx")  # type: ignore[arg-type]
    motion = Freedom.parse("tz rx").coordinates(found.T_target_source, np.eye(4))
    assert np.abs(motion[[1, 2, 3, 4]]).max() < 1e-15
    assert abs(motion[5]) > 0.05
    # What is left along the others is rounding of float64: 2e-16 of the largest.
    assert np.linalg.matrix_rank(found.covariance, tol=1e-12 * np.abs(found.covariance).max()) == 2
    # A prior of 1e-6 holds the pose to some of its standard deviations against errors of 1e-3 and more.
    held = align_surface(scan, goal, faces=faces, prior=(np.eye(4), np.full(6, 1e-12)))  # type: ignore[arg-type]
    if goal != "outside":
        assert np.abs(twist.log(pose.about(held.T_target_source, -held.centre))).max() < 2e-4


def test_the_covariance_is_that_of_repeated_scans() -> None:
    squares = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        found = align_surface(scanned(0.02 * rng.normal(size=len(POINTS))))
        error = error_of(found)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # Six degrees of freedom: the mean of 40 scatters by sqrt(12 / 40) = 0.55.
    assert np.mean(squares) == pytest.approx(6.0, abs=2.0)


@pytest.mark.parametrize(("step", "waves", "least"), [(2.0, 0.0, 4.0), (2.0, 0.06, 0.7), (1.0, 0.06, 0.2)])
def test_few_points_and_form_do_not_make_the_pose_uncertain(step: float, waves: float, least: float) -> None:
    # The form of faces that were scanned is a part of what is measured: the best fit to it is the same in each scan.
    points, normals = grid(step)
    form, squares = waves * np.sin(points @ [0.3, 0.5, 0.7]), []
    truth = align_surface(measure_deviations(points + form[:, None] * normals, PART, SURFACE, reach=3.0))
    for seed in range(24):
        noise = 0.02 * np.random.default_rng(seed).normal(size=len(points))
        found = align_surface(measure_deviations(points + (form + noise)[:, None] * normals, PART, SURFACE, reach=3.0))
        error = error_of(found, truth.T_target_source)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # Six degrees of freedom, 24 runs; a share of what neighbours have in common stays for the scanner.
    assert least < np.mean(squares) < 8.0


def test_the_form_of_half_faces_counts_by_what_they_leave_open() -> None:
    half = POINTS[POINTS[:, 0] < 0.0]
    rows = rows_of(measure_deviations(half, PART, SURFACE, reach=3.0), {TOP: FaceTerms()})
    # Points cover two spacings more. Half a beam has half of what holds its tilt about the middle, and little where
    # the height is open as well.
    seen = 0.5 + 2.0 / 30.0
    assert rows.scanned(np.eye(6)[:, [5]]) == pytest.approx(seen, abs=0.02)
    assert rows.scanned(np.eye(6)[:, [1]]) == pytest.approx(0.5 * (1.0 + (4.0 / 30.0) ** 3), abs=0.03)
    assert rows.scanned(np.eye(6)[:, [1, 5]]) < 0.25
    assert rows_of(measure_deviations(POINTS, PART, SURFACE, reach=3.0), None).scanned(np.eye(6)) > 0.999


def test_the_covariance_of_the_smallest_largest_deviation_is_that_of_repeated_scans() -> None:
    # 40 probed points of noise alone; only the height is free: the answer is the middle of the extremes, by hand.
    rng = np.random.default_rng(5)
    sides = np.flatnonzero(on((0, 0, 1.0)))
    rows = rng.choice(sides, 40, replace=False)
    middles, stated = [], []
    for seed in range(200):
        noise = 0.02 * np.random.default_rng(seed).normal(size=40)
        middles.append(0.5 * (noise.max() + noise.min()))
        if seed < 4:
            scan = measure_deviations(POINTS[rows] + noise[:, None] * NORMALS[rows], PART, SURFACE, reach=3.0)
            found = align_surface(scan, "minimax", faces={TOP: FaceTerms()}, dof="tz")
            assert found.T_target_source[2, 3] == pytest.approx(-middles[-1], abs=1e-12)
            stated.append(found.covariance[5, 5])
    # The noise of four times 40 points is known to a fifth at worst, 60 draws add a tenth.
    assert 0.75 < np.sqrt(np.mean(stated)) / np.std(middles) < 1.6


@pytest.mark.soak
@pytest.mark.parametrize("waves", [0.0, 0.03])
def test_the_covariance_of_minimax_covers_repeated_scans(waves: float) -> None:
    surface, squares = waves * np.sin(POINTS @ [0.3, 0.5, 0.7]), []
    exact = error_of(align_surface(scanned(surface), "minimax"))
    for seed in range(40):
        noise = 0.02 * np.random.default_rng(seed).normal(size=len(POINTS))
        found = align_surface(scanned(surface + noise), "minimax")
        error = error_of(found) - exact
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # Never too small; up to twice as wide where waves make the farthest places certain.
    assert 0.8 < np.mean(squares) < 7.5


def test_steps_of_a_chain_are_named_and_multiply() -> None:
    cloud = sample_mesh(PART, 3_000, np.random.default_rng(4))
    first = register(PointCloud(pose.apply(pose.inverse(T_TRUE), cloud.points)), PART, "identity", effort="fast")
    second = first.aligned(align_surface(first.deviations()), "all faces")
    step = align_surface(second.deviations(), "minimax", dof="tz")
    third = second.aligned(step, "height by minimax")
    assert [entry["name"] for entry in third.settings["alignments"]] == ["all faces", "height by minimax"]
    np.testing.assert_allclose(third.T_target_source, step.T_target_source @ second.T_target_source, atol=1e-15)
    # Motions that the second step locked are as uncertain as after the first.
    assert third.covariance[3, 3] == pytest.approx(second.covariance[3, 3], rel=1e-6)
    assert third.verdict.level == second.verdict.level
    assert pose.angle_between(third.T_target_source, T_TRUE) < 1e-6
    with pytest.raises(InputError, match="needs a name"):
        first.aligned(step, " ")


def test_what_cannot_be_asked_is_named() -> None:
    scan = scanned(np.zeros(len(POINTS)))
    with pytest.raises(InputError, match="did you mean minimax"):
        align_surface(scan, "minmax")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the part has no face 9; its faces are 0 to 5"):
        align_surface(scan, faces={9: FaceTerms()})
    with pytest.raises(InputError, match="needs a band for each"):
        align_surface(scan, "tolerance")
    with pytest.raises(DegenerateGeometryError, match="the chosen faces leave"):
        align_surface(scan, faces={TOP: FaceTerms()})
    with pytest.raises(InputError, match="weight of a face must be above 0"):
        FaceTerms(0.0)
    with pytest.raises(InputError, match="low below high"):
        FaceTerms(1.0, 1.0, -1.0)
    cut = measure_deviations(POINTS[on((0, 0, 1.0))], PART, SURFACE, reach=3.0)
    with pytest.raises(DegenerateGeometryError, match="0 points lie on the chosen faces"):
        align_surface(cut, faces={LEFT: FaceTerms()})
    with pytest.raises(InputError, match="prior must be"):
        align_surface(scan, prior=3)  # type: ignore[arg-type]
