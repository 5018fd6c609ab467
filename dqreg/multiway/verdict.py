"""The verdict on all scans together: accepted only if each hangs on edges to be believed, and loops close."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.loose_scans import put_elsewhere, unconfirmed, used_loops, weakly_held
from dqreg.multiway.pose_graph.edges import PART, Edge, centre_of
from dqreg.multiway.scan_names import NAMED_SCANS, named, pairs_named
from dqreg.multiway.scans.scans import View
from dqreg.multiway.selection.consistent_set import SAME_RAD, SAME_SHIFT_SIZES
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.multiway.turntables.rotational_symmetry import UnobservableRotation
from dqreg.multiway.unplaced_scans import errors, unplaced
from dqreg.multiway.visibility.sides import Contradiction
from dqreg.rigid import pose
from dqreg.solvers.motion_words import axis_words
from dqreg.trust.code_sets import OF_ANOTHER_SHAPE, VIEWPOINT_OFF
from dqreg.trust.limits import MAX_SIGMA_DIAGONALS, MAX_SIGMA_RAD
from dqreg.trust.records import Level, Reason, Verdict

# Pairs that can tell whether the viewpoints are right, at least, and the share of them that may contradict these: where
# they are right it came to 0.09 at most, with all of them on the far side to 0.6.
MIN_TELLING_PAIRS, MAX_CONTRADICTING_SHARE = 3, 1 / 3
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
    doubts += [*unplaced(*known), *weakly_held(*known), *unconfirmed(*known), *put_elsewhere(*known)]
    doubts += _uncertain(views, placed, covariances, size) if joined and not is_late else ()
    doubts += _contradicted(views, against)
    doubts += _turned(views, turns)
    doubts += _viewpoints(views, selection)
    doubts += _deformed(views, selection, T_world_scan, size)
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
    closing = int(np.count_nonzero(used_loops(selection)))
    loops = "; no loop of three checks them"
    if closing:
        loops = f"; {closing} {'loops' if closing > 1 else 'loop'} of three {'close' if closing > 1 else 'closes'}"
    return Reason(f"{len(placed)} scans placed by {used} edge{'s' * (used != 1)}{loops}", "accepted")


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


def _deformed(
    views: Sequence[View], selection: EdgeSelection, T_world_scan: FloatArray, size: float
) -> Iterator[Reason]:
    """Scans that their own pairs call stretched or bent; of both ends of a pair the one with more of these is meant.

    So do pairs left out that come near the pose of all, and accepted ones among them that contradict it: a scan that is
    bent fits each other one a little elsewhere.
    """
    own = [
        edge for edge in selection.edges if edge.target != PART and (edge.used or _is_near(edge, T_world_scan, size))
    ]
    told = [edge for edge in own if _is_of_another_shape(edge)]
    told += [edge for edge in own if edge.code == "contradicts" and edge.level == "accepted"]
    found = []
    while any(map(_is_of_another_shape, told)):
        counts = Counter(k for edge in told for k in (edge.target, edge.source))
        worst = max(counts, key=lambda k: (counts[k], k))
        of_worst = [edge for edge in told if worst in (edge.target, edge.source)]
        whole = sum(worst in (edge.target, edge.source) for edge in own)
        enough = len(of_worst) >= MIN_DEFORMED_PAIRS and len(of_worst) >= MIN_DEFORMED_SHARE * whole
        if enough and any(map(_is_of_another_shape, of_worst)):
            found.append(f"{views[worst].name} ({len(of_worst)} of {whole} pairs)")
        told = [edge for edge in told if edge not in of_worst]
    if found:
        yield Reason(
            f"{', '.join(found[:NAMED_SCANS])}: the shape differs from that of the scans that overlap there, by a "
            "scale, a bend or waves: calibrate the scanner, clamp the part anew, or leave the scan out",
            "deformed_scan",
        )


def _is_of_another_shape(edge: Edge) -> bool:
    return bool(OF_ANOTHER_SHAPE & set(edge.registration.verdict.codes))


def _is_near(edge: Edge, T_world_scan: FloatArray, size: float) -> bool:
    """Whether a pair comes near the pose that all scans together have."""
    T = pose.inverse(T_world_scan[edge.target]) @ T_world_scan[edge.source]
    if not edge.found or not np.isfinite(T).all():
        return False
    measured, middle = edge.registration.T_target_source, pose.apply(pose.inverse(T), centre_of(edge.registration))
    is_turned = pose.angle_between(measured, T) > SAME_RAD
    return not is_turned and bool(pose.offset_between(measured, T, at=middle) <= SAME_SHIFT_SIZES * size)


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
