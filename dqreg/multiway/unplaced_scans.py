"""Scans that could not be placed and pairs that could not be registered, and why: the words of a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dqreg.files.units import factor
from dqreg.multiway.pose_graph.edges import PART, EdgeCode, ended_in_error, is_refused, was_cut_off
from dqreg.multiway.scan_names import named, pairs_named
from dqreg.multiway.scans.scans import View, size_of
from dqreg.multiway.selection.edge_selection import EdgeSelection
from dqreg.trust.code_sets import HARDLY_HELD
from dqreg.trust.records import Reason

# Units that are confused, those most often first; and how far the ratio of sizes may be off theirs: scans of one place
# may be half as large as the others, and small ratios are told of what is near them alone.
UNITS = ("m", "mm"), ("inch", "mm"), ("m", "ft"), ("m", "inch"), ("m", "cm")
WIDE_RATIO, NARROW_SLACK = 5.0, 1.25
UNIT_SLACK = 0.6, 1.7
# Errors of pairs that are told, of those that differ.
TOLD_ERRORS = 3


def unplaced(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int]) -> Iterator[Reason]:
    """Scans that stand nowhere: those that cannot be used, those joined to each other alone, those by themselves."""
    for view in views:
        if view.problem:
            yield Reason(f"{view.name} cannot be used: {view.problem}", "unreadable")
    islands: dict[int, list[int]] = {}
    for k, view in enumerate(views):
        if view.usable and k not in placed:
            islands.setdefault(int(selection.island[k]), []).append(k)
    alone: dict[str, list[int]] = {}
    for group in islands.values():
        if len(group) > 1:
            yield Reason(
                f"{named(views, group)} are joined to each other and not to the rest: {_why_apart(selection, group)}",
                "islands",
            )
        else:
            alone.setdefault(_why_alone(views, selection, placed, group[0]), []).append(group[0])
    for why, scans in alone.items():
        verb = "is" if len(scans) == 1 else "are each"
        yield Reason(f"{named(views, scans)} {verb} joined to no other scan: {why}", "scan_left_out")


def _why_apart(selection: EdgeSelection, group: Sequence[int]) -> str:
    if _all_in_error(selection, group) or _apart_from_part(selection):
        return "the registrations between ended in errors"
    other = ", or they show another object" if any(_has(selection, k, "misfit") for k in group) else ""
    return f"scan the part between{other}"


def _why_alone(views: Sequence[View], selection: EdgeSelection, placed: Sequence[int], k: int) -> str:
    if _all_in_error(selection, [k]) or _apart_from_part(selection):
        return "the registrations to others ended in errors"
    if any(was_cut_off(edge) for edge in selection.edges if k in (edge.target, edge.source)):
        return "not all of its pairs were registered before the end of the run"
    units = _units_words(views, [j for j in placed if j != k], k)
    if units:
        return units
    if _has(selection, k, "looked_through"):
        return "where its pairs put it, the scanners of other scans looked through: another object, or wrong pairs"
    if _has(selection, k, "misfit"):
        return "where its pairs put it, it does not fit all others together: another object, moved, or wrong pairs"
    if _has(selection, k, "ambiguous"):
        return "it fits all others together in several ways, or too little holds it: scan more overlap, or give starts"
    loose, count = _loose_pairs(selection, k)
    if loose:
        return (
            f"{loose} of its {count} pairs leave a motion nearly free, and no loop confirms them: scan more overlap, "
            "with a third face, or give starts"
        )
    return "another object, or too little overlap"


def _loose_pairs(selection: EdgeSelection, k: int) -> tuple[int, int]:
    """Pairs of a scan that too little holds, where these are half of those found; and how many were found."""
    own = [edge for edge in selection.edges if edge.found and k in (edge.target, edge.source)]
    loose = [
        edge
        for edge in own
        if edge.code in ("unconfirmed", "uncertain")
        and not is_refused(edge)
        and HARDLY_HELD & set(edge.registration.verdict.codes)
    ]
    return (len(loose), len(own)) if 2 * len(loose) >= len(own) else (0, len(own))


def _units_words(views: Sequence[View], others: Sequence[int], k: int) -> str:
    """What a scan's size says of its unit; nothing where it is as large as the others or units do not explain it."""
    sizes = [size_of(views[j]) for j in others]
    if not sizes or views[k].cloud is None:
        return ""
    size, usual = size_of(views[k]), sorted(sizes)[len(sizes) // 2]
    ratio = max(size, usual) / max(min(size, usual), np.finfo(float).tiny)
    for coarse, fine in UNITS:
        low, high = UNIT_SLACK if factor(coarse, fine) > WIDE_RATIO else (1.0 / NARROW_SLACK, NARROW_SLACK)
        if low < ratio / factor(coarse, fine) < high:
            more = "larger" if size > usual else "smaller"
            return (
                f"it is {ratio:.3g} times {more} than the others, close to the ratio of {coarse} and {fine}: "
                "its unit may be another one. Convert it"
            )
    return ""


def _all_in_error(selection: EdgeSelection, group: Sequence[int]) -> bool:
    """Whether all pairs of some scans with others that were tried ended in errors: nothing else is known of them."""
    tried = [
        ended_in_error(edge)
        for edge in selection.edges
        if (edge.target in group) != (edge.source in group) and edge.code != "untried"
    ]
    return bool(tried) and all(tried)


def _apart_from_part(selection: EdgeSelection) -> bool:
    """Whether all registrations to the part ended in errors, as those of another unit do."""
    on_part = [ended_in_error(edge) for edge in selection.edges if edge.target == PART and edge.code != "untried"]
    return bool(on_part) and all(on_part)


def _has(selection: EdgeSelection, k: int, code: EdgeCode) -> bool:
    """Whether half of the pairs of a scan were left out for a reason: of one the other scan may be at fault."""
    own = [edge.code == code for edge in selection.edges if edge.found and k in (edge.target, edge.source)]
    return any(own) and 2 * sum(own) >= len(own)


def errors(views: Sequence[View], selection: EdgeSelection) -> Iterator[Reason]:
    """The errors in which registrations ended, each with its pairs."""
    found: dict[str, list[tuple[int, int]]] = {}
    for edge in filter(ended_in_error, selection.edges):
        found.setdefault(str(edge.registration.verdict.reasons[0]), []).append((edge.target, edge.source))
    for words, pairs in list(found.items())[:TOLD_ERRORS]:
        yield Reason(f"{pairs_named(views, pairs)}: {words}", "unreadable")
