"""The verdict on all scans together: accepted only if each hangs on edges to be believed, and loops close."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import scipy.sparse as sparse

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.multiway.pose_graph.edges import PART, Edge, is_refused
from dqreg.multiway.scan_names import NAMED_SCANS, named, pairs_named
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.turntables.rotational_symmetry import UnobservableRotation
from dqreg.multiway.unplaced_scans import errors, unplaced
from dqreg.multiway.visibility.sides import Contradiction
from dqreg.solvers.motion_words import axis_words
from dqreg.trust.code_sets import OF_ANOTHER_SHAPE, VIEWPOINT_OFF
from dqreg.trust.limits import MAX_SIGMA_DIAGONALS, MAX_SIGMA_RAD
from dqreg.trust.records import Level, Reason, Verdict

# Loops that confirm a scan none of whose edges is accepted.
MIN_CONFIRMING_LOOPS = 2
# Pairs that can tell whether the viewpoints are right, at least, and the share of them that may contradict these: where
# they are right it came to 0.09 at most, with all of them on the far side to 0.6.
MIN_TELLING_PAIRS, MAX_CONTRADICTING_SHARE = 3, 1 / 3
# Accepted pairs left out that agree on another place of a scan, as a share of those used at it, from which on nobody
# can tell which of them are wrong.
MAX_RIVAL_PAIRS_SHARE = 0.8
# Used pairs that say that a scan's shape is another one, at least, and their share of all of that scan.
MIN_DEFORMED_PAIRS, MIN_DEFORMED_SHARE = 2, 1 / 3
# A turn goes into a full one so many times, but for this share.
WHOLE_ORDER_SHARE = 0.01


def judge_scans(
    views: Sequence[View],
    selection: EdgeSelection,
    T_world_scan: FloatArray,
    covariances: FloatArray,
    size: float,
    *,
    converged: bool,
    stopped: str,
    is_late: bool = False,
    against: Sequence[Contradiction] = (),
    turns: Sequence[UnobservableRotation] = (),
    doubts: Sequence[Reason] = (),
) -> Verdict:
    """Level and reasons: "failed" where no two scans are joined, "suspect" where something speaks against a pose."""
    usable = [k for k, view in enumerate(views) if view.usable]
    placed = [k for k in usable if np.isfinite(T_world_scan[k]).all()]
    joined = len(placed) > 1 or (selection.anchor == PART and bool(placed))
    known = views, selection, placed
    doubts = list(doubts)
    if stopped:
        doubts.append(Reason(f"not all pairs were registered: {stopped} ended them", "search_time_limit"))
    doubts += [*unplaced(*known), *_weak(*known), *_unconfirmed(*known), *_put_elsewhere(*known)]
    doubts += _uncertain(views, placed, covariances, size) if joined and not is_late else ()
    doubts += _contradicted(views, against)
    doubts += _turned(views, turns)
    doubts += _viewpoints(views, selection)
    doubts += _deformed(views, selection)
    if not joined:
        nothing = Reason("no pose: no two scans could be joined", "no_pose")
        return Verdict("failed", (nothing, *doubts, *_notes(views, selection)))
    if is_late:
        late = "the time limit ended the joint refinement of all scans: their poses are those of the pairs"
        doubts.append(Reason(late, "not_converged"))
    elif not converged:
        doubts.append(Reason("the joint refinement of all scans did not converge", "not_converged"))
    level: Level = "suspect" if doubts else "accepted"
    summary = () if doubts else (_summary(selection, placed),)
    return Verdict(level, (*doubts, *summary, *_notes(views, selection)))


def _summary(selection: EdgeSelection, placed: Sequence[int]) -> Reason:
    used = sum(edge.used for edge in selection.edges)
    closing = int(np.count_nonzero(_used_loops(selection)))
    loops = "; no loop of three checks them"
    if closing:
        loops = f"; {closing} {'loops' if closing > 1 else 'loop'} of three {'close' if closing > 1 else 'closes'}"
    return Reason(f"{len(placed)} scans placed by {used} edge{'s' * (used != 1)}{loops}", "accepted")


def _used_loops(selection: EdgeSelection) -> BoolArray:
    used = np.array([selection.edges[row].used for row in selection.rows], dtype=bool)
    loops = selection.loops
    return loops.closes & used[loops.edges].all(axis=1) if len(loops.edges) else np.zeros(0, dtype=bool)


def _weak(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Scans that hang on suspect edges alone, which too few loops confirm, or on edges with other likely poses."""
    closing = selection.loops.counts(_used_loops(selection), len(selection.rows))
    confirmed = {int(row): int(n) for row, n in zip(selection.rows, closing, strict=True)}
    sure, ambiguous = set(), []
    for row, edge in enumerate(selection.edges):
        if edge.used and (edge.level == "accepted" or confirmed.get(row, 0) >= MIN_CONFIRMING_LOOPS):
            sure |= {edge.source, edge.target}
    weak = [k for k in placed if k not in sure]
    assumed = [k for k in weak if k in selection.on_steps]
    if assumed:
        yield Reason(
            f"{named(views, assumed)}: no pair is accepted by itself, and that they stand where equal steps of the "
            "table put them confirms the pose: what their pairs do not hold is assumed; scan more overlap there",
            "unconfirmed_scan",
        )
    weak = [k for k in weak if k not in assumed]
    if weak and len(placed) > 1:
        yield Reason(
            f"{named(views, weak)}: no pair is accepted by itself and fewer than {MIN_CONFIRMING_LOOPS} loops confirm "
            "the pose",
            "unconfirmed_scan",
        )
    for k in placed:
        own = [edge for edge in selection.edges if edge.used and k in (edge.source, edge.target)]
        if own and all(has_alternatives(edge) for edge in own):
            ambiguous.append(k)
    if ambiguous:
        yield Reason(
            f"{named(views, ambiguous)}: each pair has other poses that are equally likely (a symmetric part, or too "
            "little shape in the overlap)",
            "alternative_poses",
        )


