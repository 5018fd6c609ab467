"""Topics of a bag that tell the motion: wheel odometry and IMUs, and the fixed transforms of /tf_static."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError, did_you_mean
from dqreg.odometry.bags import CLOUD_TYPE, LIVOX_TYPES, Bag, is_bag, stamp_in
from dqreg.odometry.motion import Gyroscope, MotionPrior, Wheels
from dqreg.odometry.scans import Scans
from dqreg.rigid import Trajectory, pose, quaternion

WHEELS_TYPE, IMU_TYPE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def open_motion(path: str | Path, topic: str, scans: Scans, clouds: str | None = None) -> MotionPrior:
    """The motion that a topic of the bag of a sequence tells."""
    path = Path(path)
    if not is_bag(path):
        raise InputError(f"--motion names a topic of a bag, and {path} is none")
    bag = Bag(path)
    kind = _kind_of(bag, topic)
    times, rows, body = _rows_of(bag, topic, kind)
    sensor = _frame_of_clouds(bag, clouds)
    X, placed = _fixed(bag, body, sensor)
    source = _source(kind, times, rows)
    words = f"motion from {topic} ({kind.replace('/msg/', '/')}, {len(times)} messages); {placed}"
    prior = MotionPrior(source, X, words)
    assert scans.times is not None
    steps = prior.usable(scans.times)
    if len(steps) and not steps.any():
        raise InputError(
            f"{path}: {topic} tells the motion from {times[0]:.3f} to {times[-1]:.3f} s, and the clouds are of "
            f"{scans.times[0]:.3f} to {scans.times[-1]:.3f} s: no two of them lie within; their clocks must agree"
        )
    told = "" if steps.all() else f"; silent in {int(np.count_nonzero(~steps))} of {len(steps)} steps between frames"
    return MotionPrior(source, X, words + told)


def _kind_of(bag: Bag, topic: str) -> str:
    usable = {name: (kind, count) for kind in (WHEELS_TYPE, IMU_TYPE) for name, count in bag.topics([kind]).items()}
    if topic in usable:
        return usable[topic][0]
    short = ", ".join(f"{name} ({kind.replace('/msg/', '/')}, {n} messages)" for name, (kind, n) in usable.items())
    raise InputError(
        f"{bag.path}: --motion {topic} is no topic of nav_msgs/Odometry or sensor_msgs/Imu"
        f"{did_you_mean(topic, usable)}; usable are {short or 'none in this bag'}"
    )


def _rows_of(bag: Bag, topic: str, kind: str) -> tuple[FloatArray, FloatArray, str]:
    """Times, numbers of each message, and the frame that they are of."""
    read = _wheel_row if kind == WHEELS_TYPE else _gyro_row
    stamps, arrivals, rows, body = [], [], [], ""
    for arrival, data, name in bag.messages(topic):
        message = bag.parsed(data, name)
        stamps.append(stamp_in(data))
        arrivals.append(arrival / 1e9)
        rows.append(read(message))
        body = body or (message.child_frame_id if kind == WHEELS_TYPE else message.header.frame_id)
    values = np.array(rows, dtype=np.float64)
    times = np.array(stamps)
    # Drivers without a clock leave the stamps zero.
    times = times if len(times) and np.isfinite(times).all() and np.ptp(times) > 0.0 else np.array(arrivals)
    keep = np.isfinite(values).all(axis=1) if len(values) else np.zeros(0, dtype=bool)
    times, first = np.unique(times[keep], return_index=True)
    if len(times) < 2:
        raise InputError(
            f"{bag.path}: {topic} has {len(times)} usable of {len(rows)} messages; at least two with finite values (a "
            "unit orientation, an angular velocity that is measured) at different times are needed"
        )
    return times, values[keep][first], _plain(body)


def _wheel_row(message: Any) -> list[float]:
    """Position, unit quaternion (w first), and the variances of the velocities, rotation first; NaN if it is none."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    numbers = np.array([q.w, q.x, q.y, q.z])
    size = float(np.linalg.norm(numbers))
    unit = numbers / size if abs(size - 1.0) < 1e-2 else np.full(4, np.nan)
    stated = np.asarray(message.twist.covariance, dtype=np.float64).reshape(6, 6).diagonal()
    stated = np.where(np.isfinite(stated) & (stated > 0.0), stated, 0.0)
    return [p.x, p.y, p.z, *unit, *stated[3:], *stated[:3]]


def _gyro_row(message: Any) -> list[float]:
    """Angular velocity; NaN where the message says that there is none (a first covariance of -1)."""
    w = message.angular_velocity
    return [np.nan] * 3 if message.angular_velocity_covariance[0] == -1.0 else [w.x, w.y, w.z]


def _source(kind: str, times: FloatArray, rows: FloatArray) -> Wheels | Gyroscope:
    if kind == IMU_TYPE:
        return Gyroscope(times, rows)
    poses = np.array([pose.from_parts(quaternion.to_matrix(row[3:7]), row[:3]) for row in rows])
    return Wheels(Trajectory(times, poses), rows[:, 7:])


def _frame_of_clouds(bag: Bag, topic: str | None) -> str:
    name = bag.topic(topic, (CLOUD_TYPE, *LIVOX_TYPES), "--topic")
    for _, data, kind in bag.messages(name):
        return _plain(bag.parsed(data, kind).header.frame_id)
    return ""


def _fixed(bag: Bag, body: str, sensor: str) -> tuple[FloatArray, str]:
    """T_body_sensor from /tf_static, and what was taken."""
    if body and body == sensor:
        return np.eye(4), f"it is of the clouds' own frame {sensor}"
    steps: dict[str, list[tuple[str, FloatArray]]] = {}
    static = [name for name in bag.topics(TRANSFORM_TYPES) if name.endswith("tf_static")]
    for topic in static:
        for _, data, kind in bag.messages(topic):
            for each in bag.parsed(data, kind).transforms:
                parent, child, T = _plain(each.header.frame_id), _plain(each.child_frame_id), _transform(each.transform)
                steps.setdefault(parent, []).append((child, T))
                steps.setdefault(child, []).append((parent, pose.inverse(T)))
    found, open_ = {body: np.eye(4)}, [body]
    while open_:
        frame = open_.pop()
        for other, T in steps.get(frame, []):
            if other not in found:
                found[other] = found[frame] @ T
                open_.append(other)
    if body and sensor in found:
        return found[sensor], f"{body} to {sensor} by /tf_static"
    return np.eye(4), f"no /tf_static from {body or 'its frame'} to {sensor or 'the clouds'}: taken to coincide"


def _transform(transform: Any) -> FloatArray:
    t, q = transform.translation, transform.rotation
    numbers = np.array([q.w, q.x, q.y, q.z, t.x, t.y, t.z])
    if not np.isfinite(numbers).all() or not numbers[:4].any():
        raise InputError("a transform of /tf_static is not finite or has no rotation")
    return pose.from_parts(quaternion.to_matrix(quaternion.normalize(numbers[:4])), numbers[4:])


def _plain(frame: str) -> str:
    return str(frame).strip().lstrip("/")
