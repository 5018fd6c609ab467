"""The answer of a multiway registration: poses, covariances, edges and verdict; saved, loaded, exported."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import lock, one_line
from dqreg.errors import InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.trajectories import form_by_name
from dqreg.geometry import PointCloud
from dqreg.multiway import exports, result_json
from dqreg.multiway.loop_errors import LoopError
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans import merge
from dqreg.multiway.scans.scans import View
from dqreg.trust.records import Verdict


@dataclasses.dataclass(frozen=True, eq=False)
class Multiway:
    """Result of registering many scans to each other.

    Attributes
    ----------
    T_world_scan : ndarray, (n, 4, 4)
        Maps each scan's coordinates to the world frame; NaN where a scan is not connected to the others.
    verdict : Verdict
        Accepted only if every scan is placed by edges to be believed, and loops close.
    edges : tuple of Edge
        All pairs that were registered, with what came of them.
    loop_errors : tuple of LoopError
        Of all loops of three edges, the worst of the used ones first.
    overlap : ndarray, (n, n)
        Fraction of the smaller scan of two that lies where the other does; NaN where one is not placed.
    centre : ndarray, (3,)
        Middle of the placed scans, world frame: what `covariances` are about.
    joint : ndarray, (6 n, 6 n)
        Covariance of all poses together; see `joint_covariance`.
    names : tuple of str
        Names of the scans.
    settings : dict
        What was asked, and lengths as resolved.
    timings : dict
        Seconds per stage.
    views : tuple of View or None
        The scans themselves, for `merged` and the report; not saved.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.geometry import Mesh, sample_mesh
    >>> from dqreg.multiway import register_many
    >>> from dqreg.synth.parts import bracket
    >>> part, rng = Mesh(*bracket()), np.random.default_rng(0)
    >>> scans = [sample_mesh(part, 800, rng) for _ in range(2)]
    >>> result = register_many(scans, target=part, starts=[np.eye(4)] * 2, effort="fast", workers=1)
    >>> result.placed, len(result.merged(voxel=0).points), result.joint_covariance(0, 1).shape
    ((0, 1), 1600, (12, 12))
    >>> result.factors().sources.tolist()  # of the pairs (part, 0), (part, 1) and (0, 1)
    [0, 1, 1]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result.save(f"{folder}/scans.json")
    ...     loaded = Multiway.load(f"{folder}/scans.json")
    ...     result.report(f"{folder}/scans.html").name
    'scans.html'
    >>> loaded.to_dict() == result.to_dict(), len(loaded.attached(scans).merged(voxel=0).points)
    (True, 1600)
    """

    __repr__ = one_line
    T_world_scan: FloatArray
    verdict: Verdict
    edges: tuple[Edge, ...]
    loop_errors: tuple[LoopError, ...]
    overlap: FloatArray
    centre: FloatArray
    joint: FloatArray
    names: tuple[str, ...]
    settings: dict[str, Any]
    timings: dict[str, float]
    views: tuple[View, ...] | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        lock(self)

    @property
    def covariances(self) -> FloatArray:
        """Covariance of each pose, (n, 6, 6); zero for the anchor, NaN where not placed and along free motions.

        Of the twist (rotation vector, then translation) of a left increment in the world frame about ``centre``:
        ``T_true = about(exp(twist), centre) @ T_world_scan``.
        """
        blocks = self.joint.reshape(len(self.names), 6, len(self.names), 6)
        return np.array(np.einsum("kikj->kij", blocks))

    def joint_covariance(self, i: int, j: int) -> FloatArray:
        """Covariance of two poses together, in the frame of `covariances`.

        Parameters
        ----------
        i, j : int
            Numbers of the scans.

        Returns
        -------
        ndarray, (12, 12)
            Twist of scan i, then of scan j.

        Raises
        ------
        InputError
            If there are no such scans.
        """
        count = len(self.T_world_scan)
        if not (0 <= i < count and 0 <= j < count):
            raise InputError(f"i and j must be numbers of scans, 0 to {count - 1}; got {i} and {j}")
        rows = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        return np.array(self.joint[np.ix_(rows, rows)])

    @property
    def placed(self) -> tuple[int, ...]:
        """Numbers of the scans that have a pose."""
        return tuple(np.flatnonzero(np.isfinite(self.T_world_scan).all(axis=(1, 2))).tolist())

    def merged(self, voxel: float | None = None) -> PointCloud:
        """One cloud of all placed scans: means of the faces in each cell, points weighted by one over their variance.

        Points where other scanners looked through, and no other scan has one, are left out. The two sides of a sheet
        stay apart where it is known from which side each scan was taken.

        Parameters
        ----------
        voxel : float, optional
            Edge of the cells. Default: the median spacing of the scans; 0 keeps all points as they are.

        Returns
        -------
        PointCloud
            World frame. With unit normals where it is known on which side of each placed scan the outside is: from
            normals that the scans hold, from their viewpoints, or from the line of sight that was found for all.

        Raises
        ------
        InputError
            If the result holds no scans (`attached` brings them back), none was placed, or the voxel is negative.
        """
        return self._merged(voxel)[0]

    def _merged(self, voxel: float | None) -> tuple[PointCloud, int]:
        """The same, and how many points were left out."""
        return merge.fused(self._views(), self.T_world_scan, voxel, self.settings.get("viewpoints"))

    def _views(self) -> tuple[View, ...]:
        if self.views is None:
            raise InputError("this result was loaded and does not hold the scans; call result.attached(scans) first")
        return self.views

    def attached(self, scans: Sequence[Any]) -> Multiway:
        """The same result with the scans at hand again, as after `load`.

        Parameters
        ----------
        scans : sequence of path, array or object
            What was registered, in the same order.

        Returns
        -------
        Multiway
            With ``views``.

        Raises
        ------
        InputError
            If a scan cannot be read, or there are more or fewer than were registered.
        """
        from dqreg.multiway.scans.scans import read_views

        views = read_views(scans, int(self.settings.get("seed", 0)), self.settings.get("viewpoints"))
        if len(views) != len(self.names):
            raise InputError(f"this result is of {len(self.names)} scans; got {len(views)}")
        return dataclasses.replace(self, views=views)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings under the attribute names; NaN and infinity become None.

        Returns
        -------
        dict
            What `save` writes.
        """
        return result_json.to_plain(self)

    def save(self, path: str | Path) -> None:
        """Write the result, whole or not at all; the name says as what.

        A pose graph for .g2o, a trajectory for .txt or .kitti (KITTI) and .tum or _tum.txt (TUM), else JSON, which has
        everything. Of a scan that is not placed KITTI has a line of NaN, which `dqreg.odometry.read_trajectory` reads
        with ``gaps="keep"``; TUM, whose times are the numbers of the scans, has no line.

        Parameters
        ----------
        path : str or Path
            File to write.

        Raises
        ------
        InputError
            If the file cannot be written, or a trajectory is asked for and no scan was placed.
        """
        suffix = Path(path).suffix.lower()
        if suffix == ".g2o":
            write_atomically(path, exports.to_pose_graph(self.T_world_scan, self.edges, int(self.settings["anchor"])))
        elif suffix in (".tum", ".txt", ".kitti"):
            write_atomically(path, exports.to_trajectory(self.T_world_scan, form_by_name(path)))
        else:
            write_atomically(path, result_json.as_text(self))

    @staticmethod
    def load(path: str | Path) -> Multiway:
        """Poses, edges and verdict of a multiway registration from its JSON file; g2o, KITTI and TUM hold poses alone.

        Parameters
        ----------
        path : str or Path
            What `save` or ``dqreg multiway`` wrote as JSON.

        Returns
        -------
        Multiway
            Equal to the saved one, without the scans: `attached` brings them back.

        Raises
        ------
        InputError
            If there is no such file, its JSON is of no multiway result, or an edge or a pose in it is none.
        """
        return Multiway(**result_json.read_fields(path, LoopError))

    def factors(self) -> exports.Factors:
        """The used edges as arrays in GTSAM's order: BetweenFactorPose3(target, source, pose, covariance).

        Returns
        -------
        Factors
            Poses and covariances of the pairs, rotation first, right increments in the source's frame.
        """
        return exports.factors_of(self.edges, len(self.names))

    def report(self, path: str | Path) -> Path:
        """Write a report to be judged by eye: one HTML file that opens anywhere and loads nothing.

        Parameters
        ----------
        path : str or Path
            The file.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            If the file cannot be written, or its name does not end in .html or .pdf.
        """
        from dqreg.multiway.report.page import write_report

        return write_report(self, path)
