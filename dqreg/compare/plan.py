"""The plan of a comparison: cases from folders, recipes, files and sweeps; each is made only when its turn comes."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg._numbers import is_number, is_whole
from dqreg.compare.case import BenchmarkCase, SameLoop, make_case
from dqreg.compare.engines.protocol import Setting
from dqreg.compare.engines.registry import EngineSpec
from dqreg.compare.judge import SUCCESS_THRESHOLD, judge
from dqreg.compare.records import RunRecord
from dqreg.compare.sweep import Cell, Sweep
from dqreg.compare.sweep_file import SHIPPED, TRUST
from dqreg.compare.sweep_tasks import build
from dqreg.compare.truth import TruePoses, truth_of
from dqreg.errors import InputError
from dqreg.files.units import factor
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.opening import as_geometry
from dqreg.registration.problem.source import MESH_SAMPLES
from dqreg.rigid import pose
from dqreg.synth import Case, load_case, read_recipe, write_case


def from_case(
    case: Case | str | os.PathLike[str], *, withhold_initial_pose: bool = False, **options: Any
) -> BenchmarkCase:
    """Task of a case folder."""
    case = case if isinstance(case, Case) else load_case(case)
    source, target = as_geometry(case.scan, "scan"), as_geometry(case.part, "part")
    if not isinstance(source, PointCloud):
        raise InputError(f"{case.scan} holds a mesh; a case's scan is a cloud of points")
    truth = truth_of(case.truth, case.T_target_source, str(case.folder / "truth.json"))
    start = None if withhold_initial_pose else case.T_start
    name = case.folder.resolve().name
    return make_case(name, source, target, start, truth, noise=case.range_sigma, units=case.units, **options)


def from_pair(
    scan: Any,
    target: Any,
    start: FloatArray | str | None = "identity",
    truth: TruePoses | None = None,
    *,
    source_units: str | None = None,
    target_units: str | None = None,
    **options: Any,
) -> BenchmarkCase:
    """Task of a scan and a target."""
    source, goal = as_geometry(scan, "scan"), as_geometry(target, "target")
    if isinstance(source, Mesh):
        source = sample_mesh(source, MESH_SAMPLES, np.random.default_rng(0))
    scale = factor(source_units or source.units, target_units or goal.units)
    name = " on ".join(_name(value, word) for value, word in ((scan, "scan"), (target, "target")))
    T = np.eye(4) if isinstance(start, str) else start
    checked = None if T is None else as_pose(T, "start")
    units = target_units or goal.units or ""
    return make_case(name, source._moved(np.zeros(3), scale), goal, checked, truth, units=units, **options)


def _name(value: Any, word: str) -> str:
    return Path(value).name if isinstance(value, (str, os.PathLike)) else word


# In a sweep, intermediate poses are recorded for initial poses up to this angle, one trial.
CURVE_DEG = 10.0


@dataclasses.dataclass(frozen=True)
class Protocol:
    """What holds for all engines, and when a pose is a success."""

    settings: tuple[Setting, ...] = ("manual", "same-loop")  # Settings to run cases in; a sweep brings its own
    repeats: int = 3  # Timed runs of each case after one warm-up; a sweep brings its own
    threads: int = 2  # Threads that an engine may use
    timeout: float = 300.0  # Seconds for one run; a sweep brings its own
    # Whether cases are run without their initial pose; engines that need one do not take part then
    withhold_initial_pose: bool = False
    loop: SameLoop = dataclasses.field(default_factory=SameLoop)  # What the same loop means
    success_threshold: float = SUCCESS_THRESHOLD  # Largest worst displacement, in S, of a successful pose
    memory_limit: float | None = None  # Bytes; None takes three quarters of the machine's memory
    isolate: bool = True  # Whether engines run in a process of their own. Without it a crash or a hang ends everything

    def __post_init__(self) -> None:
        for name, least in (("repeats", 1), ("threads", 1)):
            value = getattr(self, name)
            if not is_whole(value) or value < least:
                raise InputError(f"{name} must be a whole number, {least} or more; got {value!r}")
        if is_number(self.success_threshold) and self.success_threshold > 1.0:
            given = f"{self.success_threshold:g}: all of the part, and more"
            raise InputError(f"success_threshold is a fraction of the diagonal, 0.01 for 1 %; got {given}")
        for name in ("timeout", "success_threshold", *(() if self.memory_limit is None else ("memory_limit",))):
            value = getattr(self, name)
            if not is_number(value) or not 0.0 < value < float("inf"):
                raise InputError(f"{name} must be a number above 0; got {value!r}")
        if not self.settings or not set(self.settings) <= set(get_args(Setting)):
            raise InputError(f"settings must be a tuple of {', '.join(get_args(Setting))}; got {self.settings!r:.80}")


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """Runs of one case, which is made when its turn comes."""

    key: str  # Names the case in files
    title: str  # Names it and its other trials together
    words: str  # Names it on screen
    weight: float  # How much work it is: its scan points
    repeats: int  # Timed runs
    setting: Setting
    has_initial_pose: bool
    make: Callable[[], BenchmarkCase]  # Makes the case
    curve: bool = True  # Whether intermediate poses are wanted
    excluded: frozenset[str] = frozenset()  # Engines that the sweep wants on other axes only
    row: tuple[str, str] | None = None  # Axis and setting, where the axis goes from small scans to large ones
    case: str = ""  # Name of the case, another for each; "" for tasks of a sweep

    def takes(self, engine: EngineSpec) -> bool:
        """Whether an engine takes part."""
        if engine.name in self.excluded:
            return False
        return self.setting in engine.settings and (self.has_initial_pose or not engine.needs_initial_pose)


def plan(tasks: Any, protocol: Protocol) -> tuple[list[PlannedRun], str]:
    """Planned runs in their order, and a title."""
    things = list(tasks) if isinstance(tasks, (list, tuple)) else [tasks]
    items = [item for thing in things for item in _items(thing, protocol)]
    items = _told_apart(list({item.key: item for item in items}.values()))
    if not items:
        raise InputError("nothing to compare on: give a case, a recipe, a scan and a target, or a sweep")
    titles = dict.fromkeys(thing.name if isinstance(thing, Sweep) else "" for thing in things)
    names = [title for title in titles if title] or list(dict.fromkeys(item.title for item in items))
    shown = ", ".join(names) if len(names) <= 4 else f"{len(names)} cases"
    return items, shown


def _told_apart(items: list[PlannedRun]) -> list[PlannedRun]:
    """Different cases of one name get numbers, in the order in which they were given."""
    alike: dict[tuple[Any, ...], list[str]] = {}
    for item in items:
        alike.setdefault((item.case, item.setting, item.has_initial_pose), []).append(item.key)
    numbered = []
    for item in items:
        keys = alike[item.case, item.setting, item.has_initial_pose]
        if item.case and len(keys) > 1:
            name = f"{item.case} ({keys.index(item.key) + 1})"
            item = dataclasses.replace(item, case=name, title=name, words=f"{name}, {item.setting}")
        numbered.append(item)
    return numbered


def inverted_truths(items: Iterable[PlannedRun], runs: Sequence[RunRecord]) -> tuple[str, ...]:
    """A sentence for each case where no engine is right, and two or more would be if the true pose were inverted."""
    names = [
        item.case for item in items if item.case and _fit_inverted(item, [run for run in runs if run.key == item.key])
    ]
    return tuple(
        f"{name}: no pose that was found is the true one, but the inverse of the true one is: is the truth given from "
        "target to source? It must be T_target_source."
        for name in dict.fromkeys(names)
    )


def _fit_inverted(item: PlannedRun, runs: list[RunRecord]) -> bool:
    if any(run.success is not False for run in runs):
        return False
    truth = item.make().ground_truth
    found = {run.engine: np.array(run.T_target_source) for run in runs if run.kind == "rigid"}
    return sum(judge(pose.inverse(T), truth).success is True for T in found.values()) >= 2


def _items(thing: Any, protocol: Protocol) -> list[PlannedRun]:
    if isinstance(thing, Sweep):
        return [_of_cell(cell, repeats, protocol, thing.excluded(cell.axis)) for cell, repeats in thing.cells()]
    if isinstance(thing, BenchmarkCase):
        return [_of_case(thing, protocol)]
    settings = [setting for setting in protocol.settings if setting == "manual" or not protocol.withhold_initial_pose]
    if not settings:
        raise InputError("the same loop needs a start; without one there is only the setting manual")
    options = {"withhold_initial_pose": protocol.withhold_initial_pose, **_options(protocol)}
    with _case(thing) as case:
        made = [from_case(case, setting=setting, **options) for setting in settings]
    return [_of_case(case, protocol) for case in made]


def _options(protocol: Protocol) -> dict[str, Any]:
    return {name: getattr(protocol, name) for name in ("loop", "threads", "success_threshold")}


def _of_case(case: BenchmarkCase, protocol: Protocol) -> PlannedRun:
    task = case.task
    return PlannedRun(
        key=case.key,
        title=case.case,
        words=f"{case.case}, {task.setting}",
        weight=float(len(task.source)),
        repeats=protocol.repeats,
        setting=task.setting,
        has_initial_pose=task.start is not None,
        make=lambda: case,
        case=case.case,
    )


def _of_cell(cell: Cell, repeats: int, protocol: Protocol, excluded: frozenset[str]) -> PlannedRun:
    title = f"{cell.axis} {cell.value:g}" if isinstance(cell.value, (int, float)) else f"{cell.axis} {cell.value}"
    return PlannedRun(
        key=f"{cell.key}|{protocol.threads}|{dataclasses.astuple(protocol.loop)}",
        title=title,
        words=f"{title}, {cell.setting}, trial {cell.trial + 1}",
        weight=float(cell.points),
        repeats=repeats,
        setting=cell.setting,
        has_initial_pose=not cell.nothing,
        make=lambda: build(cell, **_options(protocol)),
        curve=(cell.axis, cell.trial) == ("start_angle_deg", 0) and cell.start_angle_deg <= CURVE_DEG,
        excluded=excluded,
        row=("points", cell.setting) if cell.axis == "points" else None,
    )


@contextlib.contextmanager
def _case(thing: Any) -> Iterator[Case]:
    """A case; the one of a recipe lasts as long as the block."""
    if isinstance(thing, Case):
        yield thing
        return
    if not isinstance(thing, (str, os.PathLike)):
        raise InputError(f"not a task: {thing!r:.80}; give a case folder, a recipe, a BenchmarkCase or a Sweep")
    path = Path(thing)
    if str(thing) in (*SHIPPED, TRUST) and not path.exists():
        raise InputError(f"there is no case {thing}; did you mean --sweep {thing}?")
    if path.suffix.lower() != ".toml":
        yield load_case(path)
        return
    recipe = read_recipe(path)
    with tempfile.TemporaryDirectory(prefix="dqreg-case-") as folder:
        yield write_case(Path(folder) / recipe.name, recipe)
