"""Both sides of a registration as it begins: read, in one unit, near the origin."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.opening import describe
from dqreg.geometry.unit_check import require_same_units
from dqreg.icp.history import Iteration
from dqreg.registration.assess import for_caller
from dqreg.registration.downsampling import Sides
from dqreg.registration.options import Options
from dqreg.registration.source import CentredSource, centre_source
from dqreg.registration.target_index import TargetIndex, index_target
from dqreg.registration.visibility import seen_from


@dataclasses.dataclass(frozen=True)
class Both:
    """Source and target, read."""

    source: CentredSource  # The scan, in target units
    target: TargetIndex  # What it is registered to
    name: str  # What the caller gave as the source, see `describe`
    units: tuple[str | None, str | None]  # Length units of source and target, where they are known
    _building: threading.Thread | None = dataclasses.field(default=None, repr=False, compare=False)

    @staticmethod
    def read(
        source: Any,
        target: Any,
        options: Options,
        source_units: str | None,
        target_units: str | None,
        viewpoints: FloatArray | None,
    ) -> Both:
        """Read both sides; a target that is not prepared is being built from here on."""
        indexed = index_target(target)
        building = None if indexed is target else indexed.build_beside()
        unit, rng = target_units or indexed.units, np.random.default_rng(options.seed)
        centred = centre_source(source, source_units, unit, rng, float(options.scale))
        if viewpoints is not None:
            centred = seen_from(centred, viewpoints, indexed)
        units = source_units or centred.cloud.units, unit
        if options.units == "check" and None in units:
            require_same_units(centred.cloud, indexed.geometry, *units, indexed.spreads)
        return Both(centred, indexed, describe(source), units, building)

    def sides(self, options: Options, *, started: bool) -> Sides:
        """Both as the loop takes them; from a start, two dense clouds are evened out."""
        indexed = self.target
        if options.cells is not None and started and indexed.kind == "cloud":
            sides = Sides.evened(self.source, indexed, options.cells)
        else:
            sides = self.whole(options)
        if self._building is not None:
            self._building.join()
        return sides

    def whole(self, options: Options) -> Sides:
        """Both with all of their points."""
        return Sides.whole(self.source, self.target, options.fitted)

    def observer(self, observe: Callable[[Iteration], object] | None) -> Callable[[Iteration], object] | None:
        """The caller's observer, told of poses between the caller's frames."""
        if observe is None:
            return None
        told = observe
        return lambda record: told(for_caller(record, self.target.origin, self.source.origin))

    def settings(self) -> dict[str, Any]:
        """What was registered to what, for the result."""
        source_units, target_units = self.units
        names = {"source": self.name, "target": self.target.name}
        return {**names, "source_units": source_units, "target_units": target_units}
