from __future__ import annotations

import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from dqreg._arrays import (
    MAX_ROTATION_GAP,
    RIGID_TOLERANCE,
    as_float,
    as_pose,
    as_vectors,
    as_weights,
    departure,
    median,
    product,
    quantile,
    require_finite,
)
from dqreg.errors import InputError

ANY = hnp.arrays(np.float64, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
ANGLES = st.floats(-4.0, 4.0)
SHIFTS = hnp.arrays(np.float64, 3, elements=st.floats(-1e6, 1e6))


def test_a_mask_is_no_cloud() -> None:
    with pytest.raises(InputError, match=r"scan must be an array of real numbers; got ndarray \(NumPy type bool"):
        as_vectors(np.ones((5, 3), dtype=bool), "scan")


@settings(deadline=None)
@given(ANY)
def test_float_arrays_pass_unchanged(array: np.ndarray) -> None:
    result = as_float(array, "it")
    np.testing.assert_array_equal(result, array)
    assert result.shape == array.shape
    assert result.dtype == np.float64
    assert result.flags.c_contiguous


def test_what_is_right_already_is_not_copied() -> None:
    array = np.zeros((4, 3))
    assert np.shares_memory(as_float(array, "it"), array)
    assert np.shares_memory(as_vectors(array, "it"), array)


@pytest.mark.parametrize(
    "value",
    [[[1, 2, 3]], ((1, 2, 3),), np.array([[1, 2, 3]], dtype=np.int8), np.array([[1, 2, 3]], dtype=">f4")],
)
def test_anything_numeric_becomes_float64_rows(value: Any) -> None:
    rows = as_vectors(value, "it")
    assert rows.tolist() == [[1.0, 2.0, 3.0]]
    assert rows.dtype == np.float64


def test_strided_input_becomes_contiguous() -> None:
    array = np.arange(12.0).reshape(3, 4).T[:, ::-1]
    assert as_vectors(array, "it").flags.c_contiguous
    np.testing.assert_array_equal(as_vectors(array, "it"), array)


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        ("abc", "str"),
        (None, "NoneType"),
        ([[1, 2], [3]], "list"),
        (np.array([1j]), "ndarray"),
        (object(), "object"),
        ([["1", "2", "3"]], "list"),
        ([[1, 2, None]], "list"),
        (np.array(["2020-01-01"], dtype="M8[D]"), "ndarray"),
        ([10**400], "list"),
    ],
)
def test_what_is_no_array_of_numbers_is_named(value: Any, kind: str) -> None:
    with pytest.raises(InputError, match=f"^points must be an array of real numbers; got {kind} "):
        as_float(value, "points")


@pytest.mark.parametrize("shape", [(3,), (2, 2), (2, 4), (1, 2, 3), (), (0,)])
def test_other_shapes_are_named(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"^scan must have shape \(n, 3\), .*; got shape \("):
        as_vectors(np.zeros(shape), "scan")


def test_no_rows_are_rows() -> None:
    assert as_vectors(np.zeros((0, 3)), "it").shape == (0, 3)


@settings(deadline=None)
@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 5), st.just(3)), elements=st.floats()))
def test_finite_is_decided_number_by_number(rows: np.ndarray) -> None:
    bad = ~np.isfinite(rows)
    if not bad.any():
        as_vectors(rows, "it")
        return
    first = tuple(int(k) for k in np.argwhere(bad)[0])
    with pytest.raises(InputError) as caught:
        as_vectors(rows, "it")
    assert str(caught.value) == f"it holds {bad.sum()} numbers that are NaN or infinite, the first at {first}"
    np.testing.assert_array_equal(as_vectors(rows, "it", finite=False), rows)


@pytest.mark.parametrize("array", [[1.7e308, 1.7e308], [-1.7e308, -1.7e308], []])
def test_a_sum_beyond_float64_is_no_infinity(array: list[float]) -> None:
    require_finite(np.array(array), "it")  # the sum overflows, the numbers do not: no error
    with pytest.raises(InputError, match="1 numbers"):
        require_finite(np.array([*array, np.inf]), "it")


def test_infinities_that_cancel_are_found() -> None:
    with pytest.raises(InputError, match=r"it holds 2 numbers .* the first at \(1,\)"):
        require_finite(np.array([0.0, np.inf, -np.inf]), "it")