def _put_elsewhere(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Scans that about as many accepted pairs, left out, put to one other place: they close loops with used pairs."""
    edges = [selection.edges[row] for row in selection.rows]
    used = np.array([edge.used for edge in edges], dtype=bool)
    left_out = np.array([edge.code == "contradicts" and edge.level == "accepted" for edge in edges], dtype=bool)
    triples = selection.loops.edges[selection.loops.closes]
    agree = (left_out[triples].sum(axis=1) == 2) & used[triples].any(axis=1)
    others: dict[int, set[int]] = {}
    for triple in triples[agree].tolist():
        pair = [row for row in triple if left_out[row]]
        one, other = ({edges[row].target, edges[row].source} for row in pair)
        others.setdefault((one & other).pop(), set()).update(pair)
    held = [sum(edge.used and k in (edge.target, edge.source) for edge in edges) for k in range(len(views))]
    doubted = [k for k in placed if len(others.get(k, ())) > MAX_RIVAL_PAIRS_SHARE * held[k]]
    if doubted:
        yield Reason(
            f"{named(views, doubted)}: about as many accepted pairs as hold them agree on another place; scan more "
            "overlap there, or leave out the pairs that are wrong",
            "alternative_poses",
        )


def _unconfirmed(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Pairs that nothing else makes up for, and that no closing loop confirms or whose own verdicts doubt them.

    Doubted pairs confirm each other where all are wrong alike: the two sides of a sheet on each other, from every side.
    """
    if len(placed) + (selection.anchor == PART) > 2:
        confirmed = set(selection.rows[selection.confirmed].tolist())
        sound = [edge for row, edge in enumerate(selection.edges) if edge.used and row in confirmed]
        yield from _single_links(views, selection, sound, "no closing loop confirms these pairs")
    sound = [edge for edge in selection.edges if edge.used and not is_refused(edge)]
    yield from _single_links(views, selection, sound, "the registration of each of these pairs is doubted")


def _single_links(views: Sequence[View], selection: EdgeSelection, sound: Sequence[Edge], why: str) -> Iterator[Reason]:
    """Used edges between groups of scans that sound ones do not join."""
    group = _joined(sound, len(views))
    alone = [edge for edge in selection.edges if edge.used and group[edge.target] != group[edge.source]]
    if alone:
        words = pairs_named(views, [(edge.target, edge.source) for edge in alone])
        yield Reason(f"{words}: {why}, and nothing else joins their scans: scan more overlap there", "unconfirmed_edge")


def _joined(edges: Sequence[Edge], count: int) -> IntArray:
    """Number of the connected part of each scan, and of the part in the last place, (n + 1,)."""
    ends = np.array([(edge.target % (count + 1), edge.source) for edge in edges]).reshape(-1, 2).astype(np.int64)
    links = sparse.coo_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(count + 1, count + 1))
    return np.asarray(sparse.csgraph.connected_components(links, directed=False)[1], dtype=np.int64)


