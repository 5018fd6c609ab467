"""Bags of ROS 1 and ROS 2 (SQLite and MCAP), read by the package rosbags: no ROS is needed.

Messages are read one after the other where frames are asked for in order, and found again by their time where not.
"""

from __future__ import annotations

import bisect
import dataclasses
import struct
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError, did_you_mean, load_package
from dqreg.geometry.fields import RawCloud, from_message

SUFFIXES = (".bag", ".db3", ".mcap")
CLOUD_TYPE, LIVOX_TYPES = (
    "sensor_msgs/msg/PointCloud2",
    ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg"),
)
# Seconds and nanoseconds of the header, behind four bytes: of the encoding in ROS 2, of the number in ROS 1.
STAMP_FIELDS, STAMP_OFFSET_BYTES = struct.Struct("<iI"), 4


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file of one, or the folder of one of ROS 2 or of several of ROS 1."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(file.suffix == ".bag" for file in path.iterdir())
    return path.suffix.lower() in SUFFIXES


class Bag:
    """An open bag."""

    def __init__(self, path: Path) -> None:
        anyreader: Any = load_package("rosbags.highlevel.anyreader", "'dqreg[ros]'", f"{path}: a bag of ROS")
        typesys: Any = load_package("rosbags.typesys", "'dqreg[ros]'", f"{path}: a bag of ROS")
        self.path = path
        split = sorted(path.glob("*.bag")) if path.is_dir() else []
        try:
            # Bags of ROS 2 before Iron do not hold the definitions of their messages.
            store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
            self._reader = anyreader.AnyReader(split or [path], default_typestore=store)
            self._reader.open()
        except Exception as error:
            # rosbags, SQLite and YAML fail in their own ways over damaged bags.
            raise self.unreadable(error) from error
        weakref.finalize(self, self._reader.close)

    def unreadable(self, error: BaseException) -> InputError:
        """Error of a bag that cannot be read."""
        words = " ".join(str(error).split())[:200] or type(error).__name__
        return InputError(f"cannot read the bag {self.path}: {words}; expected a whole bag of ROS 1 or ROS 2")

    def topics(self, kinds: Sequence[str]) -> dict[str, int]:
        """Topics of some types, and the number of messages of each."""
        found = {name: info for name, info in self._reader.topics.items() if info.msgtype in kinds}
        return {name: int(info.msgcount) for name, info in found.items()}

    def topic(self, wanted: str | None, kinds: Sequence[str], option: str) -> str:
        """The topic that was asked for, or the only one of its type."""
        known = self.topics(kinds)
        listed = ", ".join(f"{name} ({count} messages)" for name, count in known.items())
        if wanted is not None:
            if wanted in known:
                return wanted
            others = listed or "none; it has " + (", ".join(self._reader.topics) or "no topics")
            hint = did_you_mean(wanted, known)
            raise InputError(f"{self.path}: no topic {wanted} of {kinds[0]}{hint}; there are {others}")
        if not known:
            has = ", ".join(f"{name} ({info.msgtype})" for name, info in self._reader.topics.items()) or "no topics"
            raise InputError(f"{self.path} holds no topic of {kinds[0]}; it has {has}")
        if len(known) > 1:
            raise InputError(f"{self.path} holds several topics of {kinds[0]}: {listed}; choose one with {option}")
        return next(iter(known))

    def messages(self, topic: str, start: int | None = None) -> Iterator[tuple[int, bytes, str]]:
        """Time of arrival in ns, bytes and type of the messages of a topic, from a time on."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        try:
            for connection, time, data in self._reader.messages(connections, start=start):
                yield time, bytes(data), connection.msgtype
        except (InputError, GeneratorExit):
            raise
        except Exception as error:
            raise self.unreadable(error) from error

    def parsed(self, data: bytes, kind: str) -> Any:
        """A message."""
        try:
            return self._reader.deserialize(data, kind)
        except Exception as error:
            # Damaged bytes fail wherever they are looked at first.
            raise InputError(f"a damaged message of {kind}: {' '.join(str(error).split())[:200]}") from error


@dataclasses.dataclass
class CloudTopic:
    """The clouds of one topic by their numbers."""

    bag: Bag
    topic: str
    arrivals: list[int]  # Time of arrival of each message, ns
    stamps: FloatArray  # (n,): Time in the header of each, seconds
    _next: int = 0
    _stream: Iterator[tuple[int, bytes, str]] | None = None

    @staticmethod
    def of(path: Path, topic: str | None) -> CloudTopic:
        """The clouds of a bag."""
        bag = Bag(path)
        name = bag.topic(topic, (CLOUD_TYPE, *LIVOX_TYPES), "--topic")
        arrivals, stamps = [], []
        for time, data, _ in bag.messages(name):
            arrivals.append(time)
            stamps.append(stamp_in(data))
        if not arrivals:
            raise InputError(f"{path}: the topic {name} has no messages")
        return CloudTopic(bag, name, arrivals, np.array(stamps))

    def read(self, number: int) -> RawCloud:
        """Points of a message, finite or not, and their times, in step."""
        if self._stream is None or number != self._next:
            start = self.arrivals[number]
            self._stream = self.bag.messages(self.topic, start)
            for _ in range(number - bisect.bisect_left(self.arrivals, start)):
                next(self._stream)
        found = next(self._stream, None)
        self._next = number + 1
        if found is None:
            raise InputError(f"{self.bag.path}: message {number} of {self.topic} is gone")
        message = self.bag.parsed(found[1], found[2])
        return _from_livox(message) if found[2] in LIVOX_TYPES else from_message(message)


def stamp_in(data: bytes) -> float:
    """Time of a message with a header, seconds, without parsing the rest; NaN where there is none."""
    if len(data) < STAMP_OFFSET_BYTES + STAMP_FIELDS.size:
        return np.nan
    seconds, nanoseconds = STAMP_FIELDS.unpack_from(data, STAMP_OFFSET_BYTES)
    return float((seconds * 10**9 + nanoseconds) / 10**9)


def _from_livox(message: Any) -> RawCloud:
    rows = np.array([(p.x, p.y, p.z, p.offset_time) for p in message.points], dtype=np.float64).reshape(-1, 4)
    return RawCloud(rows[:, :3], None, rows[:, 3])
