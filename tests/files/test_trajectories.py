"""One format, two rooms: what many scans or an odometry write with a gap, both read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.files.trajectories import Form, read_poses, to_kitti
from dqreg.multiway.exports import to_trajectory
from dqreg.multiway.pairwise.starts import read_starts_file
from dqreg.odometry import bridge_gaps, load_trajectory, read_trajectory, write_trajectory
from dqreg.rigid import pose

COUNT, MISSING = 5, 2


def path_with_a_gap() -> FloatArray:
    T = pose.exp(np.arange(1.0, COUNT + 1)[:, None] * [0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    T[MISSING] = np.nan
    return T


def by_multiway(file: Path, T: FloatArray, form: Form) -> None:
    file.write_text(to_trajectory(T, form))


def by_odometry(file: Path, T: FloatArray, form: Form) -> None:
    write_trajectory(file, T, form=form)


@pytest.mark.parametrize("form", ["kitti", "tum"])
@pytest.mark.parametrize("write", [by_multiway, by_odometry])
def test_what_either_room_writes_both_read(
    tmp_path: Path, write: Callable[[Path, FloatArray, Form], None], form: Form
) -> None:
    T, file = path_with_a_gap(), tmp_path / "a"
    write(file, T, form)
    # Odometry bridges what KITTI has no place for.
    expected = bridge_gaps(T)[0] if (write, form) == (by_odometry, "kitti") else T
    found = np.isfinite(expected).all(axis=(1, 2))
    poses, times = read_trajectory(file, gaps="keep")
    if form == "tum":
        assert times is not None
        np.testing.assert_array_equal(times, np.flatnonzero(found))
        np.testing.assert_allclose(poses, T[found], atol=1e-14)
    else:
        np.testing.assert_allclose(poses, expected, atol=1e-14)
    np.testing.assert_allclose(read_starts_file(file, COUNT), expected, atol=1e-14)
    path = load_trajectory(file)
    np.testing.assert_array_equal(path.times, np.flatnonzero(found))
    np.testing.assert_allclose(path.poses, expected[found], atol=1e-14)


def test_a_line_of_nan_is_refused_with_what_to_do_unless_it_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(to_trajectory(path_with_a_gap(), "kitti"))
    with pytest.raises(InputError, match=r'a\.txt: pose 2 .* NaN\. Leave .* gaps="keep"'):
        read_trajectory(tmp_path / "a.txt")
    with pytest.raises(InputError, match='"refuse" or "keep"; got'):
        read_trajectory(tmp_path / "a.txt", gaps="skip")  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", ["nan 0 0 0 0 1 0 0 0 0 1 0", "inf 0 0 0 0 1 0 0 0 0 1 0", "nan 1 2 3 0 0 0 1"])
def test_half_a_pose_is_no_gap(tmp_path: Path, bad: str) -> None:
    (tmp_path / "a").write_text(f"{bad}\n")
    with pytest.raises(InputError, match="expected finite numbers, or NaN for a pose"):
        read_poses(tmp_path / "a", "keep")


def test_rotations_keep_their_bits_and_rounded_ones_are_mended(tmp_path: Path) -> None:
    T = path_with_a_gap()[:MISSING]
    (tmp_path / "a").write_text(to_kitti(T))
    np.testing.assert_array_equal(read_poses(tmp_path / "a")[0], T)
    (tmp_path / "a").write_text(to_kitti(T.round(4)))
    R = read_poses(tmp_path / "a")[0][:, :3, :3]
    np.testing.assert_allclose(R.transpose(0, 2, 1) @ R, np.tile(np.eye(3), (MISSING, 1, 1)), atol=1e-14)
