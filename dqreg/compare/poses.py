"""Poses and truths on disk: result files, truth.json, and 4x4 text."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, as_float, as_pose
from dqreg.errors import InputError

POSE = "T_target_source"


@dataclasses.dataclass(frozen=True, eq=False)
class Truth:
    """What a truth file says.

    Attributes
    ----------
    poses : ndarray, (k, 4, 4)
        True poses ``T_target_source``, the one named in the file first, then the symmetric ones.
    axis : ndarray, (2, 3), or None
        Point and direction of an axis of revolution, target frame.
    """

    poses: FloatArray
    axis: FloatArray | None = None


def read_pose(path: str | os.PathLike[str]) -> FloatArray:
    """Pose of a result file or a text file, as it stands there: not mended, NaN where nothing was found.

    Parameters
    ----------
    path : str or path
        JSON with the key ``T_target_source``, or text with 4x4 (or 3x4) numbers.

    Returns
    -------
    ndarray, (4, 4)
        The numbers.

    Raises
    ------
    InputError
        If the file cannot be read or holds no 4x4 numbers; the message names it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "pose.txt"
    ...     np.savetxt(path, np.eye(4))
    ...     read_pose(path).shape
    (4, 4)
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        rows = _read_json(path).get(POSE)
        if rows is None:
            raise InputError(f"{path}: the key {POSE!r} is missing; give a result.json, a truth.json or a 4x4 text")
        return _matrix(_with_nan(rows), path)
    return _matrix(_read_text(path), path)


def read_truth(path: str | os.PathLike[str]) -> Truth:
    """Truth of a ``truth.json`` or of a text file with a 4x4 pose.

    Besides ``T_target_source``, JSON may hold ``symmetric_truths``, a list of all 4x4 poses that are true because the
    part is symmetric, and ``symmetry_axis``, the ``point`` and ``direction`` of an axis of revolution (target frame).

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    Truth
        Checked poses.

    Raises
    ------
    InputError
        If the file cannot be read, or a pose in it is not rigid.

    Examples
    --------
    >>> from dqreg.synth import demo_case
    >>> read_truth(demo_case() / "truth.json").poses.shape
    (1, 4, 4)
    """
    path = Path(path)
    first = as_pose(read_pose(path), f"{path}: {POSE}")
    if path.suffix.lower() != ".json":
        return Truth(first[None])
    data = _read_json(path)
    return truth_of(data, first, str(path))


def truth_of(data: Any, first: FloatArray, name: str) -> Truth:
    """Truth with the symmetries that a mapping names.

    Parameters
    ----------
    data : mapping
        Contents of a ``truth.json``.
    first : ndarray, (4, 4)
        The true pose.
    name : str
        What to call the file in messages.

    Returns
    -------
    Truth
        With all symmetric poses.

    Raises
    ------
    InputError
        If a symmetric truth is no rigid pose, or the axis has no point and direction.

    Examples
    --------
    >>> truth_of({"symmetric_truths": [np.eye(4), np.diag([-1, -1, 1, 1])]}, np.eye(4), "truth.json").poses.shape
    (2, 4, 4)
    """
    others = data.get("symmetric_truths") or []
    if not isinstance(others, list):
        raise InputError(f"{name}: symmetric_truths must be a list of 4x4 poses; got {type(others).__name__}")
    checked = [as_pose(item, f"{name}: symmetric_truths[{i}]") for i, item in enumerate(others)]
    poses = [first, *(T for T in checked if not np.array_equal(T, first))]
    axis = data.get("symmetry_axis")
    if axis is None:
        return Truth(np.stack(poses))
    if not isinstance(axis, dict) or not {"point", "direction"} <= set(axis):
        raise InputError(f"{name}: symmetry_axis must have the keys point and direction; got {axis!r:.80}")
    rows = as_float([axis["point"], axis["direction"]], f"{name}: symmetry_axis")
    if rows.shape != (2, 3) or not np.linalg.norm(rows[1]) > 0.0:
        raise InputError(
            f"{name}: symmetry_axis must hold a point and a direction that is not zero, three numbers each"
        )
    return Truth(np.stack(poses), rows)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot read {path}: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected a JSON object with the key {POSE!r}; got {type(data).__name__}")
    return data


def _read_text(path: Path) -> FloatArray:
    try:
        # Some programs write poses with commas.
        text = path.read_text(encoding="utf-8").replace(",", " ")
        if not text.strip():
            raise ValueError("it is empty")
        return np.loadtxt(text.splitlines(), ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: not a 4x4 pose of plain numbers ({error})") from error


def _with_nan(rows: Any) -> Any:
    if not isinstance(rows, list):
        return rows
    return [_with_nan(row) if isinstance(row, list) else (np.nan if row is None else row) for row in rows]


def _matrix(rows: Any, path: Path) -> FloatArray:
    try:
        T = as_float(rows, str(path))
    except InputError as error:
        raise InputError(f"{path}: {POSE} must be 4x4 numbers ({error})") from error
    if T.shape == (3, 4):
        T = np.vstack([T, [0.0, 0.0, 0.0, 1.0]])
    if T.shape != (4, 4):
        raise InputError(f"{path}: a pose is 4x4 numbers; got shape {T.shape}")
    return T
