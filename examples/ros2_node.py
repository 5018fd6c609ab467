"""LiDAR odometry as a node of ROS 2: clouds in, poses with covariance and TF out; a frame that is not trusted is said.

    python examples/ros2_node.py --ros-args -r points:=/ouster/points -p voxel_size:=0.4

Subscribes `points` (sensor_msgs/PointCloud2), and `wheels` (nav_msgs/Odometry) where something publishes it. Publishes
`odometry` (nav_msgs/Odometry) and the transform from the map to the sensor. A frame without a pose publishes nothing:
the filter behind goes on with what else it knows.
"""

from __future__ import annotations

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from tf2_ros import TransformBroadcaster

import dqreg
from dqreg.rigid import pose, quaternion

# Frames whose poses are kept: a node never ends.
HISTORY = 1_000


def matrix_of(message: OdometryMessage) -> np.ndarray:
    """Pose of an odometry message, (4, 4)."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return pose.from_parts(quaternion.to_matrix([q.w, q.x, q.y, q.z]), [p.x, p.y, p.z])


class OdometryNode(Node):
    """Registers each cloud to the map of those before."""

    def __init__(self) -> None:
        super().__init__("dqreg_odometry")
        self.map_frame = self.declare_parameter("map_frame", "map").value
        voxel_size = self.declare_parameter("voxel_size", 0.0).value  # 0: from the first frame
        # One sigma of the wheels' motion between two frames: radians, metres.
        self.wheel_sigma = self.declare_parameter("wheel_sigma", [0.02, 0.05]).value
        self.odometry = dqreg.Odometry(voxel_size=voxel_size or None, history=HISTORY)
        self.wheels: np.ndarray | None = None  # the latest pose that the wheels give
        self.wheels_then: np.ndarray | None = None  # the same at the last pose
        self.out = self.create_publisher(OdometryMessage, "odometry", 10)
        self.transforms = TransformBroadcaster(self)
        self.create_subscription(PointCloud2, "points", self.on_points, qos_profile_sensor_data)
        self.create_subscription(OdometryMessage, "wheels", self.on_wheels, 10)

    def on_wheels(self, message: OdometryMessage) -> None:
        self.wheels = matrix_of(message)

    def on_points(self, message: PointCloud2) -> None:
        # Fields, per-point times and the stamp are read from the message.
        result = self.odometry.register_frame(message, **self.prediction())
        # A frame that was kept out of the map leaves the last pose where it was.
        if np.array_equal(result.T_target_source, self.odometry.last_pose):
            self.wheels_then = self.wheels
        level, reasons = result.verdict.level, "; ".join(result.verdict.reasons)
        if level != "accepted":
            self.get_logger().warning(f"{level}: {reasons}")
        if level == "failed":
            return
        self.publish(message, result)

    def prediction(self) -> dict[str, np.ndarray]:
        """The last pose carried on by the wheels, where there are any."""
        if self.wheels is None or self.wheels_then is None:
            return {}
        expected = self.odometry.last_pose @ pose.inverse(self.wheels_then) @ self.wheels
        turn, shift = self.wheel_sigma
        return {"prediction": expected, "prediction_covariance": np.diag([turn**2] * 3 + [shift**2] * 3)}

    def publish(self, cloud: PointCloud2, result: dqreg.Registration) -> None:
        T = result.T_target_source
        w, x, y, z = quaternion.from_matrix(T[:3, :3]).tolist()
        made, transform = OdometryMessage(), TransformStamped()
        for each in (made, transform):
            each.header.stamp, each.header.frame_id = cloud.header.stamp, self.map_frame
            each.child_frame_id = cloud.header.frame_id
        for place in (made.pose.pose.position, transform.transform.translation):
            place.x, place.y, place.z = T[:3, 3].tolist()
        for turned in (made.pose.pose.orientation, transform.transform.rotation):
            turned.w, turned.x, turned.y, turned.z = w, x, y, z
        covariance = result.covariance_in("source", order="tr", side="left")
        # A free motion has NaN; filters take a large number for "not known".
        made.pose.covariance = np.where(np.isfinite(covariance), covariance, np.eye(6) * 1e6).ravel().tolist()
        self.out.publish(made)
        self.transforms.sendTransform(transform)


def main() -> None:
    rclpy.init()
    node = OdometryNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
