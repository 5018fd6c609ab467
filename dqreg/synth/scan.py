"""Points of a virtual scan with all that is known about them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import BoolArray, FloatArray, IntArray, as_pose
from dqreg.rigid import pose
from dqreg.synth.motion import moved_each, poses_at, turned_each


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
        True unit normal of the face that was hit, out of the material; NaN for an outlier.
    view_index : ndarray, (n,)
        Which view saw the point; indexes ``sensor_positions``.
    sensor_positions : ndarray, (k, 3)
        Sensor of each view; of a tactile probe the start of each stroke.
    is_outlier : ndarray, (n,)
        True for outliers and mixed pixels.
    on_part : ndarray, (n,)
        True for points of the part: neither outliers nor points of its surroundings.
    face_index : ndarray, (n,)
        Face of the part's mesh that was hit; -1 for a point that is not on the part.
    range_sigma : ndarray, (n,)
        Standard deviation of the range noise of each point; NaN for an outlier.
    total_sigma : ndarray, (n,)
        Standard deviation along the ray that takes a point as far off its face as range noise and lateral noise do
        together; NaN for an outlier.
    times : ndarray, (n,)
        When each point was read, in sweeps: 0 at the start of the sweep, 1 at its end.
    """

    points: FloatArray
    ray_directions: FloatArray
    normals: FloatArray
    view_index: IntArray
    sensor_positions: FloatArray
    is_outlier: BoolArray
    on_part: BoolArray
    face_index: IntArray
    range_sigma: FloatArray
    total_sigma: FloatArray
    times: FloatArray

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
        >>> from dqreg.synth import Scanner, scan_mesh
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

    def undone(self, twist: ArrayLike, reference: float) -> Scan:
        """Return the scan with a known motion taken out.

        Parameters
        ----------
        twist : array_like, (6,)
            Rotation first, then translation, per sweep, in the scan's frame.
        reference : float
            Time to which the points are put back, in sweeps.

        Returns
        -------
        Scan
            Points, rays and normals as of a scene at rest, ``exp((reference - time) twist) p``. The sensors stay:
            no one place is where all rays of a view begin any more.

        Raises
        ------
        InputError
            If the twist does not hold six numbers.

        Examples
        --------
        >>> from dqreg.synth import Motion, Scanner, scan_mesh
        >>> from dqreg.synth.parts import box
        >>> scanner, motion = Scanner(views=((0, 0, 1),), pixels=8), Motion(shift=(0.0, 0.0, 0.1))
        >>> scan = scan_mesh(*box(), scanner, rng=np.random.default_rng(0), motion=motion)
        >>> still = scan.undone(motion.twist(np.zeros(3), 3**0.5), motion.reference)
        >>> float(abs(still.points[:, 2] - 0.5).max()) < 1e-12 < float(np.ptp(scan.points[:, 2]))
        True
        """
        T = poses_at(np.asarray(twist, dtype=np.float64), reference - self.times)
        return dataclasses.replace(
            self,
            points=moved_each(T, self.points),
            ray_directions=turned_each(T, self.ray_directions),
            normals=turned_each(T, self.normals),
        )
