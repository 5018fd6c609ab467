"""A target prepared once and registered to often."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg._arrays import FloatArray, renamed
from dqreg.geometry import Mesh
from dqreg.registration.target_file import bytes_of, load_target, save_target
from dqreg.registration.target_index import IndexedTarget, index_target
from dqreg.search import PairTable
from dqreg.search.flips import near_flips
from dqreg.search.mirrors import near_mirrors

if TYPE_CHECKING:
    from dqreg.registration.result import Registration


@dataclasses.dataclass(frozen=True)
class Target:
    """A target prepared once and registered to often; safe to share between threads.

    Made by `prepare_target`, or read by `Target.load`.

    Attributes
    ----------
    indexed : IndexedTarget
        Geometry in a frame of its own, and its surface.
    seconds : float
        Time that preparing it, or loading it, took.
    """

    indexed: IndexedTarget
    seconds: float = dataclasses.field(default=0.0, compare=False)

    @cached_property
    def pairs(self) -> PairTable:
        """What the search for a start looks up; built when first needed, the same whoever builds it."""
        return PairTable.of(self.indexed.geometry, self.indexed.surface)

    @cached_property
    def flips(self) -> FloatArray:
        """Turns that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        geometry = self.indexed.geometry
        return near_flips(geometry, self.indexed.surface) if isinstance(geometry, Mesh) else np.zeros((0, 4, 4))

    @cached_property
    def mirrors(self) -> FloatArray:
        """Mirrorings that leave most of the part in place, (k, 4, 4), in the centred frame; none for a cloud."""
        geometry = self.indexed.geometry
        return near_mirrors(geometry, self.indexed.surface) if isinstance(geometry, Mesh) else np.zeros((0, 4, 4))

    def build_beside(self) -> threading.Thread:
        """Begin to build what a registration to a mesh asks for, in a thread of its own; the same whoever builds it.

        Returns
        -------
        threading.Thread
            Running; to be joined before the rest is asked for.
        """
        thread = threading.Thread(target=self._build, daemon=True)
        thread.start()
        return thread

    def _build(self) -> None:
        # What fails here fails again where it is asked for, and there somebody hears of it.
        with contextlib.suppress(Exception):
            if isinstance(self.indexed.geometry, Mesh):
                self.indexed.build()
                _ = self.flips

    @property
    def nbytes(self) -> int:
        """Memory that it takes, in bytes: its arrays, and an estimate for Open3D's trees, good to a fifth."""
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
        """Read a target that `save` wrote; registrations to it give the same poses as to the one saved.

        Parameters
        ----------
        path : str or Path
            File to read.

        Returns
        -------
        Target
            Ready, with the trees built again.

        Raises
        ------
        InputError
            If the file is missing, damaged, or no prepared target.
        """
        began = time.perf_counter()
        return _built(load_target(path), began)

    def register(
        self,
        scan: Any,
        start: Any = None,
        *,
        time_limit: float | None = None,
        max_time: float | None = None,
        **options: Any,
    ) -> Registration:
        """Register a scan to this target; see `register` for the options.

        Parameters
        ----------
        scan : path, array or object
            Source.
        start : None, "identity" or (4, 4) array_like
            Where to begin. In tracking, the last pose: a start that explains the scan at once spares the coarse steps.
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
            If ``max_time`` and ``time_limit`` are both given, and where `register` does.
        """
        from dqreg.registration.register import register

        time_limit = renamed("max_time", max_time, "time_limit", time_limit, None)
        return register(scan, self, start, time_limit=time_limit, **options)


def prepare_target(target: Any) -> Target:
    """Read a target and build its trees, to register many scans to it.

    Parameters
    ----------
    target : path, array, PointCloud, Mesh, Open3D or trimesh object
        A mesh or a cloud.

    Returns
    -------
    Target
        Pass it to `register` as the target, or call its own ``register``.

    Raises
    ------
    InputError
        If it cannot be read or used.

    Examples
    --------
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.synth.parts import bracket
    >>> prepare_target(Mesh(*bracket())).indexed.kind
    'mesh'
    """
    began = time.perf_counter()
    return _built(index_target(target), began)


def _built(indexed: IndexedTarget, began: float) -> Target:
    indexed.build()
    prepared = Target(indexed)
    _ = prepared.flips
    object.__setattr__(prepared, "seconds", time.perf_counter() - began)
    return prepared
