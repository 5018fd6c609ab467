"""Both sides of a registration, kept beside its answer."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg.registration.source import CentredSource, centre_source
from dqreg.registration.target_index import TargetIndex, index_target


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Both sides of a registration, kept so that its result can be looked at: deviations, pictures, reports."""

    source: CentredSource  # The scan, in target units
    target: TargetIndex  # What it was registered to

    @staticmethod
    def read(
        source: Any,
        target: Any,
        source_units: str | None = None,
        target_units: str | None = None,
        seed: int = 0,
        scale: float = 1.0,
    ) -> Inputs:
        """Both sides from whatever `dqreg.register` takes."""
        indexed = index_target(target)
        units = target_units or indexed.units
        return Inputs(centre_source(source, source_units, units, np.random.default_rng(seed), scale), indexed)