def _contradicted(views: Sequence[View], against: Sequence[Contradiction]) -> Iterator[Reason]:
    """Pairs of placed scans that sides or lines of sight speak against."""
    words: dict[Literal["opposite_sides", "looked_through"], str] = {
        "opposite_sides": "saw the same surface from opposite sides, where they were placed: front and back of a sheet "
        "lie on each other",
        "looked_through": "stand, in part, where the scanner of the other one looked through",
    }
    for code, sentence in words.items():
        pairs = [(each.target, each.source) for each in against if each.code == code]
        if pairs:
            yield Reason(f"{pairs_named(views, pairs)}: these scans {sentence}", code)


def _turned(views: Sequence[View], turns: Sequence[UnobservableRotation]) -> Iterator[Reason]:
    """Rotations by which views can be turned unseen."""
    for turn in turns:
        about = axis_words(turn.point, turn.axis)
        if turn.frame is not None:
            yield Reason(
                f"in most pairs next to nothing holds the rotation about one axis (in {views[turn.frame].name}, "
                f"{about}): the part looks round, or the overlaps show too little of it; scan more overlap, put "
                "marks on it, or give starts",
                "alternative_poses",
            )
            continue
        if turn.angle_rad is None:
            same = f"however it is turned about {about}, but for about {100.0 * max(turn.telling, 0.0):.0f} % of a view"
        else:
            order = 2.0 * np.pi / turn.angle_rad
            fold = f" (order {order:.0f})" if abs(order - round(order)) < WHOLE_ORDER_SHARE * order else ""
            same = f"after a turn of {np.rad2deg(turn.angle_rad):.0f} degrees{fold} about {about}"
        words = {
            "step": "the angles are assumed: equal steps of a full turn, "
            f"{abs(np.rad2deg(turn.step_rad)):.4g} degrees, either way",
            "starts": "the angles are those of the starts",
            "wobble": "the angles follow from how its axis wobbles on the table, in equal steps",
            "pairs": "the angles are those at which pairs overlap most, and mean nothing",
        }
        advice = f"{words.get(turn.agreed, 'views can be turned by it unseen')}; put marks on the part, or give starts"
        yield Reason(f"the part looks the same {same}: {advice}", "alternative_poses")


def has_alternatives(edge: Edge) -> bool:
    """Whether other poses explain a pair about as well."""
    return bool(edge.registration.alternatives)


