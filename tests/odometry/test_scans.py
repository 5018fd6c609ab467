from __future__ import annotations

import threading

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg.errors import InputError
from dqreg.files import write_cloud
from dqreg.kernels import threads
from dqreg.odometry import Odometry
from dqreg.odometry.run_sequence import run_sequence
from dqreg.odometry.scans import FrameData, Scans, open_scans
from dqreg.odometry.settings import OdometrySettings


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-5, 5, (50, 3)).astype(np.float32).astype(np.float64)


def test_natural_order_and_each_kind_of_file(tmp_path, points):
    for number in (10, 9, 1):
        write_cloud(tmp_path / f"scan_{number}.ply", points + number)
    (tmp_path / "times.txt").write_text("0\n0.5\n1\n")
    (tmp_path / "poses.txt").write_text("notes\n")
    scans = open_scans(tmp_path)
    assert scans.names == ("scan_1.ply", "scan_9.ply", "scan_10.ply")
    np.testing.assert_allclose(scans[2].points, points + 10, atol=1e-6)
    assert scans.times.tolist() == [0, 0.5, 1]


def test_a_frame_named_by_a_digit_that_counts_nothing(tmp_path, points):
    for name in ("²10", "²9"):
        write_cloud(tmp_path / f"{name}.ply", points)
    assert open_scans(tmp_path).names == ("²9.ply", "²10.ply")


def test_kitti_bin_npz_and_archive(tmp_path, points):
    np.hstack([points, np.ones((50, 1))]).astype("<f4").tofile(tmp_path / "0.bin")
    np.testing.assert_array_equal(open_scans(tmp_path)[0].points, points)
    folder = tmp_path / "npz"
    folder.mkdir()
    for i in range(2):
        np.savez(folder / f"{i}.npz", points=points, timestamps=np.arange(50.0))
    assert open_scans(folder)[1].timestamps.tolist() == list(range(50))
    whole = tmp_path / "whole.npz"
    np.savez(
        whole, points=np.arange(15, dtype=np.int16).reshape(5, 3), offsets=[0, 2, 2, 5], scale=0.5, times=[1, 2, 3]
    )
    scans = open_scans(whole)
    assert [len(scans[i].points) for i in range(3)] == [2, 0, 3]
    assert scans[0].points[1].tolist() == [1.5, 2.0, 2.5]


def test_an_archive_is_read_beside_what_an_earlier_run_wrote(tmp_path, points):
    np.savez(tmp_path / "scans.npz", points=points, offsets=[0, 20, 50])
    (tmp_path / "frames.csv").write_text("frame,name\n0,a\n")
    assert open_scans(tmp_path).names == ("scans.npz[0]", "scans.npz[1]")


def test_times_of_points_in_ply(tmp_path, points):
    header = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(
        f"property double {n}\n" for n in ("x", "y", "z", "t")
    )
    (tmp_path / "a.ply").write_text(header + "end_header\n1 2 3 0.25\n4 5 6 0.5\n")
    frame = open_scans(tmp_path)[0]
    assert frame.timestamps.tolist() == [0.25, 0.5]
    assert frame.points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_times_of_points_in_pcd(tmp_path):
    head = "VERSION .7\nFIELDS x y z time\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\nPOINTS 3\n"
    rows = np.array([(1, 2, 3, 0.25), (np.nan, 0, 0, 0.3), (4, 5, 6, 0.5)], dtype="<f4,<f4,<f4,<f8")
    (tmp_path / "a.pcd").write_bytes((head + "DATA binary\n").encode() + rows.tobytes())
    frame = open_scans(tmp_path)[0]
    # A point that is left out takes its time with it.
    assert frame.timestamps.tolist() == [0.25, 0.5]
    assert frame.points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_a_frame_with_times_that_is_cut_short_is_refused(tmp_path, points):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 500\n"
    head += "".join(f"property double {name}\n" for name in ("x", "y", "z", "t")) + "end_header\n"
    (tmp_path / "a.ply").write_bytes(head.encode() + np.column_stack([points, np.arange(50.0)]).tobytes())
    frame = open_scans(tmp_path)[0]
    assert len(frame.points) == 0
    assert "cut short" in frame.problem


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": np.zeros((5, 4))}, "points of shape"),
        ({"points": np.full((5, 3), "a")}, "type <U1"),
        ({"points": np.zeros((5, 3)), "t": np.zeros(4)}, "t of shape"),
        ({"points": np.zeros((5, 3)), "times": np.full(5, "a")}, "times of shape"),
        ({"points": np.full((5, 3), None)}, "no plain array points"),
        ({"other": np.zeros((5, 3))}, "an array named points"),
        ({"points": np.zeros((3_000_000, 3))}, "that unpack to"),
    ],
)
def test_a_bad_frame_in_an_archive_is_named(tmp_path, arrays, message):
    for number in (0, 1):
        np.savez_compressed(tmp_path / f"{number}.npz", **arrays)
    frame = open_scans(tmp_path)[0]
    assert len(frame.points) == 0
    assert message in frame.problem


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"offsets": [0, 2.5, 5]}, "offsets must be whole"),
        ({"offsets": [0, np.nan, 5]}, "offsets must be whole"),
        ({"offsets": ["0", "5"]}, "offsets of shape"),
        ({"scale": [1, 2]}, "scale of shape"),
        ({"scale": np.nan}, "a scale of nan"),
        ({"scale": 0}, "a scale of 0"),
        ({"points": np.zeros((5, 3), dtype=complex)}, "complex128"),
        ({"timestamps": np.zeros(4)}, "timestamps of shape"),
        ({"times": [1.0]}, "times of shape"),
    ],
)
def test_a_bad_sequence_in_an_archive_is_named(tmp_path, change, message):
    np.savez(tmp_path / "a.npz", **{"points": np.zeros((5, 3)), "offsets": [0, 2, 5], **change})
    with pytest.raises(InputError, match=message):
        open_scans(tmp_path / "a.npz")