def test_one_weight_serves_all() -> None:
    assert as_weights(2, "weights", 3).tolist() == [2.0, 2.0, 2.0]
    assert as_weights([0, 1, 2], "weights", 3).tolist() == [0.0, 1.0, 2.0]
    assert as_weights([], "weights", 0).shape == (0,)
    assert as_weights(1.0, "weights", 0).shape == (0,)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([1, 2], r"one number or 3 numbers, one per item; got shape \(2,\)"),
        ([[1, 2, 3]], r"got shape \(1, 3\)"),
        ([1, 1, -0.5], "must not be negative; the smallest is -0.5. Use 0"),
        (-1, "the smallest is -1"),
        ([1, np.nan, 1], "1 numbers that are NaN"),
        (np.inf, "3 numbers that are NaN or infinite"),
        (["a", "b", "c"], "must be an array of real numbers"),
    ],
)
def test_bad_weights_are_named(value: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^weights .*{message}"):
        as_weights(value, "weights", 3)


@settings(deadline=None)
@given(hnp.arrays(np.float64, 3, elements=ANGLES), SHIFTS, st.floats(0.0, 1e-6))
def test_a_pose_becomes_exactly_rigid(turn: np.ndarray, shift: np.ndarray, rounding: float) -> None:
    R = Rotation.from_rotvec(turn).as_matrix()
    T = np.eye(4)
    T[:3, :3] = R + rounding * np.array([[1, -1, 1], [0, 1, -1], [1, 0, -1]])
    T[:3, 3] = shift
    given_pose = T.copy()
    pose = as_pose(T, "start")
    np.testing.assert_array_equal(T, given_pose)
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), rtol=0, atol=1e-14)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(pose[:3, 3], shift)
    assert pose[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    # The nearest rotation is no further off than the one that was disturbed: the gap at most doubles.
    assert np.linalg.norm(pose[:3, :3] - R) <= 2 * np.linalg.norm(T[:3, :3] - R) + 1e-14


def test_seven_digits_of_a_text_file_are_enough() -> None:
    T = np.eye(4)
    T[:3, :3] = np.round(Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), 7)
    # Seven digits are off by 5e-8 each; the nearest rotation is at most twice as far from them as the true one is.
    np.testing.assert_allclose(as_pose(T, "start"), T, atol=9 * 1e-7)


def test_two_digits_of_a_tutorial_are_enough() -> None:
    """The nearest rotation minimises the Frobenius norm, so no other one, SciPy's of the same numbers, is nearer."""
    R = np.array([[0.862, 0.011, -0.507], [-0.139, 0.967, -0.215], [0.487, 0.255, 0.835]])
    T = pose(R=R, t=[0.5, 0.7, -1.4])
    found = as_pose(T, "start")
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-14)
    assert departure(T, found) <= np.linalg.norm(Rotation.from_matrix(R).as_matrix() - R) + 1e-15
    assert 1e-4 < departure(T, found) < 1e-3  # three digits
    assert departure(found, found) == 0.0
    np.testing.assert_array_equal(as_pose(T[:3], "start"), found)
    with pytest.raises(InputError, match="allowed 1e-05"):
        as_pose(T, "T_target_source", RIGID_TOLERANCE)


