from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp.correspondences import Correspondences, find_correspondences
from dqreg.icp.estimators import points_to_planes
from dqreg.icp.noise_by_face import MIN_VARIANCE_RATIO, points_to_weighted_faces, relative_precisions
from dqreg.rigid import pose
from dqreg.synth.parts import box

FACES = np.vstack([np.eye(3), -np.eye(3)])


def factors_of(normals: np.ndarray, distances: np.ndarray, weights: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Weights over the variance of points at some distances from their planes."""
    return relative_precisions(distances**2, normals, weights, faces)


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(0.3, 1.0), min_size=6, max_size=6), st.integers(0, 1000), st.sampled_from([1e-6, 1.0, 1e6]))
def test_each_face_weighs_by_one_over_its_variance(sigmas: list[float], seed: int, unit: float) -> None:
    faces = np.repeat(np.arange(6), 2_000)
    noise = unit * np.random.default_rng(seed).normal(size=len(faces)) * np.array(sigmas)[faces]
    factors = factors_of(FACES[faces], noise, np.ones(len(faces)), faces)
    found, expected = factors[::2_000], 1.0 / np.square(sigmas)
    # A variance of 2,000 is good to 3 %; eight values beforehand take off at most 4 % more.
    np.testing.assert_allclose(found / found[0], expected / expected[0], rtol=0.25)
    assert abs(factors.mean() - 1.0) < 1e-12


def test_outliers_and_nan_without_weight_say_nothing() -> None:
    faces, weights = np.repeat(np.arange(6), 100), np.ones(600)
    noise = np.random.default_rng(0).normal(size=600)
    plain = factors_of(FACES[faces], noise, weights, faces)
    columns = np.vstack([FACES[faces], np.zeros((2, 3))]), np.r_[noise, np.nan, 1e150], np.r_[weights, 0.0, 0.0]
    more = factors_of(*columns, np.r_[faces, 0, 0])
    np.testing.assert_allclose(more[:600], plain, rtol=1e-12)


def test_exact_data_weighs_alike_and_lucky_faces_have_a_limit() -> None:
    faces = np.repeat(np.arange(6), 1_000)
    np.testing.assert_array_equal(factors_of(FACES[faces], np.zeros(6_000), np.ones(6_000), faces), np.ones(6_000))
    noise = np.where(faces > 0, np.random.default_rng(0).normal(size=6_000), 0.0)
    factors = factors_of(FACES[faces], noise, np.ones(6_000), faces)
    assert factors.max() / factors.min() <= 1.5 / MIN_VARIANCE_RATIO


def pairs_of(points: np.ndarray, part: Mesh) -> Correspondences:
    return find_correspondences(prepare_scan(PointCloud(points), 200), MeshSurface(part), np.eye(4))


def test_faces_that_scatter_less_place_the_part_better() -> None:
    # The truth is the identity. Opposite faces of a box scatter by 1 and by 0.1: the bound for a shift between them is
    # 0.1 / sqrt(n), an even fit reaches half of 1 / sqrt(n).
    part = Mesh(*box((3.0, 2.0, 1.0)))
    rng = np.random.default_rng(0)
    errors: dict[str, list[float]] = {"weighed": [], "alike": []}
    for _ in range(12):
        samples = sample_mesh(part, 4_000, rng)
        slant = np.where(samples.normals.sum(axis=1) > 0.0, 1.0, 0.1)
        points = samples.points + (1e-3 * slant * rng.normal(size=4_000))[:, None] * samples.normals
        pairs = pairs_of(points, part)
        weights = np.ones(len(pairs.distances))
        for name, estimator in (("weighed", points_to_weighted_faces), ("alike", points_to_planes)):
            T = estimator(pairs, weights, 1e-3).T_target_source
            errors[name].append(float(np.linalg.norm(pose.apply(T, part.vertices) - part.vertices)))
    assert np.sqrt(np.mean(np.square(errors["weighed"]))) < 0.4 * np.sqrt(np.mean(np.square(errors["alike"])))
