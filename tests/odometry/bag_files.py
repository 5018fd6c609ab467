"""Bags for the tests, written by rosbags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.exports import to_pointcloud2

KINDS = ("ros1", "sqlite3", "mcap")


def cloud_message(points: FloatArray, times: FloatArray | None, stamp: float) -> Any:
    """A PointCloud2 in float64, so that nothing is rounded."""
    columns = dict(zip("xyz", points.T, strict=True)) | ({} if times is None else {"time": times})
    return to_pointcloud2(columns, "lidar", stamp, "float64")


def write_bag(path: Path, kind: str, topics: Mapping[str, Iterable[tuple[float, Any]]]) -> Path:
    """Write messages with their times of arrival; what is no message of rosbags is made one by its type's name."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    if kind == "ros1":
        writer: Any = Writer1(path.with_suffix(".bag"))
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    with writer:
        rows = []
        for topic, messages in topics.items():
            for time, message in messages:
                made = of_store(store, message)
                rows.append((round(time * 1e9), topic, made))
        connections: dict[str, Any] = {}
        for time, topic, made in sorted(rows, key=lambda row: row[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, made.__msgtype__, typestore=store)
            writer.write(connections[topic], time, serialize(made, made.__msgtype__))
    return path.with_suffix(".bag") if kind == "ros1" else path


def of_store(store: Any, message: Any) -> Any:
    """A PointCloud2 of dqreg as a message of rosbags."""
    types = store.types
    if not hasattr(message, "point_step"):
        return message
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    stamp = time(sec=message.header.stamp.sec, nanosec=message.header.stamp.nanosec)
    numbered = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
    field = types["sensor_msgs/msg/PointField"]
    return types["sensor_msgs/msg/PointCloud2"](
        header=header(stamp=stamp, frame_id=message.header.frame_id, **numbered),
        height=1,
        width=message.width,
        fields=[field(name=f.name, offset=f.offset, datatype=f.datatype, count=1) for f in message.fields],
        is_bigendian=False,
        point_step=message.point_step,
        row_step=message.row_step,
        data=np.frombuffer(message.data, dtype=np.uint8),
        is_dense=True,
    )
