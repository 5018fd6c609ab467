"""When the loop ends: the motion is small against the part, nothing moves any more, or the iterations are used up."""

from __future__ import annotations

import dataclasses

from dqreg.solvers.status import Status


@dataclasses.dataclass(frozen=True)
class Stopping:
    """Limits of one run of the loop; all relative, so mm and m stop at the same place."""

    # Converged once the root mean square motion of the points in one plain step is below this share of the size
    convergence: float = 1e-7
    iterations: int = 100  # Iterations at most
    patience: int = 25  # Stalled once the motion has not fallen below its smallest for so many iterations
    # Largest factor by which the next motion is known to be smaller than the last, as a coarser level has shown it:
    # with it, a step needs no further one to prove it was the last
    contraction: float = 1.0

    def status(self, motions: list[float]) -> Status | None:
        """Verdict on the sequence of relative motions so far."""
        if motions[-1] * self.contraction <= self.convergence:
            return "converged"
        if len(motions) >= self.iterations:
            return "iteration limit"
        if len(motions) - 1 - motions.index(min(motions)) >= self.patience:
            return "stalled"
        return None
