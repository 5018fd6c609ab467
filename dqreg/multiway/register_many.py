"""The front door: scans in, all their poses in one frame out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._numbers import is_whole
from dqreg.errors import InputError
from dqreg.multiway.assemble import assembled
from dqreg.multiway.pairwise.pair_runs import PairRunner, Progress, workers_of
from dqreg.multiway.pairwise.pairs import Edges, Order, asked_pairs
from dqreg.multiway.pairwise.starts import contradicted_starts, other_frame, read_starts
from dqreg.multiway.plan import first_edges, with_overlapping_pairs
from dqreg.multiway.pose_graph.edges import PART, Edge
from dqreg.multiway.refinement.refine import refined
from dqreg.multiway.result import Multiway
from dqreg.multiway.scans.overlap import overlap_matrix
from dqreg.multiway.scans.scans import View, read_views, stray_remarks, typical_size, typical_spacing, unit_of
from dqreg.multiway.selection.consensus import by_consensus
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.selection.outlier_scans import (
    Judge,
    placed_of,
    without_contradicting_scans,
    without_misfits,
    without_passed_scans,
)
from dqreg.multiway.selection.start_prior import joined_by_starts
from dqreg.multiway.turntables.equal_steps import EqualSteps
from dqreg.multiway.turntables.rotational_symmetry import turnings
from dqreg.multiway.turntables.round_part import RoundPart, laid_by_angles
from dqreg.multiway.visibility.sides import Sides
from dqreg.multiway.visibility.still_background import unmoved_scans
from dqreg.registration.options.option_checks import read_time_limit, require_observer, require_seed, require_word
from dqreg.registration.options.options import Effort
from dqreg.registration.result.log import log_verdict
from dqreg.registration.target import Target, prepare_target
from dqreg.trust.records import Reason

# Poses of pairs need not agree to better than this fraction of the spacing of the points.
AGREEMENT_SPACINGS = 0.25
# Shares of a time limit after which no pair goes on, and not the joint refinement either: the rest is for what follows.
PAIRS_SHARE, JOINT_SHARE = 0.7, 0.9


def register_many(
    scans: Sequence[Any] | Mapping[str, Any],
    *,
    target: Any = None,
    starts: Any = None,
    viewpoints: Any = None,
    edges: Edges = "auto",
    order: Order = "any",
    anchor: int = 0,
    effort: Effort = "normal",
    seed: int = 0,
    workers: int | None = None,
    time_limit: float | None = None,
    observe: Callable[[Progress], object] | None = None,
    folder: str | Path | None = None,
) -> Multiway:
    """Poses of many scans in one frame, and how sure they are.

    Pairs are registered, each with its verdict; edges that contradict loops or the rest are left out; the others make a
    pose graph; then the planes of all overlapping pairs are put into one cost and all poses are refined at once.

    Parameters
    ----------
    scans : sequence or mapping of path, (n, 3) array, PointCloud, Open3D or trimesh object
        Two at least, in one length unit; a mapping says how each is called. What cannot be read is named in the verdict
        and left out.
    target : path, array or object, optional
        A part (or a scan) in whose frame all scans are to be placed; "world" is its frame then.
    starts : (n, 4, 4) array_like, or sequence of (4, 4) or None, optional
        Initial poses ``T_world_scan``; NaN or None where there is none. Pairs with both begin there.
    viewpoints : "origin", (3,) or (n, 3) array_like, optional
        Where the scanner stood, in the frame of each scan. It tells front from back, which thin sheets ask for.
        Default: what the scans hold; the scanner of a turntable stands on one side of all scans.
    edges : {"auto", "chain", "ring"} or sequence of (int, int)
        Pairs (target, source) to register first. Auto: all pairs of up to 40 scans, beyond that those that look alike;
        the neighbours of an ordered sequence, then loops between scans that turn out to overlap.
    order : {"any", "sequence", "turntable"}
        What is known of the order of the scans. A sequence begins each pair at the identity; the pairs of a turntable
        share one axis and one step, which are estimated: a start where a pair fails, and as sure as the pairs and poses
        agree on it, a prior that confirms pairs and holds what faces do not (``settings["by_steps"]``); no constraint.
    anchor : int
        Scan whose frame is "world" (or that keeps its pose of ``starts``), where no target is given. Where it is not
        placed, another one is, which the verdict says (``settings["anchor"]``; the asked one is ``"asked_anchor"``).
    effort : {"fast", "normal", "best"}
        Of the pairs, as in `register`; and points of a scan in the joint refinement: 5,000, 20,000, all.
    seed : int
        For whatever is drawn.
    workers : int, optional
        Pairs registered at once, in threads. Default: one for each core. The answer does not depend on it.
    time_limit : float, optional
        Seconds for all scans together, however many workers. Pairs end at 0.7 of it, the joint refinement at 0.9;
        the best poses so far are returned, and the verdict says so.
    observe : callable, optional
        Called with a `Progress` after each pair; returning False ends the registrations of pairs.
    folder : str or Path, optional
        Where finished pairs are kept; a later call with the same scans takes them from there.

    Returns
    -------
    Multiway
        Poses, covariances, edges and verdict. Look at ``verdict.level`` first.

    Raises
    ------
    InputError
        If fewer than two scans can be used, or an argument cannot.

    Examples
    --------
    >>> from dqreg.synth.parts import bracket
    >>> from dqreg.geometry import Mesh, sample_mesh
    >>> part, rng = Mesh(*bracket()), np.random.default_rng(0)
    >>> scans = [sample_mesh(part, 3000, rng).points + [shift, 0.0, 0.0] for shift in (0.0, 0.5, 1.0)]
    >>> result = register_many(scans, starts=[np.eye(4)] * 3, effort="fast", workers=1)
    >>> (result.T_world_scan[2, :3, 3].round(1) + 0.0).tolist()
    [-1.0, 0.0, 0.0]
    """
    began = time.perf_counter()
    time_limit = _checked(effort, seed, time_limit, observe)
    views = read_views(scans, seed, viewpoints)
    part = None if target is None else target if isinstance(target, Target) else prepare_target(target)
    usable = [k for k, view in enumerate(views) if view.usable]
    known = read_starts(starts, len(views))
    _check_anchor(anchor, len(views))
    pairs = asked_pairs(edges, order, usable, len(views))
    runner = PairRunner(
        views=views,
        part=part,
        effort=effort,
        seed=seed,
        workers=workers_of(workers),
        deadline=began + PAIRS_SHARE * (time_limit or np.inf),
        observe=observe,
        folder=_made(folder),
    )
    seconds = {"read": time.perf_counter() - began}
    automatic = isinstance(edges, str) and edges == "auto"
    found = first_edges(runner, pairs, known, order, automatic=automatic)
    found, turned = laid_by_angles(runner, found, known, order)
    sides = Sides.of(views, order, found)
    size, floor = typical_size(views), AGREEMENT_SPACINGS * typical_spacing(views)
    home, homes = (PART, {}) if part is not None else _homes(views, anchor, known)
    # Given poses, and angles that nobody knows, say where scans are: a table does not.
    on_table = order == "turntable" and turned is None and any(known[k] is None for k in usable)
    steps = EqualSteps.of(found, views, size, floor) if on_table else None
    judge = Judge(sides, len(views), home, size, floor, homes, steps)
    judge, selection = _selection(runner, judge, found, turned, automatic=automatic)
    seconds["pairs"] = time.perf_counter() - began - sum(seconds.values())
    known_by = sides.bodies, part, selection.T_world_scan[: len(views)], selection.anchor, size, effort
    joint = refined(views, *known_by, on_table=steps is not None, deadline=began + JOINT_SHARE * (time_limit or np.inf))
    if turned is not None and np.isfinite(joint.T_world_scan).any():
        joint = turned.widened(joint, selection.anchor)
        selection = dataclasses.replace(selection, edges=tuple(turned.freed(selection.edges)))
    seconds["joint"] = time.perf_counter() - began - sum(seconds.values())
    views = sides.signed(views)
    overlap = overlap_matrix(views, joint.T_world_scan, size)
    against = tuple(sides.contradictions(joint.T_world_scan, overlap))
    started = all(known[k] is not None for k in usable)
    turns = turnings(views, joint.T_world_scan, selection.edges, turned, started=started)
    said = _said(views, known, judge, selection, joint.T_world_scan, order)
    asked = {"order": order, "edges": edges, "anchor": anchor, "effort": effort, "seed": seed, "time_limit": time_limit}
    settings = _settings(asked, runner, judge)
    result = assembled(views, selection, joint, overlap, settings, seconds, runner.stopped, against, turns, *said)
    log_verdict(result.verdict, f"{len(views)} scans into one frame", time.perf_counter() - began)
    return result


def _said(
    views: Sequence[View],
    known: Sequence[FloatArray | None],
    judge: Judge,
    selection: EdgeSelection,
    T_world_scan: FloatArray,
    order: Order,
) -> tuple[tuple[Reason, ...], tuple[Reason, ...]]:
    """Remarks, and doubts of all scans together: of starts, of strays, and of what stood still."""
    edges, started = selection.edges, all(T is not None for T, view in zip(known, views, strict=True) if view.usable)
    remarks = (*contradicted_starts(views, known, T_world_scan, edges, judge.size), *stray_remarks(views))
    still = unmoved_scans(views, edges, T_world_scan, order, started=started)
    assumed = () if judge.steps is None else judge.steps.doubts()
    return remarks, (*assumed, *still, *other_frame(views, judge.homes, judge.home, selection.anchor))


def _settings(asked: dict[str, Any], runner: PairRunner, judge: Judge) -> dict[str, Any]:
    """What was asked for, and what came of it before any pose: for the result's file."""
    part = runner.part
    return {
        **asked,
        "asked_anchor": asked["anchor"],
        "edges": asked["edges"] if isinstance(asked["edges"], str) else "given",
        "target": None if part is None else part.indexed.name,
        "units": unit_of(runner.views) if part is None or part.indexed.units is None else part.indexed.units,
        "size": judge.size,
        "floor": judge.floor,
        "viewpoints": [None if image is None else image.eye.tolist() for image in judge.sides.free.images],
    }


