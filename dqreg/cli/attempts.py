"""A registration of two files; mistakes that files invite are tried: an inverted pose, swapped files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.cli.outputs import say
from dqreg.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray
    from dqreg.geometry import Mesh, PointCloud
    from dqreg.registration.result.result import Registration

    Target = Path | Mesh | PointCloud

# Points that tell how much of a scan lies at its target under a pose.
FEW_POINTS = 2_000
# Another pose is tried where so many times as many points lie at the target as under the one that was given.
CLEARLY_RATIO = 2.0
# Two poses are the same to a person within this rotation, and this fraction of the target's size.
SAME_DEG, SAME_DIAGONALS = 20.0, 0.2
INVERTED = "the initial pose is inverted (it maps the target to the scan)"


def register_files(
    scan: Path, target: Target, start: FloatArray | str | None, console: Console, **options: Any
) -> Registration:
    """`dqreg.register` of two files; where the start is inverted or the files are swapped, it is said."""
    from dqreg.registration.register import register

    result = register(scan, target, start, **options)
    if not isinstance(start, str) and start is not None:
        result = _with_inverse(result, scan, target, start, console, options)
    if result.verdict.level != "accepted" and isinstance(target, Path) and look_swapped(result):
        _try_swapped(scan, target, console, options)
    return result


def _with_inverse(
    result: Registration, scan: Path, target: Target, start: FloatArray, console: Console, options: dict[str, Any]
) -> Registration:
    """The same, or what the inverse of its initial pose leads to; one that is far from what was found is told."""
    from dqreg.registration.register import register
    from dqreg.rigid import pose

    inverse = pose.inverse(start)
    found = [result.T_target_source, *(other.T_target_source for other in result.alternatives)]
    accepted = result.verdict.level == "accepted"
    if _alike(result, start, inverse) or (accepted and any(_alike(result, T, start) for T in found)):
        return result
    if accepted and _alike(result, found[0], inverse):
        say(console, f"{INVERTED}: a search found this pose")
        return result
    is_copy = accepted and any(_alike(result, T, inverse) for T in found)
    if is_copy or (not accepted and _share_near(result, inverse) > CLEARLY_RATIO * _share_near(result, start)):
        other = register(scan, target, inverse, **options)
        # What lies nearer by chance leads elsewhere.
        if other.verdict.level == "accepted" and _alike(other, other.T_target_source, inverse):
            say(console, f"{INVERTED}: this is the result from its inverse")
            return dataclasses.replace(other, settings={**other.settings, "start": "inverted"})
    if accepted:
        say(console, f"the initial pose is far off: the pose found is {_apart_words(result, start)} away from it")
    return result


def _apart(result: Registration, a: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Angle between two poses in degrees, and how far apart they put the middle of the scan."""
    import numpy as np

    from dqreg.rigid import pose

    assert result.inputs is not None
    one, other = (result.inputs.placed(T).mean(axis=0) for T in (a, b))
    return float(np.rad2deg(pose.angle_between(a, b))), float(np.linalg.norm(one - other))


def _apart_words(result: Registration, start: FloatArray) -> str:
    from dqreg.report.text import unit_words

    angle, shift = _apart(result, result.T_target_source, start)
    return f"{angle:.0f} degrees and {shift:.3g}{unit_words(result.settings['target_units'])}"


def _alike(result: Registration, a: FloatArray, b: FloatArray) -> bool:
    import numpy as np

    if result.inputs is None or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return True
    angle, shift = _apart(result, a, b)
    return angle < SAME_DEG and shift < SAME_DIAGONALS * float(result.settings["diagonal"])


def _share_near(result: Registration, T: FloatArray) -> float:
    import numpy as np

    assert result.inputs is not None
    points = result.inputs.placed(T)
    points = points[:: max(1, len(points) // FEW_POINTS)]
    found = result.inputs.target.surface.closest(points)
    return float(np.mean(np.linalg.norm(found.points - points, axis=1) <= result.settings["max_distance"]))


def refuse_swapped(result: Registration, scan: Path, part: Path) -> None:
    """`InputError` where a part would be measured against its scan."""
    if look_swapped(result):
        raise InputError(
            f"the files look swapped: {scan.name} is a mesh and {part.name} a cloud of points; the scan comes first"
        )


def look_swapped(result: Registration) -> bool:
    """Whether a mesh was laid on a cloud of points, as where the part is named first."""
    from dqreg.report.hints import is_mesh_on_cloud

    return result.inputs is not None and is_mesh_on_cloud(result.inputs)


def _try_swapped(scan: Path, target: Path, console: Console, options: dict[str, Any]) -> None:
    from dqreg.registration.register import register

    swapped = {"source_units": "target_units", "target_units": "source_units"}
    kept: dict[str, Any] = {name: options[name] for name in ("effort", "seed", "time_limit") if name in options}
    kept |= {other: options[name] for name, other in swapped.items() if name in options}
    if register(target, scan, None, **kept).verdict.level == "accepted":
        say(
            console,
            f"the files look swapped: with {target.name} as SCAN and {scan.name} as TARGET the alignment is trusted",
        )
