"""Virtual scanner: pinhole views of a mesh, with the range noise, losses and strays of a real one."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg.arrays import BoolArray, FloatArray, IntArray, as_pose
from dqreg.errors import InputError
from dqreg.rigid import pose
from dqreg.synth.noise import Noise
from dqreg.synth.raycast import centre_and_diagonal, check_mesh, face_normals, first_hits
from dqreg.synth.views import Scanner


@dataclass(frozen=True, eq=False)
class Scan:
    """Points of a virtual scan with all that is known about them.

    Attributes
    ----------
    points : ndarray, (n, 3)
        Measured points.
    ray_directions : ndarray, (n, 3)
        Unit vector of each ray, **from the sensor to the point**. Range noise lies along it.
    normals : ndarray, (n, 3)
        True unit normal of the face that was hit, out of the part; NaN for an outlier.
    view_index : ndarray, (n,)
        Which view saw the point; indexes ``sensor_positions``.
    sensor_positions : ndarray, (k, 3)
        Pinhole of each view.
    is_outlier : ndarray, (n,)
        True for strays and mixed pixels.
    face_index : ndarray, (n,)
        Face of the mesh that was hit; -1 for an outlier.
    range_sigma : ndarray, (n,)
        Standard deviation of the range noise of each point; NaN for an outlier.
    """

    points: FloatArray
    ray_directions: FloatArray
    normals: FloatArray
    view_index: IntArray
    sensor_positions: FloatArray
    is_outlier: BoolArray
    face_index: IntArray
    range_sigma: FloatArray

    def moved(self, T_new_old: ArrayLike) -> Scan:
        """Return the same scan in another frame.

        Parameters
        ----------
        T_new_old : array_like, (4, 4)
            Rigid pose that maps present coordinates to new ones.

        Returns
        -------
        Scan
            Points, sensors, rays and normals in the new frame.

        Raises
        ------
        InputError
            If the pose is not rigid.

        Examples
        --------
        >>> from dqreg.synth.parts import box
        >>> scan = scan_mesh(*box(), Scanner(views=((0, 0, 1),), pixels=8), rng=np.random.default_rng(0))
        >>> T = np.eye(4); T[:3, 3] = [0, 0, 10]
        >>> float(scan.moved(T).points[:, 2].min())
        10.5
        """
        T = as_pose(T_new_old, "T_new_old")
        return dataclasses.replace(
            self,
            points=pose.apply(T, self.points),
            ray_directions=pose.rotate(T, self.ray_directions),
            normals=pose.rotate(T, self.normals),
            sensor_positions=pose.apply(T, self.sensor_positions),
        )


def scan_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    scanner: Scanner,
    noise: Noise | None = None,
    *,
    rng: np.random.Generator,
) -> Scan:
    """Scan a mesh from all views of a scanner.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Mesh vertices; their bounding box gives the part's centre and diagonal.
    faces : array_like, (f, 3)
        Vertex indices, outward normals by the right-hand rule.
    scanner : Scanner
        Where it is seen from and how finely.
    noise : Noise, optional
        What goes wrong; nothing by default, and then every point lies on the mesh to 1e-12 of its size.
    rng : numpy.random.Generator
        Source of all randomness.

    Returns
    -------
    Scan
        In the part's frame and unit, ordered by view and pixel.

    Raises
    ------
    InputError
        If the mesh is malformed or no ray brings a point back.
    MissingDependencyError
        If Open3D cannot be loaded.

    Notes
    -----
    Same mesh, scanner, noise and generator state: same bytes. All random numbers are drawn for every pixel,
    hit or not, so a ray that just misses an edge on another machine changes no other point. A ray that meets
    a face from behind first (a mesh with holes) brings nothing back.

    Examples
    --------
    >>> from dqreg.synth.parts import box
    >>> scan = scan_mesh(*box(), Scanner(views=((0, 0, 1),), pixels=8), rng=np.random.default_rng(0))
    >>> scan.points[:, 2].tolist() == [0.5] * len(scan.points)
    True
    """
    V, F = check_mesh(vertices, faces)
    centre, diagonal = centre_and_diagonal(V)
    rays = scanner.ray_directions()
    image, rays = rays.shape[:-1], rays.reshape(-1, 3)
    sensors = scanner.sensor_positions(centre, diagonal)
    view_index = np.repeat(np.arange(len(sensors)), scanner.pixels**2)
    origins = sensors[view_index]

    face_index, points = first_hits(V, F, origins, rays)
    ranges = np.linalg.norm(points - origins, axis=1)
    rays = _unit(points - origins)  # where a point was clipped to its face, the ray that goes there
    normals = face_normals(V, F)[face_index]
    cosines = -np.einsum("ni,ni->n", rays, normals)
    errors = (noise or Noise()).draw(ranges.reshape(image), cosines.reshape(image), diagonal, rng)

    strays = errors.is_stray[:, None]
    points = points + errors.range_error[:, None] * rays
    points = np.where(strays, centre + errors.in_box * np.ptp(V, axis=0), points)
    rays = np.where(strays, _unit(points - origins), rays)
    is_outlier, kept = errors.is_stray | errors.is_mixed, errors.is_kept
    if not kept.any():
        raise InputError("no ray brought a point back; check views, field_of_view_rad and max_incidence_rad")
    return Scan(
        points=points[kept],
        ray_directions=rays[kept],
        normals=np.where(is_outlier[:, None], np.nan, normals)[kept],
        view_index=view_index[kept],
        sensor_positions=sensors,
        is_outlier=is_outlier[kept],
        face_index=np.where(is_outlier, -1, face_index)[kept],
        range_sigma=np.where(is_outlier, np.nan, errors.sigma)[kept],
    )


def _unit(vectors: FloatArray) -> FloatArray:
    directions: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return directions
