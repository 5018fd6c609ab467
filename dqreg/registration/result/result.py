"""The answer of a registration: pose, verdict, and everything needed to judge it; saved and loaded as JSON."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import lock
from dqreg._statuses import Status
from dqreg.files.atomic import write_atomically
from dqreg.icp.history import Iteration
from dqreg.registration.problem.problem import SourceAndTarget
from dqreg.registration.result.invariants import as_failed, violated_invariant
from dqreg.registration.result.realignment import Alignment, after_alignment
from dqreg.registration.result.result_json import as_text, read_fields, to_plain
from dqreg.registration.result.result_views import ShownResult
from dqreg.registration.result.uncertain_pose import UncertainPose
from dqreg.trust.records import Alternative, Direction, Verdict

if TYPE_CHECKING:
    from dqreg.inspection import Deviations

__all__ = ["Alternative", "Direction", "Iteration", "Registration", "Verdict"]


@dataclasses.dataclass(frozen=True, eq=False)
class Registration(UncertainPose, ShownResult):
    """Result of registering a source to a target.

    However it was made, its pose is rigid to 1e-12, or all NaN with the verdict "failed"; its covariance is symmetric
    and positive semidefinite, or NaN. What would be neither becomes a failed result that says why. Methods raise
    `InputError` where they need a pose and none was found, and for files that cannot be read or written.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        Maps source coordinates, times `scale`, to target coordinates; all NaN where no pose was found.
    verdict : Verdict
        Level and reasons.
    status : str
        How the loop ended.
    covariance : ndarray, (6, 6)
        Of the twist (rotation vector first, then translation) of a left increment in the target frame about the
        centre of the target's bounding box (``settings["centre"]``): ``T_true = about(exp(twist), centre) @ T``.
        NaN along directions that the matches leave free, and everywhere where no pose was found.
    observability : tuple of Direction
        Six directions, the weakest first.
    alternatives : tuple of Alternative
        Other poses that explain the scan about as well.
    history : tuple of Iteration
        One record an iteration.
    rms : float
        Root mean square distance of the inliers, target units; NaN where there are none.
    inlier_fraction : float
        Mean probability of a source point to be an inlier, over all points used.
    timings : dict
        Seconds per stage; ``compile``, where kernels were compiled for the first time, is a part of the other ones.
    settings : dict
        Every setting as resolved, lengths in target units.
    inputs : SourceAndTarget or None
        Both sides, for deviations, pictures and reports; not saved, and None where ``keep_inputs=False`` asked so.
        `attached` brings them back.
    partial_information : ndarray, (6, 6), or None
        Inverse of the covariance where motions are free, 0 along those; None where none is. See `information`.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.geometry import Mesh
    >>> from dqreg.registration.register import register
    >>> from dqreg.synth.parts import bracket
    >>> part = Mesh(*bracket())
    >>> result = register(part, part, "identity", effort="fast")
    >>> result.verdict.level, result.observability[0].is_free
    ('accepted', False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result.save(f"{folder}/pose.json")
    ...     loaded = Registration.load(f"{folder}/pose.json")
    >>> loaded.inputs, loaded.to_dict() == result.to_dict(), loaded.attached(part, part).inputs is None
    (None, True, False)
    """

    T_target_source: FloatArray
    verdict: Verdict
    status: Status
    covariance: FloatArray
    observability: tuple[Direction, ...]
    alternatives: tuple[Alternative, ...]
    history: tuple[Iteration, ...]
    rms: float
    inlier_fraction: float
    timings: dict[str, float]
    settings: dict[str, Any]
    inputs: SourceAndTarget | None = dataclasses.field(default=None, repr=False)
    partial_information: FloatArray | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        violated = violated_invariant(vars(self))
        if violated:
            # It is still being built: a frozen value may be finished here, and nowhere later.
            for name, value in as_failed(vars(self), violated).items():
                object.__setattr__(self, name, value)
        lock(self)

    def __repr__(self) -> str:
        place = ", ".join(f"{value:.4g}" for value in self.T_target_source[:3, 3])
        facts = [self.verdict.level, f"translation=({place})", f"rms={self.rms:.4g}"]
        facts += [f"inlier_fraction={self.inlier_fraction:.3g}", f"{len(self.history)} iterations"]
        if "total" in self.timings:
            facts.append(f"{self.timings['total']:.3g} s")
        return f"Registration({', '.join(facts)}: {'; '.join(self.verdict.reasons[:1])})"

    def attached(self, source: Any, target: Any) -> Registration:
        """The same result with both sides at hand again, as after `load`.

        Parameters
        ----------
        source, target : path, array or object
            What was registered.

        Returns
        -------
        Registration
            With ``inputs``.

        Raises
        ------
        InputError
            If one of the two cannot be read.
        DegenerateGeometryError
            If all points of one lie on a line.
        """
        known = self.settings
        units = known.get("source_units"), known.get("target_units")
        inputs = SourceAndTarget.read(source, target, *units, known.get("seed", 0), known.get("scale", 1.0))
        viewpoints = known.get("viewpoint")
        if viewpoints is not None and np.isfinite(self.T_target_source).all():
            visible = inputs.visible_from(np.array(viewpoints), inputs.to_centred(self.T_target_source))
            inputs = dataclasses.replace(inputs, target=visible)
        return dataclasses.replace(self, inputs=inputs.kept())

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of ``scale``: 0 where it was given, NaN where it was asked for and is free."""
        sigma = self.settings.get("scale_sigma", 0.0)
        return np.nan if sigma is None else float(sigma)

    def deviations(
        self,
        tolerance: float | None = None,
        *,
        reach: float | None = None,
        keep: bool = False,
        exclude: Sequence[Sequence[float]] = (),
        progress: Callable[[int, int], object] | None = None,
    ) -> Deviations:
        """How far every point of the scan lies off the target, and on which side.

        Parameters
        ----------
        tolerance : float, optional
            Largest deviation allowed, target units.
        reach : float, optional
            Points farther off are of something else: they have a value, but enter no statistics. Default: from the
            scan, as far as surfaces go that end within ``settings["reach"]``, 0.05 of the smaller diagonal of the two,
            continue the part beyond that, or replace one of its faces. ``numpy.inf`` counts all.
        keep : bool
            Whether outliers and surfaces that run on beyond reach (a table, a clamp) count too.
        exclude : sequence of six numbers
            Boxes in the target's frame whose points are left out: x, y, z of two opposite corners.
        progress : callable, optional
            Called with the points done and all points, now and then.

        Returns
        -------
        Deviations
            In the order of the scan, positive outside the part, target units.

        Raises
        ------
        InputError
            If no pose was found, or the result does not hold its two sides: `attached` brings them back.

        Warns
        -----
        UserWarning
            If the target has no inside and outside (an open mesh, a cloud without normals): no signs then.

        Examples
        --------
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import box
        >>> from dqreg.geometry import Mesh
        >>> part = Mesh(*box((3.0, 2.0, 1.0)))
        >>> found = register(part, part, "identity", effort="fast").deviations(tolerance=0.01)
        >>> len(found), found.signed, found.summary().share_within
        (100000, True, 1.0)
        """
        found = self._deviations(tolerance, reach=reach, keep=keep, exclude=exclude, progress=progress)
        if not found.signed:
            warnings.warn(found.reason, UserWarning, stacklevel=2)
        return found

    def _deviations(
        self, tolerance: float | None = None, *, reach: float | None = None, keep: bool = False, **options: Any
    ) -> Deviations:
        """`deviations` for those who show themselves why there are no signs: it does not warn."""
        # What inspects a part takes a tenth of the first registration to import, and few ask for it.
        from dqreg.registration.result.scan_deviations import scan_deviations

        options = {"tolerance": tolerance, "reach": reach, "keep": keep, **options}
        return scan_deviations(self.inputs, self._found(), self.covariance, self.settings, **options)

    def aligned(self, alignment: Alignment, name: str = "alignment") -> Registration:
        """The registration under an alignment of `dqreg.inspection`: a step of a chain, named.

        Parameters
        ----------
        alignment : DatumAlignment, PointAlignment or SurfaceAlignment
            Of this registration's scan, in the target's frame.
        name : str
            Of the step; ``settings["alignments"]`` lists all of them with their poses and figures.

        Returns
        -------
        Registration
            With the pose after the step, its covariance (of motions that the step locked: as before), and a verdict
            that says so where the step did not come to rest. ``rms`` and ``history`` are the registration's own.

        Raises
        ------
        InputError
            If no pose was found, or the name is empty.

        Examples
        --------
        >>> from dqreg.inspection import align_surface
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import box
        >>> from dqreg.geometry import Mesh
        >>> part = Mesh(*box((3.0, 2.0, 1.0)))
        >>> found = register(part, part, "identity", effort="fast")
        >>> aligned = found.aligned(align_surface(found.deviations(), "best-fit"), "best fit")
        >>> [step["name"] for step in aligned.settings["alignments"]]
        ['best fit']
        """
        self._found()
        return dataclasses.replace(self, **after_alignment(vars(self), alignment, name))

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings under the attribute names; NaN and infinity become None.

        Returns
        -------
        dict
            What `save` writes.
        """
        return to_plain(self)

    def save(self, path: str | Path) -> None:
        """Write the result as JSON, whole or not at all.

        Parameters
        ----------
        path : str or Path
            File to write, JSON whatever its name ends with; ``.json`` tells other programs.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        write_atomically(Path(path), as_text(self))

    @staticmethod
    def load(path: str | Path) -> Registration:
        """Pose, covariance and verdict of a registration from its JSON file, of this version or one before.

        Parameters
        ----------
        path : str or Path
            What `save` or ``dqreg register --out`` wrote.

        Returns
        -------
        Registration
            Equal to the saved one, without its inputs: `attached` brings them back.

        Raises
        ------
        InputError
            If there is no such file, its JSON is of no registration, or its values break what a result promises.
        """
        return Registration(**read_fields(path, Registration))
