"""Scans that could not be placed and pairs that could not be registered, and why: the words of a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dqreg.multiway.edge_selection import EdgeSelection
from dqreg.multiway.edges import EdgeCode, ended_in_error
from dqreg.multiway.scan_names import named, pairs_named
from dqreg.multiway.scans import View
from dqreg.trust.records import Reason

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
            alone.setdefault(_why_alone(selection, group[0]), []).append(group[0])
    for why, scans in alone.items():
        verb = "is" if len(scans) == 1 else "are each"
        yield Reason(f"{named(views, scans)} {verb} joined to no other scan: {why}", "scan_left_out")


def _why_apart(selection: EdgeSelection, group: Sequence[int]) -> str:
    if _all_in_error(selection, group):
        return "the registrations between ended in errors"
    other = ", or they show another object" if any(_has(selection, k, "misfit") for k in group) else ""
    return f"scan the part between{other}"


def _why_alone(selection: EdgeSelection, k: int) -> str:
    if _all_in_error(selection, [k]):
        return "the registrations to others ended in errors"
    if _has(selection, k, "looked_through"):
        return "where its pairs put it, the scanners of other scans looked through: another object, or wrong pairs"
    if _has(selection, k, "misfit"):
        return "where its pairs put it, it does not fit all others together: another object, moved, or wrong pairs"
    if _has(selection, k, "ambiguous"):
        return "it fits all others together in several ways, or too little holds it: scan more overlap, or give starts"
    return "another object, or too little overlap"


def _all_in_error(selection: EdgeSelection, group: Sequence[int]) -> bool:
    """Whether all pairs of some scans with others that were tried ended in errors: nothing else is known of them."""
    tried = [
        ended_in_error(edge)
        for edge in selection.edges
        if (edge.target in group) != (edge.source in group) and edge.code != "untried"
    ]
    return bool(tried) and all(tried)


def _has(selection: EdgeSelection, k: int, code: EdgeCode) -> bool:
    """Whether an edge of a scan was left out for a reason."""
    return any(edge.code == code and k in (edge.target, edge.source) for edge in selection.edges)


def errors(views: Sequence[View], selection: EdgeSelection) -> Iterator[Reason]:
    """The errors in which registrations ended, each with its pairs."""
    found: dict[str, list[tuple[int, int]]] = {}
    for edge in filter(ended_in_error, selection.edges):
        found.setdefault(str(edge.registration.verdict.reasons[0]), []).append((edge.target, edge.source))
    for words, pairs in list(found.items())[:TOLD_ERRORS]:
        yield Reason(f"{pairs_named(views, pairs)}: {words}", "unreadable")
