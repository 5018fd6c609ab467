"""examples/ros2_node.py with a stub of ROS: what it is sent, and what it publishes."""

from __future__ import annotations

import runpy
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg.geometry import PointCloud
from dqreg.geometry.exports import PointCloud2
from dqreg.rigid import pose, quaternion

NODE = Path(__file__).parents[2] / "examples" / "ros2_node.py"


def parts(**values: Any) -> types.SimpleNamespace:
    return types.SimpleNamespace(**values)


class OdometryMessage:
    """nav_msgs/Odometry."""

    def __init__(self) -> None:
        self.header, self.child_frame_id = parts(stamp=None, frame_id=""), ""
        inner = parts(position=parts(x=0.0, y=0.0, z=0.0), orientation=parts(x=0.0, y=0.0, z=0.0, w=1.0))
        self.pose = parts(pose=inner, covariance=[0.0] * 36)


class TransformStamped:
    """geometry_msgs/TransformStamped."""

    def __init__(self) -> None:
        self.header, self.child_frame_id = parts(stamp=None, frame_id=""), ""
        self.transform = parts(translation=parts(x=0.0, y=0.0, z=0.0), rotation=parts(x=0.0, y=0.0, z=0.0, w=1.0))


class Node:
    """rclpy.node.Node, as far as the example goes."""

    def __init__(self, name: str) -> None:
        self.name, self.published, self.heard, self.said = name, [], {}, []

    def declare_parameter(self, name: str, value: Any) -> Any:
        return parts(value=value)

    def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
        return parts(publish=lambda message: self.published.append((topic, message)))

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any) -> None:
        self.heard[topic] = callback

    def get_logger(self) -> Any:
        return parts(warning=self.said.append)


class TransformBroadcaster:
    def __init__(self, node: Node) -> None:
        self.node = node

    def sendTransform(self, message: Any) -> None:
        self.node.published.append(("tf", message))


@pytest.fixture
def node(monkeypatch) -> Any:
    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": 5},
        "geometry_msgs.msg": {"TransformStamped": TransformStamped},
        "nav_msgs.msg": {"Odometry": OdometryMessage},
        "sensor_msgs.msg": {"PointCloud2": PointCloud2},
        "tf2_ros": {"TransformBroadcaster": TransformBroadcaster},
    }
    for name, values in modules.items():
        made = types.ModuleType(name)
        vars(made).update(values)
        monkeypatch.setitem(sys.modules, name, made)
    made = runpy.run_path(str(NODE))["OdometryNode"]()
    # The stub has no classes of messages to make a cloud from.
    monkeypatch.delitem(sys.modules, "sensor_msgs.msg")
    return made


def wheels_at(T: np.ndarray) -> OdometryMessage:
    message = OdometryMessage()
    p, q = message.pose.pose.position, message.pose.pose.orientation
    p.x, p.y, p.z = T[:3, 3]
    q.w, q.x, q.y, q.z = quaternion.from_matrix(T[:3, :3])
    return message


def test_clouds_become_poses_transforms_and_warnings(node, jerky):
    # Truth: the poses that the rays were cast from, in the frame of the first.
    truth = pose.inverse(jerky.truth[0]) @ jerky.truth
    for number in range(4):
        node.heard["wheels"](wheels_at(jerky.truth[number]))
        node.heard["points"](PointCloud(jerky.frames[number]).to_pointcloud2("lidar", 10.0 + 0.1 * number))
    topics = [topic for topic, _ in node.published]
    assert topics == ["odometry", "tf"] * 4
    message, transform = node.published[-2][1], node.published[-1][1]
    assert (message.header.frame_id, message.child_frame_id, message.header.stamp.sec) == ("map", "lidar", 10)
    for place in (message.pose.pose.position, transform.transform.translation):
        np.testing.assert_allclose([place.x, place.y, place.z], truth[3, :3, 3], atol=0.05)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    assert node.said == []
    node.heard["points"](PointCloud([[1.0, 2.0, 3.0]]).to_pointcloud2("lidar", 10.4))
    assert len(node.published) == 8
    assert node.said[0].startswith("failed: ")
