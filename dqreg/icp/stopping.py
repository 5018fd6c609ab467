"""When the loop ends: the motion is small against the part, nothing moves any more, or the iterations are used up."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Stopping:
    """Limits of one run of the loop; all relative, so mm and m stop at the same place.

    Attributes
    ----------
    convergence : float
        Converged once the root mean square motion of the points in one plain step is below this share of the size.
    iterations : int
        Iterations at most.
    patience : int
        Stalled once the motion has not fallen below its smallest for so many iterations.
    contraction : float
        Largest factor by which the next motion is known to be smaller than the last, as a coarser level has shown it:
        with it, a step needs no further one to prove it was the last.
    """

    convergence: float = 1e-7
    iterations: int = 100
    patience: int = 25
    contraction: float = 1.0

    def status(self, motions: list[float]) -> str | None:
        """Verdict on the sequence of relative motions so far.

        Parameters
        ----------
        motions : list of float
            Motion of each plain step over the size, oldest first.

        Returns
        -------
        str or None
            "converged", "stalled", "iteration limit", or None to go on.

        Examples
        --------
        >>> Stopping(convergence=1e-3).status([0.1, 1e-4]), Stopping().status([0.1, 0.01])
        ('converged', None)
        """
        if motions[-1] * self.contraction <= self.convergence:
            return "converged"
        if len(motions) >= self.iterations:
            return "iteration limit"
        if len(motions) - 1 - motions.index(min(motions)) >= self.patience:
            return "stalled"
        return None