def pose(**parts: Any) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = parts.get("R", T[:3, :3])
    T[3] = parts.get("last", T[3])
    T[:3, 3] = parts.get("t", T[:3, 3])
    return T


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (
            np.eye(3),
            r"a 4x4 matrix, or its first three rows \(3x4\); got shape \(3, 3\); .*pose\.from_parts\(R, \[0, 0, 0\]\)$",
        ),
        (np.eye(5), r"\(3x4\); got shape \(5, 5\)$"),
        (np.ones((2, 3, 4)), r"got shape \(2, 3, 4\)$"),
        (pose(t=[1, np.nan, 0]), r"1 numbers that are NaN or infinite, the first at \(1, 3\)"),
        (pose(t=[1, 2, 3]).T, "the last row 0 0 0 1; got .* Was it transposed"),
        (pose(last=[0, 0, 0, 2]), r"the last row 0 0 0 1; got .*2\.0\]$"),
        (pose(R=np.diag([1, 1, -1])), "a mirror image .determinant -1"),
        (pose(R=2 * np.eye(3)), "not rigid: .* Remove any scale"),
        (pose(R=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "not rigid"),
        (pose(R=(1 + MAX_ROTATION_GAP) * np.eye(3)), "not rigid: .* by 0.0201"),
        (pose(R=np.zeros((3, 3))), "not rigid"),
        (pose(R=1e200 * np.eye(3)), "not rigid"),
        # Without fused multiply-add the overflow leaves NaN here, which no comparison finds too large.
        (pose(R=1e200 * np.array([[1, 1, 0], [-1, 1, 0], [0, 0, 1]])), "not rigid"),
        ("identity", "must be an array of real numbers; got str"),
    ],
)
def test_a_pose_that_is_not_rigid_is_named(value: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^start .*{message}"):
        as_pose(value, "start")


@pytest.mark.parametrize("word", ["T_target_source", "transformation"])
def test_a_result_is_its_pose(word: str) -> None:
    """Of dqreg and small_gicp, and of Open3D."""
    T = pose(R=Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), t=[1, 2, 3])
    result = types.SimpleNamespace(**{word: T})
    np.testing.assert_array_equal(as_pose(result, "start"), as_pose(T, "start"))
    assert departure(result, T) == 0.0


@pytest.mark.parametrize(
    ("shape", "remedy"),
    [((3, 50), "array.T"), ((50, 4), "array[:, :3]"), ((3, 4), "array[:, :3]"), ((5, 6, 3), "array.reshape(-1, 3)")],
)
def test_rows_of_another_shape_are_told_what_to_do(shape: tuple[int, ...], remedy: str) -> None:
    with pytest.raises(InputError) as error:
        as_vectors(np.zeros(shape), "points")
    assert str(error.value).endswith(remedy)


def test_importing_arrays_loads_nothing_heavy() -> None:
    code = "import sys, dqreg._arrays; sys.exit(any(name in sys.modules for name in ('open3d', 'scipy', 'trimesh')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.floats(0.0, 1.0))
def test_median_and_quantile_are_those_of_numpy_to_the_last_bit(values: list[float], share: float) -> None:
    array = np.array(values)
    assert median(array) == np.median(array)
    assert quantile(array, share) == np.quantile(array, share)


def test_nothing_has_no_median_and_no_quantile() -> None:
    assert np.isnan(median(np.zeros(0)))
    assert np.isnan(quantile(np.zeros(0), 0.3))


@pytest.mark.parametrize(
    ("m", "k", "n"), [(40_000, 3, 3), (6, 6, 40_000), (6, 60_000, 6), (1_000, 3, 1_000), (0, 3, 3)]
)
def test_a_product_in_pieces_is_the_product(m: int, k: int, n: int) -> None:
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(m, k)), rng.normal(size=(k, n))
    # The rounding of k sums.
    np.testing.assert_allclose(product(left, right), left @ right, rtol=0.0, atol=1e-13 * np.sqrt(k) * 10)


THREADS_OF_BLAS = """
import glob, os, time
import numpy as np
from dqreg._arrays import dot, product
spent = lambda: sum(int(open(name).read().split()[0]) for name in others)
mine = f"/proc/self/task/{os.getpid()}/schedstat"
others = [name for name in glob.glob("/proc/self/task/*/schedstat") if name != mine]
rng = np.random.default_rng(0)
rounds = []
for _ in range(4):
    time.sleep(0.05)
    before = spent()
    for m, k, n in ((200_000, 3, 3), (6, 6, 200_000), (6, 200_000, 6), (6, 500, 500), (1_000, 3, 1_000)):
        product(rng.normal(size=(m, k)), rng.normal(size=(k, n)))
    dot(rng.normal(size=200_000), rng.normal(size=200_000))
    time.sleep(0.05)
    rounds.append(spent() - before)
print(min(rounds))
"""


@pytest.mark.skipif(
    not Path("/proc/self/schedstat").exists(), reason="the system does not tell the CPU time of threads"
)
def test_products_wake_no_threads_of_blas() -> None:
    # Each that is woken spins for some 30 ms in every round; one left over from the start, once.
    # Red with `@` in place of `product`.
    free = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    found = subprocess.run(
        [sys.executable, "-c", THREADS_OF_BLAS], env=free, capture_output=True, text=True, check=True
    )
    assert int(found.stdout) < 1_000_000