def _selection(
    runner: PairRunner, judge: Judge, found: Sequence[Edge], turned: RoundPart | None, *, automatic: bool
) -> tuple[Judge, EdgeSelection]:
    """Which edges and scans are believed: what fits nowhere is left out."""
    selection = judge(found)
    if turned is not None:
        # The others refuse what is laid by angles that nobody knows.
        return without_contradicting_scans(judge, selection)
    judge, selection = without_passed_scans(judge, selection)
    judge, selection = without_contradicting_scans(*by_consensus(runner, judge, selection))
    if automatic:
        judge, selection = without_contradicting_scans(
            judge, with_overlapping_pairs(runner, selection, judge, judge.size)
        )
    judge, selection = without_passed_scans(judge, selection)
    if judge.steps is not None and judge.steps.assumed:
        # Views that hardly hold each other stand too far off for that: all together they hold each other.
        return judge, selection
    judge, selection = without_misfits(runner.views, judge, selection, runner.effort, runner.seed)
    starts = joined_by_starts(selection, judge.homes, judge.size, judge.floor)
    if starts is None:
        return judge, selection
    started = dataclasses.replace(judge, steps=starts)
    trial = without_passed_scans(*without_contradicting_scans(started, started(selection.edges)))
    return max((judge, selection), trial, key=lambda each: placed_of(each[1]))


def _homes(views: Sequence[View], anchor: int, known: Sequence[FloatArray | None]) -> tuple[int, dict[int, FloatArray]]:
    """The scan that is held, of copies the first, and the poses of all that have one."""
    copied = views[anchor].copy_of
    home, homes = anchor if copied is None else copied, {k: T for k, T in enumerate(known) if T is not None}
    given = known[anchor]
    return home, homes if given is None else {**homes, home: given}


def _checked(effort: Any, seed: Any, time_limit: Any, observe: Any) -> float | None:
    """The limit as a number, if all are what `dqreg.register` takes as well."""
    require_word("effort", effort, get_args(Effort))
    require_seed(seed)
    require_observer(observe, "observe")
    return read_time_limit(time_limit)


def _check_anchor(anchor: Any, count: int) -> None:
    if not is_whole(anchor) or not 0 <= anchor < count:
        raise InputError(f"anchor must be the number of a scan, 0 to {count - 1}; got {anchor!r:.60}")


def _made(folder: str | Path | None) -> Path | None:
    if folder is None:
        return None
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot keep the pairs in {path}: {error.strerror or error}") from error
    return path
