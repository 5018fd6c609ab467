"""The third step: the scan laid on the part, with its iterations as they happen, its verdict and its rivals."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_float
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.files.strict_json import plain
from dqreg.geometry import Mesh, PointCloud
from dqreg.icp.history import Iteration, Stage
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.registration.target import Target, prepare_target
from dqreg.report.progress import NEXT, Steps
from dqreg.solvers import Fit, solve
from dqreg.studio.cleaning import cleaned_file, scan_cloud
from dqreg.studio.drawing import drawn_pose, frame_of, true_pose
from dqreg.studio.visit import PROGRESS, START, Visit
from dqreg.studio.worker_cache import Place, cached, mirrored, remember

# Points and seconds that tell a mirror image.
FEW_POINTS, MIRROR_SECONDS = 5_000, 20.0
# Yaw and pitch in degrees from which the part may be looked at; the first unless another shows so many times as much.
SIDES = [(35.0 + 45.0 * k, pitch) for pitch in (30.0, -30.0) for k in range(8)]
CLEARLY_RATIO = 1.1
RESULT, ASKED = "result.json", "result_of.json"


class ScanProgress:
    """The stages and iterations of a run, a line each, with the time that is left."""

    def __init__(self, place: Place, searching: bool) -> None:
        self._path = place.folder / PROGRESS
        self._path.write_text("", encoding="utf-8")
        self._frames = frame_of(place.scan()), frame_of(place.part())
        self._scale = place.scale()
        self._steps = Steps("reading", searching)

    def tell(self, **words: Any) -> None:
        """Add a line."""
        left, reached = self._steps.left(), self._steps.reached()
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(plain({**words, "left": left, "reached": reached}), allow_nan=False) + "\n")

    def stage(self, stage: Stage) -> None:
        """A stage of the search has ended."""
        words = NEXT.get(stage.name, stage.name).format(f"{stage.poses:,}")
        self._steps = self._steps.searched(stage.name, words)
        self.tell(kind="stage", words=words)

    def iteration(self, record: Iteration) -> None:
        """An iteration has ended."""
        self._steps = self._steps.iterated("")
        drawn = drawn_pose(record.T_target_source, self._scale, *self._frames)
        self.tell(kind="iteration", number=record.number, stage=record.stage, rms=record.rms, drawn=drawn)


def align(place: Place) -> dict[str, Any]:
    """Register the scan, and say what came of it."""
    result = _registered(place)
    remember("result", [str(place.folder), _asked(place)], result)
    return told(place, result)


def mirror_question(place: Place) -> dict[str, Any]:
    """Whether the scan fits the part only as its mirror image, asked of few points before anything else is done."""
    if not isinstance(place.part(), Mesh):
        return {"mirrored": False}
    options = register_options(dataclasses.replace(place.visit, start="none"))
    points = scan_cloud(place.scan())
    few = points._taken(np.random.default_rng(0).permutation(len(points))[:FEW_POINTS])
    found = _of_few(place, few, options).verdict
    if found.level == "accepted":
        return {"mirrored": False}
    return {"mirrored": "mirrored" in found.codes or _of_few(place, mirrored(few), options).verdict.level == "accepted"}


def _of_few(place: Place, points: PointCloud | Mesh, options: dict[str, Any]) -> Registration:
    return register(points, _target(place), time_limit=MIRROR_SECONDS, keep_inputs=False, **options)


def result_of(place: Place) -> Registration:
    """The registration of the visit as it stands: remembered, read from its file, or made again."""

    def make() -> Registration:
        saved = place.folder / ASKED
        if saved.is_file() and read_json(saved, "what was asked") == _asked(place):
            return Registration.load(place.folder / RESULT).attached(cleaned_file(place), place.part_path)
        return _registered(place)

    return cached("result", [str(place.folder), _asked(place)], make)


def _registered(place: Place) -> Registration:
    start = start_of(place)
    progress = ScanProgress(place, start is None)
    progress.tell(kind="stage", words="looking for the pose" if start is None else "refining the pose")
    result = register(
        cleaned_file(place),
        _target(place),
        start,
        observe=progress.iteration,
        observe_search=progress.stage,
        **register_options(place.visit),
    )
    result.save(place.folder / RESULT)
    place.write(ASKED, json.dumps(_asked(place)))
    if start is not None and not isinstance(start, str):
        np.savetxt(place.folder / START, start, fmt="%.17g")
    return result


def told(place: Place, result: Registration) -> dict[str, Any]:
    """A registration as the page shows it."""
    scale, frames = place.scale(), (frame_of(place.scan()), frame_of(place.part()))
    found = bool(np.isfinite(result.T_target_source).all())

    def drawn(T: FloatArray) -> list[float]:
        return drawn_pose(T, scale, *frames)

    return {
        "found": found,
        "level": result.verdict.level,
        "codes": result.verdict.codes,
        "reasons": result.verdict.reasons,
        "rms": result.rms,
        "inliers": result.inlier_fraction,
        "unit": result.settings.get("target_units"),
        "seconds": result.timings.get("total"),
        "T": result.T_target_source.tolist() if found else None,
        "drawn": drawn(result.T_target_source) if found else None,
        "rivals": [
            {"score": other.score, "T": other.T_target_source.tolist(), "drawn": drawn(other.T_target_source)}
            for other in result.alternatives
        ],
        "history": [
            {"number": record.number, "stage": record.stage, "rms": record.rms, "drawn": drawn(record.T_target_source)}
            for record in result.history
            if np.isfinite(record.T_target_source).all()
        ],
        "motions": [{"words": each.words, "free": each.is_free} for each in result.observability],
        "pairs": pair_residuals(place, result.T_target_source) if found and place.visit.pairs else [],
        "look": scanned_side(result) if found else None,
    }


def scanned_side(result: Registration) -> list[float] | None:
    """Yaw and pitch in degrees from which most of what was scanned is seen; None where it has no sides."""
    inputs = result.inputs
    if inputs is None or not isinstance(inputs.target.geometry, Mesh):
        return None
    points = inputs.placed(result.T_target_source)
    found = inputs.target.surface.closest(points[:: max(1, len(points) // FEW_POINTS)])
    near = found.distances <= result.settings["reach"]
    yaw, pitch = np.radians(SIDES).T
    towards = np.column_stack([np.cos(pitch) * np.sin(yaw), -np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    seen = np.maximum(found.normals[near] @ towards.T, 0.0).sum(axis=0)
    best = int(np.argmax(seen))
    return list(SIDES[best if seen[best] > CLEARLY_RATIO * seen[0] else 0])


def align_pairs(place: Place) -> dict[str, Any]:
    """The closed form on the pairs: where the scan goes, and what is left at each."""
    fit = fit_pairs(place)
    frames = frame_of(place.scan()), frame_of(place.part())
    drawn = drawn_pose(fit.T_target_source, place.scale(), *frames)
    return {"drawn": drawn, "rms": fit.rms, "pairs": pair_residuals(place, fit.T_target_source)}


def pose_of_drawn(place: Place, values: dict[str, Any]) -> dict[str, Any]:
    """A scan that was moved by hand, as a pose."""
    drawn = as_float(values.get("drawn"), "drawn")
    if drawn.shape != (12,) or not np.isfinite(drawn).all():
        raise InputError("a scan that was moved by hand has a pose of 12 numbers")
    T = true_pose(drawn, place.scale(), frame_of(place.scan()), frame_of(place.part()))
    return {"T": T.tolist()}


def _asked(place: Place) -> dict[str, Any]:
    """All that the registration depends on."""
    names = ("scan", "mirrored", "part", "cuts", "start", "dof")
    visit = place.visit
    asked = {name: getattr(visit, name) for name in names}
    asked["pairs"] = visit.pairs if visit.start == "pairs" else ()
    asked["T_start"] = visit.T_start if visit.start in ("hand", "rival") else None
    found: dict[str, Any] = plain(asked)
    return found


def _target(place: Place) -> Target:
    path: Path = place.part_path
    return cached("target", [path, path.stat().st_mtime_ns], lambda: prepare_target(path))


def register_options(visit: Visit) -> dict[str, Any]:
    """Keyword options of `dqreg.register`; those that are left at their defaults are not named."""
    options: dict[str, Any] = {}
    for name, side in (("source_units", visit.scan), ("target_units", visit.part)):
        if side is not None and side.units is not None:
            options[name] = side.units
    if visit.dof and visit.start != "none":
        options["dof"] = visit.dof
    if visit.start == "rival":
        # It was chosen by eye: no search shall choose the other one again.
        options["search"] = "never"
    return options


def start_of(place: Place) -> FloatArray | str | None:
    """The initial pose: None for a search, "identity", or a matrix."""
    visit = place.visit
    if visit.start == "none":
        return None
    if visit.start == "identity":
        return "identity"
    if visit.start == "pairs":
        return fit_pairs(place).T_target_source
    return None if visit.T_start is None else np.array(visit.T_start)


def fit_pairs(place: Place) -> Fit:
    """The closed form on the pairs that were pointed at, in the part's unit."""
    pairs = place.visit.pairs
    scan = place.scale() * np.array([pair.scan for pair in pairs]).reshape(-1, 3)
    part = np.array([pair.part for pair in pairs]).reshape(-1, 3)
    return solve(scan, part, point_weights=[pair.weight for pair in pairs])


def pair_residuals(place: Place, T: ArrayLike) -> list[float]:
    """Distance that is left at each pair, in the part's unit."""
    pose, pairs = np.asarray(T), place.visit.pairs
    scan = place.scale() * np.array([pair.scan for pair in pairs]).reshape(-1, 3)
    left = scan @ pose[:3, :3].T + pose[:3, 3] - np.array([pair.part for pair in pairs]).reshape(-1, 3)
    return [float(x) for x in np.linalg.norm(left, axis=1)]