def test_a_damaged_file_is_a_frame_that_failed(tmp_path, jerky):
    for i in (0, 2):
        write_cloud(tmp_path / f"{i}.ply", jerky.frames[i // 2])
    (tmp_path / "1.ply").write_text("ply\ncut short")
    trip = run_sequence(open_scans(tmp_path), OdometrySettings())
    assert [r.verdict.level for r in trip.results] == ["accepted", "failed", "accepted"]
    assert "1.ply" in trip.results[1].verdict.reasons[0]


@pytest.mark.parametrize(
    ("cores", "timed"),
    [(1, True), (2, False), *(pytest.param(*case, marks=pytest.mark.soak) for case in ((1, False), (2, True)))],
)
def test_frames_are_read_in_turn_by_one_thread_and_prepared_ahead_to_the_same_bits(monkeypatch, smooth, timed, cores):
    monkeypatch.setattr(threads, "thread_count", lambda: cores)
    reads, frames = [], [*smooth.frames[:3], np.zeros((0, 3)), *smooth.frames[3:]]
    times = [*smooth.times[:3], np.zeros(0), *smooth.times[3:]] if timed else [None] * len(frames)

    def read(number):
        reads.append((number, threading.get_ident()))
        return FrameData(frames[number], times[number])

    trip = run_sequence(Scans(tuple("abcdefghi"), read), OdometrySettings())
    odometry = Odometry()
    results = [odometry.register_frame(*frame) for frame in zip(frames, times, strict=True)]
    assert reads == [(number, threading.get_ident()) for number in range(9)]
    np.testing.assert_array_equal(trip.poses, odometry.poses)
    assert [r.verdict.reasons for r in trip.results] == [r.verdict.reasons for r in results]
    assert [r.verdict.level for r in trip.results][3] == "failed"


def test_kiss_icps_loaders_are_used_and_named(tmp_path, points):
    sequence = tmp_path / "sequences" / "07" / "velodyne"
    sequence.mkdir(parents=True)
    np.hstack([points, np.ones((50, 1))]).astype("<f4").tofile(sequence / "000000.bin")
    (sequence.parent / "calib.txt").write_text("Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n")
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses" / "07.txt").write_text("1 0 0 5 0 1 0 0 0 0 1 0\n" * 2)
    (sequence.parent / "times.txt").write_text("0\n0.1\n")
    scans = open_scans(tmp_path, loader="kitti", sequence="7")
    assert len(scans) == 1
    assert len(scans[0].points) == 50
    # KITTI's poses are the camera's: here its axes are turned, and KISS-ICP's loader knows how.
    moved = np.eye(4)
    moved[0, 3] = 1.0
    assert scans.calibrate(moved[None])[0, :3, 3].tolist() == [0, 0, 1]
    with pytest.raises(InputError, match="unknown data loader"):
        open_scans(tmp_path, loader="nosuch")
    with pytest.raises(InputError, match="cannot read"):
        open_scans(tmp_path, loader="kitti", sequence="9")


def test_what_is_no_sequence_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_scans(tmp_path / "absent")
    with pytest.raises(InputError, match="holds no scans"):
        open_scans(tmp_path)
    (tmp_path / "one.ply").write_text("ply")
    with pytest.raises(InputError, match="is one file"):
        open_scans(tmp_path / "one.ply")
    np.savez(tmp_path / "bad.npz", points=np.zeros((3, 3)), offsets=[0, 9])
    with pytest.raises(InputError, match="offsets"):
        open_scans(tmp_path / "bad.npz")
    (tmp_path / "t.txt").write_text("1\n2\n")
    with pytest.raises(InputError, match="2 times for 1 frames"):
        open_scans(tmp_path, times=tmp_path / "t.txt") if (tmp_path / "bad.npz").unlink() is None else None


@pytest.mark.parametrize("words", ["\n \n", "# seconds\n\n"])
def test_a_file_of_times_without_times_is_named(tmp_path, words):
    np.savez(tmp_path / "a.npz", points=np.zeros((3, 3)), offsets=[0, 2, 3])
    (tmp_path / "t.txt").write_text(words)
    with pytest.raises(InputError, match=r"t\.txt.*no times"):
        open_scans(tmp_path / "a.npz", times=tmp_path / "t.txt")
