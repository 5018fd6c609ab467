"""Messages of wheels, gyroscopes and fixed transforms for the tests, as rosbags writes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import quaternion


class Messages:
    """Messages for a kind of bag."""

    def __init__(self, kind: str) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._types = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE).types

    def _geometry(self, name: str, **fields: Any) -> Any:
        return self._types[f"geometry_msgs/msg/{name}"](**fields)

    def _header(self, stamp: float, frame: str) -> Any:
        kind, whole = self._types["std_msgs/msg/Header"], round(stamp * 1e9)
        time = self._types["builtin_interfaces/msg/Time"](sec=whole // 10**9, nanosec=whole % 10**9)
        return kind(stamp=time, frame_id=frame, **({"seq": 0} if "seq" in kind.__dataclass_fields__ else {}))

    def _parts(self, T: FloatArray) -> tuple[dict[str, float], Any]:
        q = quaternion.from_matrix(T[:3, :3]).tolist()
        return dict(zip("xyz", T[:3, 3].tolist(), strict=True)), self._geometry(
            "Quaternion", **dict(zip("wxyz", q, strict=True))
        )

    def wheels(self, T: FloatArray, stamp: float, frame: str = "base") -> Any:
        """A nav_msgs/Odometry."""
        place, q = self._parts(T)
        still = self._geometry("Vector3", x=0.0, y=0.0, z=0.0)
        at = self._geometry("Pose", position=self._geometry("Point", **place), orientation=q)
        return self._types["nav_msgs/msg/Odometry"](
            header=self._header(stamp, "odom"),
            child_frame_id=frame,
            pose=self._geometry("PoseWithCovariance", pose=at, covariance=np.zeros(36)),
            twist=self._geometry(
                "TwistWithCovariance",
                twist=self._geometry("Twist", linear=still, angular=still),
                covariance=np.zeros(36),
            ),
        )

    def imu(self, rate: FloatArray, stamp: float, frame: str = "imu", measured: float = 0.0) -> Any:
        """A sensor_msgs/Imu."""
        return self._types["sensor_msgs/msg/Imu"](
            header=self._header(stamp, frame),
            orientation=self._geometry("Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=self._geometry("Vector3", **dict(zip("xyz", np.asarray(rate).tolist(), strict=True))),
            angular_velocity_covariance=np.full(9, measured),
            linear_acceleration=self._geometry("Vector3", x=0.0, y=0.0, z=9.81),
            linear_acceleration_covariance=np.zeros(9),
        )

    def fixed(self, parent: str, child: str, T: FloatArray) -> Any:
        """A tf2_msgs/TFMessage of one transform T_parent_child."""
        place, q = self._parts(T)
        moved = self._geometry("Transform", translation=self._geometry("Vector3", **place), rotation=q)
        each = self._geometry(
            "TransformStamped", header=self._header(0.0, parent), child_frame_id=child, transform=moved
        )
        return self._types["tf2_msgs/msg/TFMessage"](transforms=[each])