def _uncertain(views: Sequence[View], placed: Sequence[int], covariances: FloatArray, size: float) -> Iterator[Reason]:
    free = [k for k in placed if np.isnan(covariances[k]).any()]
    if free:
        yield Reason(f"{named(views, free)}: some motion is unconstrained by all overlaps together", "unconstrained")
    wide = []
    for k in placed:
        variances = np.diag(covariances[k])
        if (np.sqrt(variances[:3]) > MAX_SIGMA_RAD).any() or (
            np.sqrt(variances[3:]) > MAX_SIGMA_DIAGONALS * size
        ).any():
            wide.append(k)
    if wide:
        yield Reason(
            f"{named(views, wide)}: the pose is uncertain by more than {np.rad2deg(MAX_SIGMA_RAD):.0f} degrees or "
            f"{100 * MAX_SIGMA_DIAGONALS:.0f} % of a scan's size",
            "large_uncertainty",
        )


def _viewpoints(views: Sequence[View], selection: EdgeSelection) -> Iterator[Reason]:
    """Viewpoints that contradict most pairs, as those do from which the scans were seen through the part."""
    given = {k for k, view in enumerate(views) if view.cloud is not None and view.cloud.viewpoint is not None}
    telling = [
        edge.code == "looked_through" or "looked_through" in edge.registration.verdict.codes
        for edge in selection.edges
        if edge.found and {edge.target, edge.source} & given and set(edge.registration.verdict.codes) <= VIEWPOINT_OFF
    ]
    if len(telling) >= MIN_TELLING_PAIRS and np.mean(telling) > MAX_CONTRADICTING_SHARE:
        yield Reason(
            f"in {sum(telling)} of {len(telling)} pairs a scanner looked through what the other one saw, and nothing "
            "else speaks against them: the viewpoints may be wrong, as on the far side of the part. They are asked for "
            "in the frames of the scans",
            "wrong_viewpoint",
        )


def _deformed(views: Sequence[View], selection: EdgeSelection) -> Iterator[Reason]:
    """Scans that their own pairs call stretched or bent; of both ends of a pair the one with more of these is meant."""
    used = [edge for edge in selection.edges if edge.used and edge.target != PART]
    told = [edge for edge in used if OF_ANOTHER_SHAPE & set(edge.registration.verdict.codes)]
    found = []
    while told:
        counts = Counter(k for edge in told for k in (edge.target, edge.source))
        worst = max(counts, key=lambda k: (counts[k], k))
        whole = sum(worst in (edge.target, edge.source) for edge in used)
        if counts[worst] >= MIN_DEFORMED_PAIRS and counts[worst] >= MIN_DEFORMED_SHARE * whole:
            found.append(f"{views[worst].name} ({counts[worst]} of {whole} pairs)")
        told = [edge for edge in told if worst not in (edge.target, edge.source)]
    if found:
        yield Reason(
            f"{', '.join(found[:NAMED_SCANS])}: the shape differs from that of the scans that overlap there, by a "
            "scale, a bend or waves: calibrate the scanner, clamp the part anew, or leave the scan out",
            "deformed_scan",
        )


def _notes(views: Sequence[View], selection: EdgeSelection) -> Iterator[Reason]:
    """What a user should know, and what speaks against no pose."""
    copies = [k for k, view in enumerate(views) if view.copy_of is not None]
    if copies:
        words = ", ".join(f"{views[k].name} (of {views[views[k].copy_of or 0].name})" for k in copies[:NAMED_SCANS])
        yield Reason(f"copies of other scans, placed with them: {words}", "duplicate_scan")
    against = [edge for edge in selection.edges if edge.code == "contradicts" and edge.level == "accepted"]
    blind = [k for k, view in enumerate(views) if view.hidden > 0.0]
    if blind:
        share = 100.0 * float(np.median([views[k].hidden for k in blind]))
        yield Reason(
            f"{named(views, blind)}: the viewpoint is not where the scanner stood, and was not used: from there "
            f"{share:.0f} % of the points would stand behind others. It is asked for in the frame of the scan",
            "wrong_viewpoint",
        )
    if against:
        words = pairs_named(views, [(edge.target, edge.source) for edge in against])
        yield Reason(f"accepted pairs that contradict the others, left out: {words}", "contradicting_edge")
    yield from errors(views, selection)
