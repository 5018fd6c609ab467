"""What people see of a registration: the report, the view in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from dqreg.report.page import NotebookCell
    from dqreg.report.result_protocol import RegistrationResult


class ShownResult:
    """What a `Registration` offers to the eye."""

    def report(
        self,
        path: str | Path,
        tolerance: float | None = None,
        *,
        reach: float | None = None,
        start: ArrayLike | None = None,
    ) -> Path:
        """Write a report to be judged by eye: one HTML file that opens anywhere and loads nothing.

        Parameters
        ----------
        path : str or Path
            The file; that it can be written is asked before the work.
        tolerance : float, optional
            Largest deviation allowed, target units; then points and regions of the part pass or fail.
        reach : float, optional
            Points farther off belong to something else, see `deviations`.
        start : (4, 4) array_like, optional
            Where the registration began, to show the scan before it.

        Returns
        -------
        Path
            The file. A failed registration is reported too; a result without its two sides has no view.

        Raises
        ------
        InputError
            If the file cannot be written or does not end in .html or .pdf, or the tolerance is no length above zero.

        Examples
        --------
        >>> import tempfile
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import bracket
        >>> part = Mesh(*bracket())
        >>> result = register(part, part, "identity", effort="fast", keep_inputs=False)  # no view, no pictures
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = result.report(f"{folder}/pose.html")
        ...     path.name, "accepted" in path.read_text("utf-8")
        ('pose.html', True)
        """
        from dqreg.report.page import write_report

        return write_report(self._shown(), path, tolerance, reach=reach, start=start)

    def view(
        self, tolerance: float | None = None, *, height: int = 640, reach: float | None = None, start: Any = None
    ) -> NotebookCell:
        """The report's live view in a cell of a notebook: turn it, play the iterations, read deviations.

        Parameters
        ----------
        tolerance : float, optional
            Largest deviation allowed, target units: the end of the colour scale.
        height : int
            Height of the cell in pixels.
        reach : float, optional
            Points farther off belong to something else, see `deviations`.
        start : (4, 4) array_like, optional
            Where the registration began, to show the scan before it.

        Returns
        -------
        NotebookCell
            What a notebook displays. The page stands in the notebook itself, some MB, and loads nothing;
            ``view.save(path)`` writes it alone.

        Raises
        ------
        InputError
            If the result does not hold its two sides: `attached` brings them back.

        Examples
        --------
        >>> from dqreg.geometry import Mesh
        >>> from dqreg.registration.register import register
        >>> from dqreg.synth.parts import box
        >>> part = Mesh(*box((3.0, 2.0, 1.0)))
        >>> register(part, part, "identity", effort="fast").view()
        Cell(640 pixels high)
        """
        from dqreg.report.page import cell_of

        return cell_of(self._shown(), tolerance, height=height, reach=reach, start=start)

    def _repr_html_(self) -> str:
        """What a notebook shows: verdict, numbers and, with both sides, a picture."""
        from dqreg.report.page import notebook_html

        return notebook_html(self._shown())

    def _shown(self) -> RegistrationResult:
        return cast("RegistrationResult", self)
