"""A target in the unit that people want to read, and a result back in the target's own."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError, UnitsError
from dqreg.files.length_names import SETTING_LENGTHS
from dqreg.files.side_digests import DIGESTS
from dqreg.files.units import factor
from dqreg.geometry import Mesh
from dqreg.rigid.twist import scaling_by

if TYPE_CHECKING:
    from dqreg.geometry import PointCloud
    from dqreg.inspection import Plan
    from dqreg.registration.result.result import Registration


@dataclasses.dataclass(frozen=True, eq=False)
class ShownTarget:
    """A target as it is registered to."""

    geometry: Path | Mesh | PointCloud  # The file itself where nothing was converted
    units: str | None  # Its length unit now
    own: str | None  # That of the file
    scale: float  # From one to the other

    @contextlib.contextmanager
    def source_units(self, source: Path, given: str | None) -> Iterator[str | None]:
        """Length unit of a scan: where nobody names one, that of the target's file, not the one it was converted to."""
        from dqreg.geometry.opening import as_geometry

        if given is not None or self.scale == 1.0:
            yield given
            return
        named = as_geometry(source, "source").units
        try:
            yield named or self.own
        except UnitsError as error:
            if named is not None:
                raise
            raise UnitsError(
                f"{source.name} names no length unit, and in {self.own} like the target its size does not fit; name "
                'its unit: source_units="..." (--source-units)'
            ) from error

    def start(self, start: Any) -> Any:
        """An initial pose to it."""
        if self.scale == 1.0 or start is None or isinstance(start, str):
            return start
        return _scaled(np.array(start, dtype=np.float64), self.scale)

    def planned(self, plan: Plan) -> Plan:
        """A plan that says its unit: that of the file, where it names none."""
        return dataclasses.replace(plan, units=plan.units or self.own)

    def named(self, result: Registration, path: Path, digests: Mapping[str, str] | None = None) -> Registration:
        """A result that names the file, not what was made of it; one that is going to be kept has digests of both."""
        if self.scale != 1.0:
            result = dataclasses.replace(result, settings={**result.settings, "target": str(path)})
        if not digests:
            return result
        return dataclasses.replace(result, settings={**result.settings, DIGESTS: dict(digests)})

    def native(self, result: Registration) -> Registration:
        """A result in the unit of the file."""
        return result if self.scale == 1.0 or self.own is None else in_unit(result, self.own)


def shown_target(path: Path, own: str | None, wanted: str | None, planned: str | None = None) -> ShownTarget:
    """A target in the unit that is wanted, or in that of its inspection plan, which is its own where nobody says.

    ``own`` is the unit of a file that does not say.
    """
    from dqreg.geometry.opening import as_geometry

    shown = wanted or planned
    if shown is None:
        return ShownTarget(path, own, own, 1.0)
    geometry = as_geometry(path, "target")
    unit = own or geometry.units or planned
    if unit is None:
        raise InputError(
            f"--display-units {wanted}: {path.name} names no length unit; name it with --target-units, such as "
            "--target-units mm"
        )
    return _shown(path, geometry, unit, shown)


def _shown(path: Path, geometry: Mesh | PointCloud, unit: str, wanted: str) -> ShownTarget:
    scale = factor(unit, wanted)
    if scale == 1.0:
        return ShownTarget(path, wanted, wanted, 1.0)
    if isinstance(geometry, Mesh):
        found: Mesh | PointCloud = dataclasses.replace(geometry, vertices=geometry.vertices * scale, units=wanted)
    else:
        found = dataclasses.replace(geometry._moved(np.zeros(3), scale), units=wanted)
    return ShownTarget(found, wanted, unit, scale)


def in_unit(result: Registration, unit: str) -> Registration:
    """A result with all its numbers in another unit of the target; its sentences name the unit that they are in."""
    k = factor(str(result.settings["target_units"]), unit)
    spread = scaling_by(1.0, k)
    settings = dict(result.settings) | {"target_units": unit}
    for name in SETTING_LENGTHS:
        if settings.get(name) is not None:
            settings[name] = (k * np.array(settings[name], dtype=np.float64)).tolist()
    if settings.get("T_start") is not None:
        settings["T_start"] = _scaled(np.array(settings["T_start"]), k).tolist()
    if "alignments" in settings:
        settings["alignments"] = [
            step | {"T_target_source": _scaled(np.array(step["T_target_source"]), k).tolist()}
            for step in settings["alignments"]
        ]
    if "source_scale" in settings:
        settings["source_scale"] = k * settings["source_scale"]
    information = result.partial_information
    return dataclasses.replace(
        result,
        T_target_source=_scaled(result.T_target_source, k),
        covariance=result.covariance * spread * spread[:, None],
        partial_information=None if information is None else information / spread / spread[:, None],
        observability=tuple(
            dataclasses.replace(
                each, sigma=k * each.sigma, point=(k * each.point[0], k * each.point[1], k * each.point[2])
            )
            for each in result.observability
        ),
        alternatives=tuple(
            dataclasses.replace(each, T_target_source=_scaled(each.T_target_source, k), score=k * each.score)
            for each in result.alternatives
        ),
        history=tuple(
            dataclasses.replace(
                each,
                T_target_source=_scaled(each.T_target_source, k),
                rms=k * each.rms,
                kernel_scale=k * each.kernel_scale,
                energy=k * k * each.energy,
            )
            for each in result.history
        ),
        rms=k * result.rms,
        settings=settings,
    )


def _scaled(T: FloatArray, k: float) -> FloatArray:
    found = np.array(T, dtype=np.float64)
    found[:3, 3] *= k
    return found
