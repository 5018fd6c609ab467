"""The tables of a multiway result: scans, pairs, loops, and what to scan again."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.edges import PART, was_cut_off
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.multiway.report.result_protocol import ManyScans
from dqreg.report.table import Column, Table

# Loops listed in a report, the worst first; the JSON file holds all.
MAX_LISTED_LOOPS = 20
# A scan placed by fewer used pairs than this hangs by a thread.
MIN_USED_PAIRS = 2


def sigmas(result: ManyScans) -> FloatArray:
    """Largest standard deviation of the rotation (degrees) and of the translation of each scan, (n, 2)."""
    variances = np.einsum("kii->ki", result.covariances)
    roots = np.sqrt(np.maximum(variances, 0.0))
    return np.column_stack([np.rad2deg(roots[:, :3].max(axis=1)), roots[:, 3:].max(axis=1)])


def name_of(result: ManyScans, node: int) -> str:
    """Name of a node."""
    return "part" if node == PART else result.names[node]


def unit_of(result: ManyScans) -> str:
    """Length unit of the poses; empty where no file names it, and of results of old."""
    return result.settings.get("units") or ""


def unit_note(result: ManyScans) -> str:
    """What a reader must know of lengths without a unit."""
    return "" if unit_of(result) else " Lengths are in the unit of the scans, which no file names."


def scans_table(result: ManyScans) -> Table:
    """One row a scan."""
    spread = sigmas(result)
    rows = []
    for k, name in enumerate(result.names):
        own = [edge for edge in result.edges if k in (edge.target, edge.source)]
        used = [edge for edge in own if edge.used]
        row = result.overlap[k].copy()
        row[k] = np.nan
        best = float(np.nanmax(row)) if np.isfinite(row).any() else np.nan
        state = "placed" if k in result.placed else "NOT PLACED"
        rows.append(
            (
                name,
                state if k != result.settings.get("anchor") else "anchor",
                len(used),
                sum(edge.level == "accepted" for edge in used),
                100.0 * best,
                float(np.median([edge.registration.rms for edge in used])) if used else np.nan,
                float(spread[k, 0]),
                float(spread[k, 1]),
            )
        )
    columns = (
        Column("scan"),
        Column("state"),
        Column("pairs used", align="right"),
        Column("of them accepted", align="right"),
        Column("largest overlap", "%", spec=".0f", align="right"),
        Column("rms of its pairs", unit_of(result), spec=".2g", align="right"),
        Column("sigma of rotation", "deg", spec=".2g", align="right"),
        Column("sigma of translation", unit_of(result), spec=".2g", align="right"),
    )
    home = "part" if result.settings.get("anchor") == PART else "anchor"
    note = (
        f"Sigmas: one standard deviation against the {home}, about the middle of all scans. Rms: the median of used "
        f"pairs.{unit_note(result)}"
    )
    return Table("scans", "Scans", columns, tuple(rows), note)


def pairs_table(result: ManyScans) -> Table:
    """One row a pair that was registered: those used first."""
    order = {"used": 0, "confirmed": 1, "contradicts": 2, "elsewhere": 3}
    edges = sorted(result.edges, key=lambda edge: (order.get(edge.code, 4), edge.target, edge.source))
    rows = tuple(
        (
            f"{name_of(result, edge.target)} - {name_of(result, edge.source)}",
            edge.level,
            f"{edge.why}, beyond its covariance" if edge.used and edge.chi2 > CHI2_LIMIT else edge.why,
            100.0 * edge.overlap,
            edge.chi2,
            edge.registration.rms,
            ", ".join(edge.registration.verdict.codes),
        )
        for edge in edges
    )
    columns = (
        Column("pair"),
        Column("verdict of the pair"),
        Column("in the graph", wraps=True),
        Column("overlap", "%", spec=".0f", align="right"),
        Column("chi-square of 6", spec=".3g", align="right"),
        Column("rms", unit_of(result), spec=".3g", align="right"),
        Column("reasons", wraps=True),
    )
    note = (
        "Chi-square: how far the pair's own pose is from that of all scans together, in units of its covariance; about "
        "6 where that tells all. A used pair beyond its covariance goes out as a factor as much wider."
    )
    return Table("pairs", "Pairs", columns, rows, note)


def loops_table(result: ManyScans) -> Table:
    """The worst loops of used pairs."""
    loops = [loop for loop in result.loop_errors if loop.used and loop.sharp][:MAX_LISTED_LOOPS]
    rows = tuple(
        (
            " - ".join(name_of(result, node) for node in loop.scans),
            float(np.rad2deg(loop.rotation_rad)),
            loop.translation,
            loop.chi2,
        )
        for loop in loops
    )
    columns = (
        Column("loop"),
        Column("rotation", "deg", spec=".2g", align="right"),
        Column("translation", unit_of(result), spec=".2g", align="right"),
        Column("chi-square of 6", spec=".2g", align="right"),
    )
    note = "The poses of three pairs multiplied round a loop should give the identity; the worst loops of used pairs."
    return Table("loops", "Loop errors", columns, rows, note)


def rescans(result: ManyScans) -> list[str]:
    """What to scan again, or in addition, in sentences."""
    words, cut_off = [], []
    placed = set(result.placed)
    for k, name in enumerate(result.names):
        used = [edge for edge in result.edges if edge.used and k in (edge.target, edge.source)]
        tried = [edge for edge in result.edges if k in (edge.target, edge.source)]
        if any(was_cut_off(edge) for edge in tried) and (k not in placed or len(used) < MIN_USED_PAIRS):
            cut_off.append(name)
        elif k not in placed:
            best = ", ".join(name_of(result, e.target if e.source == k else e.source) for e in tried if e.found)
            words.append(
                f"{name}: not placed. Scan it again with a third or more of it in common with another scan"
                + (f" (it was compared with {best})" if best and len(tried) < 6 else "")
                + ", or leave it out if it shows something else."
            )
        elif len(used) < MIN_USED_PAIRS and len(placed) > 2:
            words.append(
                f"{name}: placed by one pair alone, which no loop checks. One more scan between would check it."
            )
    if cut_off:
        words.append(
            f"{', '.join(cut_off)}: not all of their pairs were registered before the end of the run. Run it again "
            "with more time before you scan anything again: --resume keeps the pairs that are there."
        )
    return words
