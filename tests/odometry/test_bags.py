"""Bags of ROS 1 and ROS 2: the same frames as from files, as often as they are asked for."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("kiss_icp")
pytest.importorskip("rosbags", reason="pip install 'dqreg[ros]'")

from click.testing import CliRunner

from dqreg.cli.odometry import odometry_command
from dqreg.errors import InputError, MissingDependencyError
from dqreg.odometry import Odometry
from dqreg.odometry.scans import open_scans
from tests.odometry.bag_files import KINDS, cloud_message, write_bag

RNG = np.random.default_rng(0)
FRAMES = [RNG.normal(size=(50 + 10 * k, 3)) for k in range(4)]
STAMPS = 1_763_800_000.0 + 0.1 * np.arange(4)


def messages(frames=FRAMES, times=None):
    return [
        (t + 0.02, cloud_message(f, None if times is None else times[k], t))
        for k, (f, t) in enumerate(zip(frames, STAMPS, strict=False))
    ]


@pytest.fixture(params=KINDS)
def bag(request, tmp_path) -> Path:
    return write_bag(tmp_path / "a", request.param, {"/points": messages()})


def test_frames_are_the_same_in_any_order_and_as_often_as_asked(bag):
    scans = open_scans(bag)
    np.testing.assert_array_equal(scans.times, STAMPS)
    for number in (0, 1, 2, 3, 0, 3, 1, 1, 2):
        np.testing.assert_array_equal(scans[number].points, FRAMES[number])
    assert np.array_equal(open_scans(bag, loader="rosbag")[2].points, FRAMES[2])


def test_times_of_points_stay_in_step_with_returns_that_are_nan(tmp_path):
    points = FRAMES[3].copy()
    points[::7] = np.nan
    times = np.linspace(0.0, 0.1, len(points))
    path = write_bag(tmp_path / "a", "sqlite3", {"/points": messages([points], [times])})
    frame = open_scans(path)[0]
    np.testing.assert_array_equal(frame.points, points)
    np.testing.assert_array_equal(frame.timestamps, times)


def test_topics_are_chosen_by_name(tmp_path):
    path = write_bag(tmp_path / "a", "mcap", {"/front": messages(), "/rear": messages([f + 1 for f in FRAMES])})
    np.testing.assert_array_equal(open_scans(path, topic="/rear")[1].points, FRAMES[1] + 1)
    with pytest.raises(InputError, match=r"/front \(4 messages\), /rear \(4 messages\); choose one with --topic"):
        open_scans(path)
    with pytest.raises(InputError, match="did you mean /front"):
        open_scans(path, topic="/frnt")
    with pytest.raises(InputError, match="names a topic of a bag"):
        open_scans(tmp_path, topic="/front")


def test_messages_that_arrive_together_are_told_apart(tmp_path):
    rows = [(1.0, cloud_message(f, None, t)) for f, t in zip(FRAMES, STAMPS, strict=True)]
    scans = open_scans(write_bag(tmp_path / "a", "sqlite3", {"/points": rows}))
    for number in (3, 1, 2, 0):
        np.testing.assert_array_equal(scans[number].points, FRAMES[number])


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_are_named(tmp_path, kind):
    path = write_bag(tmp_path / "a", kind, {"/points": messages()})
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    for trial in range(12):
        content = bytearray(whole[: rng.integers(1, len(whole))] if trial % 2 else whole)
        for place in rng.integers(0, len(content), 20):
            content[place] = rng.integers(256)
        file.write_bytes(bytes(content))
        # A damaged frame is one of its own; a damaged bag is refused by name.
        with contextlib.suppress(InputError):
            scans = open_scans(path)
            assert all(np.ndim(scans[n].points) == 2 for n in range(len(scans)))


def test_what_a_bag_lacks_is_named(tmp_path, monkeypatch):
    empty = tmp_path / "empty.bag"
    empty.write_bytes(b"")
    with pytest.raises(InputError, match="whole bag of ROS"):
        open_scans(empty)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel.anyreader", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'dqreg\[ros\]'"):
        open_scans(empty)


def test_compare_reads_the_bag_once_an_engine(tmp_path, jerky):
    frames = [points[::2] for points in jerky.frames[:3]]
    path = write_bag(tmp_path / "a", "ros1", {"/points": messages(frames)})
    told = CliRunner().invoke(odometry_command, [str(path), "--compare", "--out", str(tmp_path / "a.tum")])
    assert told.exit_code in (0, 1), told.output
    # The frame that a comparison looks at first is there for every engine.
    assert len((tmp_path / "a.tum").read_text().splitlines()) == 3, told.output
    assert "3 accepted" in told.output


def test_a_bag_gives_the_trajectory_of_the_archive_bit_for_bit(tmp_path, real_data: Path):
    # balm_lidar_seq_a: a real sequence, written into a bag of ROS 2 and read back.
    folder = real_data / "balm_lidar_seq_a"
    scans, stamps = open_scans(folder), np.loadtxt(folder / "times.txt")
    count = 6
    rows = [(stamps[k] + 0.1, cloud_message(scans[k].points, None, stamps[k])) for k in range(count)]
    bag = open_scans(write_bag(tmp_path / "a", "mcap", {"/points": rows}))
    np.testing.assert_array_equal(bag.times, stamps[:count])
    ours, theirs = Odometry(), Odometry()
    for number in range(count):
        ours.register_frame(bag[number].points, stamp=bag.times[number])
        theirs.register_frame(scans[number].points, stamp=scans.times[number])
    assert ours.poses.tobytes() == theirs.poses.tobytes()
