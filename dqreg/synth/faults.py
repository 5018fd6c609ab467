"""Faults of a part that are known because they were made: waves on a face, a feature that is moved or of another size.

They change the points of a scan, not the mesh: what is wrong is known to the last digit, and no facet is in between.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, as_float, as_pose, require_finite
from dqreg._numbers import is_whole
from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.scan import Scan


def form_error(
    scan: Scan,
    mesh: Mesh,
    triangles: ArrayLike,
    amplitude: float,
    *,
    waves: int = 2,
    direction: ArrayLike | None = None,
    axis: tuple[ArrayLike, ArrayLike] | None = None,
) -> Scan:
    """Return the scan of a part with waves on a face: a cosine along its normal, from crest to trough ``amplitude``.

    The form error of the face is the amplitude, exactly: crests and troughs alternate more often than a shape of the
    face's kind can follow. With an axis the waves run around it (lobes) and the points are put on the true cylinder
    through the mesh's vertices first, so that its facets are no form error.

    Parameters
    ----------
    scan : Scan
        In the part's frame.
    mesh : (vertices (v, 3), faces (f, 3))
        What was scanned.
    triangles : array_like of int, (k,)
        Faces of the mesh that the waves are on.
    amplitude : float
        Form error, a length, not negative.
    waves : int
        Periods along the face or around the axis, at least 2.
    direction : array_like, (3,), optional
        Direction of the waves on a flat face. Default: its longest extent.
    axis : (point (3,), direction (3,)), optional
        Of a round face.

    Returns
    -------
    Scan
        With the points of those triangles moved.

    Raises
    ------
    InputError
        If a number cannot be, or the scan has no points on the face.

    Examples
    --------
    >>> from dqreg.synth import Scanner, scan_mesh
    >>> from dqreg.synth.parts import box
    >>> part = box()
    >>> scan = scan_mesh(*part, Scanner(views=((0, 0, 1),), pixels=64), rng=np.random.default_rng(0))
    >>> top = np.flatnonzero((part[0][part[1]][:, :, 2] > 0.4).all(axis=1))
    >>> wavy = form_error(scan, part, top, 0.02)
    >>> round(float(np.ptp(wavy.points[:, 2])), 3)
    0.02
    """
    if not is_whole(waves) or waves < 2:
        raise InputError(f"waves must be a whole number from 2 on: one wave is a tilt or a shift; got {waves!r}")
    if not 0.0 <= amplitude < np.inf:
        raise InputError(f"amplitude must be a length that is not negative; got {amplitude!r}")
    rows, corners = _on(scan, mesh, triangles)
    points, normals = scan.points.copy(), scan.normals.copy()
    if axis is None:
        if direction is None:
            direction = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2][0]
        along = as_float(direction, "direction")
        require_finite(along, "direction")
        low, high = float((corners @ along).min()), float((corners @ along).max())
        phase = 2.0 * np.pi * waves * (points[rows] @ along - low) / max(high - low, np.finfo(float).tiny)
    else:
        points[rows], normals[rows], turn = _rounded(scan, mesh, rows, corners, axis)
        phase = waves * turn
    points[rows] += 0.5 * amplitude * np.cos(phase)[:, None] * normals[rows]
    return dataclasses.replace(scan, points=points, normals=normals)


def moved_feature(
    scan: Scan,
    mesh: Mesh,
    triangles: ArrayLike,
    T_moved_nominal: ArrayLike | None = None,
    *,
    larger: float = 0.0,
    axis: tuple[ArrayLike, ArrayLike] | None = None,
) -> Scan:
    """Return the scan of a part with a feature at another place, tilted, or of another size.

    Parameters
    ----------
    scan : Scan
        In the part's frame.
    mesh : (vertices (v, 3), faces (f, 3))
        What was scanned.
    triangles : array_like of int, (k,)
        Faces of the mesh that make the feature.
    T_moved_nominal : array_like, (4, 4), optional
        Rigid motion of the feature in the part's frame. Default: none.
    larger : float
        By how much its radius is larger, where it has an axis; a flat feature is that much higher along its normal.
    axis : (point (3,), direction (3,)), optional
        Of a round feature: its points are put on the true cylinder through the mesh's vertices first.

    Returns
    -------
    Scan
        With the points and normals of those triangles moved; what else the feature would hide or show is not looked at.

    Raises
    ------
    InputError
        If the pose is not rigid, or the scan has no points on the feature.

    Examples
    --------
    >>> from dqreg.synth import Scanner, scan_mesh
    >>> from dqreg.synth.parts import box
    >>> part = box()
    >>> scan = scan_mesh(*part, Scanner(views=((0, 0, 1),), pixels=16), rng=np.random.default_rng(0))
    >>> top = np.flatnonzero((part[0][part[1]][:, :, 2] > 0.4).all(axis=1))
    >>> set(moved_feature(scan, part, top, larger=0.25).points[:, 2].tolist())
    {0.75}
    """
    T = np.eye(4) if T_moved_nominal is None else as_pose(T_moved_nominal, "T_moved_nominal")
    rows, corners = _on(scan, mesh, triangles)
    points, normals = scan.points.copy(), scan.normals.copy()
    outward = normals[rows]
    if axis is not None:
        points[rows], normals[rows], _ = _rounded(scan, mesh, rows, corners, axis)
        offsets = points[rows] - as_float(axis[0], "axis")
        along = as_float(axis[1], "axis") / np.linalg.norm(as_float(axis[1], "axis"))
        offsets = offsets - (offsets @ along)[:, None] * along
        outward = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    points[rows] = pose.apply(T, points[rows] + larger * outward)
    normals[rows] = pose.rotate(T, normals[rows])
    return dataclasses.replace(scan, points=points, normals=normals)


def _on(scan: Scan, mesh: Mesh, triangles: ArrayLike) -> tuple[BoolArray, FloatArray]:
    """Points of the scan on some triangles, and the corners of those."""
    chosen = np.asarray(triangles)
    vertices, faces = mesh
    if chosen.dtype.kind not in "iu" or not len(chosen) or not 0 <= chosen.min() <= chosen.max() < len(faces):
        raise InputError(f"triangles must be numbers of the mesh's {len(faces)} faces; got {triangles!r:.80}")
    rows: BoolArray = scan.on_part & np.isin(scan.face_index, chosen)
    if not rows.any():
        raise InputError("the scan has no points on those triangles")
    return rows, vertices[np.unique(faces[chosen])]


def _rounded(
    scan: Scan, mesh: Mesh, rows: BoolArray, corners: FloatArray, axis: tuple[ArrayLike, ArrayLike]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points on the cylinder through the corners, its normals on the side of the given ones, angles about the axis.

    Each moves along its radius by what its facet is inside of the cylinder there: noise stays as it is.
    """
    centre, along = as_float(axis[0], "axis"), as_float(axis[1], "axis")
    along = along / np.linalg.norm(along)
    points, normals = scan.points[rows], scan.normals[rows]
    heights = (points - centre) @ along
    offsets = points - centre - heights[:, None] * along
    outward = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    arms = corners - centre
    radius = float(np.median(np.linalg.norm(arms - (arms @ along)[:, None] * along, axis=1)))
    side = np.sign(np.einsum("ij,ij->i", outward, normals))[:, None]
    # Where the radius through the point meets the plane of its facet.
    base = mesh[0][mesh[1][scan.face_index[rows], 0]] - centre - heights[:, None] * along
    facet = np.einsum("ij,ij->i", base, normals) / np.einsum("ij,ij->i", outward, normals)
    across = np.linalg.svd(along[None, :])[2][1:]
    turn = np.arctan2(outward @ across[1], outward @ across[0])
    return points + (radius - facet)[:, None] * outward, side * outward, turn
