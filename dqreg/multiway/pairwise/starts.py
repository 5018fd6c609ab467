"""Initial poses of many scans: from an argument, or from a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.files.trajectories import read_poses
from dqreg.multiway.pose_graph.edges import PART, Edge
from dqreg.multiway.scans.scans import View
from dqreg.rigid import pose
from dqreg.trust.records import Reason

# A pose farther from an initial one than this rotation, and this share of a scan's size, is another one.
OTHER_POSE_RAD, OTHER_POSE_SIZES = np.deg2rad(15.0), 0.1


def read_starts(starts: Any, count: int) -> list[FloatArray | None]:
    """Initial poses, checked; None where there is none."""
    if starts is None:
        return [None] * count
    try:
        listed = list(starts)
    except TypeError:
        listed = []
    if len(listed) != count:
        raise InputError(f"starts must hold one 4x4 pose T_world_scan (or None) a scan; got {len(listed)} for {count}")
    return [None if _is_empty(start) else as_pose(start, f"starts[{k}]") for k, start in enumerate(listed)]


def _is_empty(start: Any) -> bool:
    if start is None:
        return True
    try:
        numbers = np.asarray(start, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return numbers.shape == (4, 4) and bool(np.isnan(numbers).all())


def contradicted_starts(
    views: Sequence[View],
    starts: Sequence[FloatArray | None],
    T_world_scan: FloatArray,
    edges: Sequence[Edge],
    size: float,
) -> Iterator[Reason]:
    """Initial poses that are not those found, by the used edges of their scans: a drift along many is none."""
    off: dict[int, list[tuple[int, int, float, float]]] = {}
    for edge in edges:
        target, source, cloud = edge.target, edge.source, views[edge.source].cloud
        first, second = np.eye(4) if target == PART else starts[target], starts[source]
        if not edge.used or first is None or second is None or cloud is None:
            continue
        home = np.eye(4) if target == PART else T_world_scan[target]
        given, found = pose.inverse(first) @ second, pose.inverse(home) @ T_world_scan[source]
        turned = float(pose.angle_between(given, found))
        shift = float(pose.offset_between(given, found, at=cloud.points.mean(axis=0))) / size
        if turned > OTHER_POSE_RAD or shift > OTHER_POSE_SIZES:
            for k in {target, source} - {PART}:
                off.setdefault(k, []).append((target, source, turned, shift))
    while off:
        # The scan with most such edges explains them; of two scans alone the first is the one that is held.
        wrong = max(off, key=lambda k: (len(off[k]), k))
        turned, shift = np.median([row[2:] for row in off[wrong]], axis=0)
        yield Reason(
            f"the initial pose of {views[wrong].name} contradicts the pose found: next to the scans that it overlaps "
            f"it is {np.rad2deg(turned):.0f} degrees and {100.0 * shift:.0f} % of a scan's size off",
            "contradicted_start",
        )
        rest = {k: [row for row in rows if wrong not in row[:2]] for k, rows in off.items()}
        off = {k: rows for k, rows in rest.items() if rows}


def other_frame(views: Sequence[View], starts: Mapping[int, FloatArray], asked: int, held: int) -> Iterator[Reason]:
    """A doubt where another scan than the one asked for says where the world is."""
    if held == asked:
        return
    first, second = views[asked].name, views[held].name
    world = f"that of the starts, where the start of {second} is kept" if held in starts else f"the frame of {second}"
    yield Reason(
        f"{first}, the anchor, hangs together with few other scans or none: {second} stands for it, and the world is "
        f"{world}",
        "other_frame",
    )


def read_starts_file(path: Path, count: int) -> list[FloatArray]:
    """Poses of scans in a KITTI or TUM file, or in an earlier result; NaN where there is none."""
    if path.suffix.lower() == ".json":
        return read_result_poses(path)
    poses, times = read_poses(path, "keep", "initial poses")
    if times is None or len(poses) == count:
        return list(poses)
    # TUM leaves scans that are not placed out; which these are, the times of our own files tell.
    if not np.isin(times, np.arange(count)).all() or len(np.unique(times)) < len(times):
        raise InputError(
            f"{path}: {len(poses)} poses for {count} scans; expected one a scan, or times that are the numbers of the "
            f"scans, 0 to {count - 1}"
        )
    placed = np.full((count, 4, 4), np.nan)
    placed[times.astype(np.int64)] = poses
    return list(placed)


def read_result_poses(path: Path) -> list[FloatArray]:
    """Poses of the scans in an earlier result, or in the truth of a virtual case; NaN where there is none."""
    listed = read_json(path, "a result of dqreg multiway").get("T_world_scan")
    if not isinstance(listed, list):
        raise InputError(f"{path}: the key 'T_world_scan' is missing; give a result of dqreg multiway")
    return [_matrix(T, f"{path}: T_world_scan[{k}]") for k, T in enumerate(listed)]


def _matrix(rows: Any, name: str) -> FloatArray:
    try:
        T = np.array(rows, dtype=np.float64)  # null is NaN
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be 4x4 numbers ({error})") from error
    if T.shape != (4, 4):
        raise InputError(f"{name} must be 4x4 numbers; got shape {T.shape}")
    return T
