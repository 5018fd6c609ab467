"""When the loop ends: converged against the size of the part, stalled, or out of iterations."""

from __future__ import annotations

import dataclasses

from dqreg._statuses import Status


@dataclasses.dataclass(frozen=True)
class Stopping:
    """Limits of one run of the loop; all relative, so mm and m stop at the same place."""

    # Converged once the root mean square motion of the points in one plain step is below this fraction of the size
    convergence: float = 1e-7
    iterations: int = 100  # Iterations at most
    patience: int = 25  # Stalled after so many iterations without a smaller motion
    # Convergence rate measured on a coarser level, a factor between successive motions: with it, the last step needs no
    # further one to prove it
    contraction: float = 1.0

    def status(self, motions: list[float]) -> Status | None:
        """How the loop ends after these relative motions; None goes on."""
        if motions[-1] * self.contraction <= self.convergence:
            return "converged"
        if len(motions) >= self.iterations:
            return "iteration limit"
        if len(motions) - 1 - motions.index(min(motions)) >= self.patience:
            return "stalled"
        return None
