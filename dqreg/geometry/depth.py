"""Depth images to points and normals.

A plane ``n . p = 1`` seen by a pinhole camera has an inverse depth that is linear in the pixel: with ``p = z r`` and
the ray ``r = ((u - cx)/fx, (v - cy)/fy, 1)``, ``1/z = n . r``. So normals come from a linear fit to the inverse depths
around each pixel, without any search for neighbours, and exactly where the surface is flat.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import FloatArray, IntArray, as_float
from dqreg.errors import InputError, UnitsError

# Pixels to each side that a fit may use.
WINDOW_PIXELS = 3
# Change of depth, relative and a pixel, beyond which the neighbour is on another surface: a plane seen at 85 degrees
# by a camera of 600 pixels focal length changes by 0.02.
JUMP_PER_PIXEL = 0.02
# Metres within which a depth camera sees a twentieth of what it sees: numbers beyond it are of another unit.
MAX_NEAR_DEPTH_M, NEAR_SHARE = 100.0, 0.05
# What cameras write for no depth in 16 bits, also after a conversion to a wider type.
NO_DEPTH = 65_535
# Neighbours, the pixel itself included, without which no plane is fitted.
MIN_PLANE_PIXELS = 6


@dataclasses.dataclass(frozen=True)
class DepthPoints:
    """What a depth image holds."""

    points: FloatArray  # (n, 3): In the camera's frame: x right, y down, z forward
    normals: FloatArray | None  # (n, 3): Unit normals towards the camera
    pixels: IntArray  # (n, 2): Row and column of each point
    dropped: int  # Pixels left out: without depth, beyond the limit, or without a plane where normals are asked for


def depth_points(
    depth: Any,
    intrinsics: Any,
    *,
    depth_scale: float | None = None,
    depth_trunc: float | None = None,
    stride: int = 1,
    normals: bool = True,
    metres: bool = False,
) -> DepthPoints:
    """Points, and normals from the grid, of a depth image; ``metres``: whether its numbers by the scale are said to be.

    Shapes: depth (h, w), intrinsics (3, 3).
    """
    image = _image_of(depth)
    fx, fy, cx, cy = _camera(intrinsics)
    scale = (1000.0 if image.dtype.kind in "iu" else 1.0) if depth_scale is None else float(depth_scale)
    if (
        not 0.0 < scale < np.inf
        or not (depth_trunc is None or depth_trunc > 0.0)
        or int(stride) != stride
        or stride < 1
    ):
        raise InputError(
            "depth_scale and depth_trunc must be above 0 and stride a whole number of at least 1; got "
            f"{depth_scale!r}, {depth_trunc!r} and {stride!r}"
        )
    z = as_float(image, "depth") / scale
    valid = np.isfinite(z) & (z > 0.0) & (z <= (np.inf if depth_trunc is None else depth_trunc))
    valid &= image != NO_DEPTH
    if image.dtype.kind == "u":
        valid &= image != np.iinfo(image.dtype).max
    if metres and depth_scale is None and image.dtype.kind == "f":
        _require_metres(z[valid])
    chosen = np.zeros_like(valid)
    chosen[:: int(stride), :: int(stride)] = True
    rows, columns = np.nonzero(valid & chosen)
    planes = None
    if normals:
        inverse = np.divide(1.0, z, out=np.zeros_like(z), where=valid)
        planes = _planes(inverse, rows, columns, (fx, fy, cx, cy))
        fitted = np.isfinite(planes).all(axis=1)
        rows, columns, planes = rows[fitted], columns[fitted], planes[fitted]
    near = z[rows, columns]
    points = np.column_stack([(columns - cx) / fx * near, (rows - cy) / fy * near, near])
    dropped = int(chosen.sum()) - len(rows)
    if not len(points):
        raise InputError(f"none of the {dropped} pixels of the depth image can be used; is it the depth image?")
    return DepthPoints(points, planes, np.column_stack([rows, columns]), dropped)


def _image_of(depth: Any) -> NDArray[Any]:
    try:
        image = np.asarray(depth)
    except ValueError as error:
        raise InputError(f"depth must have rows of one length ({error})") from error
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim != 2 or not image.size:
        raise InputError(f"a depth image must have shape (height, width); got {image.shape}")
    if image.dtype.kind == "b":
        raise InputError("a depth image must hold depths; got truth values, as a mask does: np.where(mask, depth, 0)")
    return image


def _require_metres(depths: FloatArray) -> None:
    if len(depths) and np.quantile(depths, NEAR_SHARE) > MAX_NEAR_DEPTH_M:
        raise UnitsError(
            f"a depth image of {depths.min():.4g} to {depths.max():.4g} would be as many metres, as floats are; "
            "they look like millimetres. Say depth_scale=1000, or depth_scale=1 if they are metres"
        )


def _camera(intrinsics: Any) -> tuple[float, float, float, float]:
    matrix = as_float(getattr(intrinsics, "intrinsic_matrix", intrinsics), "intrinsics")
    if matrix.shape == (3, 3):
        if np.abs(matrix[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] - [0.0, 0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
            raise InputError(f"intrinsics must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; got {matrix.tolist()}")
        matrix = matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    if matrix.shape != (4,) or not np.isfinite(matrix).all() or not (matrix[:2] > 0.0).all():
        raise InputError(
            f"intrinsics must be a 3x3 matrix or (fx, fy, cx, cy) with focal lengths above 0; got {matrix.tolist()}"
        )
    fx, fy, cx, cy = matrix.tolist()
    return fx, fy, cx, cy


def _planes(
    inverse: FloatArray, rows: IntArray, columns: IntArray, camera: tuple[float, float, float, float]
) -> FloatArray:
    """Unit normals towards the camera at the given pixels, (n, 3); NaN where no plane can be fitted."""
    padded = np.pad(inverse, WINDOW_PIXELS)
    middle = inverse[rows, columns]
    # Normal equations of change = a du + b dv + c over the neighbours on the same surface.
    sums = np.zeros((9, len(rows)))
    for dv in range(-WINDOW_PIXELS, WINDOW_PIXELS + 1):
        for du in range(-WINDOW_PIXELS, WINDOW_PIXELS + 1):
            change = padded[rows + (WINDOW_PIXELS + dv), columns + (WINDOW_PIXELS + du)] - middle
            limit = JUMP_PER_PIXEL * max(abs(du), abs(dv), 1)
            weight = (np.abs(change) <= limit * middle).astype(np.float64)
            change *= weight
            for k, factor in enumerate((1, du, dv, du * du, du * dv, dv * dv)):
                if factor:
                    sums[k] += factor * weight
            for k, factor in enumerate((1, du, dv), start=6):
                if factor:
                    sums[k] += factor * change
    n, u, v, uu, uv, vv, q, uq, vq = sums
    with np.errstate(divide="ignore", invalid="ignore"):
        # About the neighbours' mean the third unknown falls out.
        uu, uv, vv = uu - u * u / n, uv - u * v / n, vv - v * v / n
        uq, vq = uq - u * q / n, vq - v * q / n
        determinant = uu * vv - uv * uv
        a, b = (vv * uq - uv * vq) / determinant, (uu * vq - uv * uq) / determinant
        c = middle + (q - a * u - b * v) / n
        fx, fy, cx, cy = camera
        normals = -np.column_stack([a * fx, b * fy, c - a * (columns - cx) - b * (rows - cy)])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[(n < MIN_PLANE_PIXELS) | ~(determinant > 0.5)] = np.nan
    return normals
