"""A target prepared once, to register many scans to it."""

from __future__ import annotations

import dataclasses
import threading
import time
from pathlib import Path
from typing import Any, Unpack

from dqreg._arrays import FloatArray, renamed
from dqreg.registration.options.options import RegisterOptions
from dqreg.registration.problem.target_file import bytes_of, load_target, save_target
from dqreg.registration.problem.target_index import TargetIndex, index_target
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.search import PairTable


@dataclasses.dataclass(frozen=True, eq=False)
class Target:
    """A target prepared once and registered to often; safe to share between threads.

    Made by `prepare_target`, or read by `Target.load`; files that cannot be read or written are an `InputError`.

    Attributes
    ----------
    indexed : TargetIndex
        Geometry in a frame of its own, and its surface.
    seconds : float
        Time that preparing it, or loading it, took.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import bracket
    >>> part = Mesh(*bracket())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     prepare_target(part).save(f"{folder}/part.npz")
    ...     target = Target.load(f"{folder}/part.npz")
    >>> target.build_beside().join()  # beside what the caller does meanwhile
    >>> found = target.register(Mesh(part.vertices + [0.5, 0, 0], part.faces), "identity", effort="fast")
    >>> (found.T_target_source[:3, 3].round(6) + 0.0).tolist()
    [-0.5, 0.0, 0.0]
    """

    indexed: TargetIndex
    seconds: float = dataclasses.field(default=0.0, compare=False)

    def __repr__(self) -> str:
        return f"Target({self.indexed.name}, a {self.indexed.kind}, diagonal={self.indexed.surface.diagonal:.4g})"

    @property
    def pairs(self) -> PairTable:
        """Pairs of oriented points that the global search looks up; built when first needed."""
        return self.indexed.pairs

    @property
    def flips(self) -> FloatArray:
        """Rotations that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        return self.indexed.near_rotations

    @property
    def mirrors(self) -> FloatArray:
        """Reflections that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        return self.indexed.near_reflections

    def build_beside(self) -> threading.Thread:
        """Begin to build what a registration to a mesh asks for, in a thread of its own.

        Returns
        -------
        threading.Thread
            Running; to be joined before the rest is asked for.
        """
        return self.indexed.build_beside()

    @property
    def nbytes(self) -> int:
        """Memory in bytes: its arrays, its trees, and an estimate of what Open3D holds, good to a fifth."""
        return bytes_of(self.indexed)

    def save(self, path: str | Path) -> None:
        """Write it to a file, to be read by `Target.load`: arrays and a JSON header in an NPZ archive, no pickle.

        Parameters
        ----------
        path : str or Path
            File to write, as it is named.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        save_target(self.indexed, path)

    @staticmethod
    def load(path: str | Path) -> Target:
        """Prepared target from its NPZ archive; registrations to it give the same poses as to the one saved.

        Parameters
        ----------
        path : str or Path
            What `save` of the same version wrote.

        Returns
        -------
        Target
            Ready, with the trees built again.

        Raises
        ------
        InputError
            If the file cannot be read, is damaged, or was written by another version.
        """
        began = time.perf_counter()
        return Target(load_target(path).build(), time.perf_counter() - began)

    def register(
        self,
        scan: Any,
        start: Any = None,
        *,
        time_limit: float | None = None,
        max_time: float | None = None,
        **options: Unpack[RegisterOptions],
    ) -> Registration:
        """Register a scan to this target; see `register` for the options.

        Parameters
        ----------
        scan : path, array or object
            Source.
        start : None, "identity" or (4, 4) array_like
            Initial pose. In tracking, the last pose: one that explains the scan at once spares the coarse steps.
        time_limit : float, optional
            Seconds after which the best pose so far is returned.
        max_time : float, optional
            Old name of ``time_limit``, deprecated.
        **options
            Keyword options of `register`.

        Returns
        -------
        Registration
            The answer.

        Raises
        ------
        InputError
            If the scan or an option cannot be used.
        DegenerateGeometryError
            If all points of the scan lie on a line.
        UnitsError
            If the sizes look like a mistake of units.
        """
        time_limit = renamed("max_time", max_time, "time_limit", time_limit, None)
        return register(scan, self, start, time_limit=time_limit, **options)


def prepare_target(target: Any) -> Target:
    """Read a target and build its trees, to register many scans to it.

    Parameters
    ----------
    target : path, array, (vertices, faces), PointCloud, Mesh or object of another library
        The mesh or cloud.

    Returns
    -------
    Target
        Pass it to `register` as the target, or call its own ``register``.

    Raises
    ------
    InputError
        If it cannot be read, or is no mesh and no cloud.
    DegenerateGeometryError
        If all of its points lie on a line.

    Examples
    --------
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import bracket
    >>> prepare_target(Mesh(*bracket())).indexed.kind
    'mesh'
    """
    began = time.perf_counter()
    return Target(index_target(target).build(), time.perf_counter() - began)
