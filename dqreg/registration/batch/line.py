"""One row of a batch in its summary."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from dqreg.errors import DqregError
from dqreg.files.file_digests import digest_of
from dqreg.files.units import factor
from dqreg.registration.batch.row import BATCH, Row, RowResult
from dqreg.trust.records import Reason

# Folders of what each row left.
RESULTS, REPORTS = "results", "reports"


@dataclasses.dataclass(frozen=True)
class Line:
    """One row in the summary."""

    row: Row  # What was asked
    verdict: str  # "accepted", "suspect" or "failed" where it ran; else "not run" or a `Status`
    reasons: tuple[str, ...]  # Of the verdict, or what went wrong
    # rms, inlier_fraction, seconds: As in `Registration`; NaN where there is none
    rms: float = math.nan
    inlier_fraction: float = math.nan
    seconds: float = math.nan
    # Translation, then the rotation as a quaternion w, x, y, z; NaN where there is none
    pose: tuple[float, ...] = (math.nan,) * 7
    kept: bool = False  # Whether the result is of an earlier session
    unit: str = ""  # Of its lengths; "" where it is not known
    scale: float = math.nan  # That was solved for; NaN where none was
    inspection: Mapping[str, Any] | None = None  # As `Inspected.record` has it; None where nothing was asked
    inputs: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # As `inputs_of` has them, where it ran

    @property
    def part(self) -> str:
        """Whether the part passes: "pass", "fail", "undecided", or "" where that was not asked."""
        return "" if self.inspection is None else str(self.inspection["outcome"])

    @cached_property
    def drawing(self) -> tuple[str, str]:
        """Digests of the target and the plan, which tell what its values are of whatever these files are called.

        Of what was read, or of what is there; their paths where nothing is.
        """
        plan = (self.inputs.get("inspection") or {}).get("plan")
        return _drawn(self.row.target, self.inputs.get("target")), _drawn(self.row.asked.plan, plan)

    def figure(self, name: str) -> float:
        """A figure of the inspection, as `Inspected.record` calls it; NaN where there is none."""
        return _number((self.inspection or {}).get("figures", {}).get(name))

    @property
    def result(self) -> str:
        """Result of the row, from the folder of the summary; "" where it has none."""
        return f"{RESULTS}/{self.row.name}.json" if self.ran else ""

    @property
    def report(self) -> str:
        """Page of the row, from the folder of the summary; "" where it has none."""
        return f"{REPORTS}/{self.row.name}.html" if self.ran and self.row.asked.report else ""

    @property
    def link(self) -> str:
        """What the row's name leads to: its report, or its result."""
        return self.report or f"{RESULTS}/{self.row.name}.json"

    @property
    def ran(self) -> bool:
        """Whether there is a result file."""
        return self.verdict in ("accepted", "suspect", "failed")


def line_of(row: Row, done: RowResult, *, kept: bool = False) -> Line:
    """Line of a row."""
    record = done.record
    if record is None:
        return Line(row, done.status, (done.message,))
    shown = record[BATCH].get("shown") or {"units": (record.get("settings") or {}).get("target_units")}
    return Line(
        row=row,
        verdict=record["verdict"]["level"],
        reasons=_reasons(record["verdict"]),
        rms=_number(shown.get("rms", record["rms"])),
        inlier_fraction=_number(record["inlier_fraction"]),
        seconds=_number(record[BATCH]["seconds"]),
        pose=_pose(record),
        kept=kept,
        unit=str(shown["units"] or ""),
        scale=_number(record.get("scale")) if (record.get("settings") or {}).get("scale_solved") else math.nan,
        inspection=record[BATCH].get("inspection"),
        inputs=record[BATCH].get("inputs") or {},
    )


def _drawn(path: Path | None, known: list[Any] | None) -> str:
    if path is None:
        return ""
    try:
        return str((known or digest_of(path))[2])
    except (DqregError, OSError):
        return str(path)


def _reasons(verdict: dict[str, Any]) -> tuple[str, ...]:
    """Sentences with their codes; a kept result of old has none."""
    sentences = verdict["reasons"]
    codes: list[Any] = verdict.get("codes") or [""] * len(sentences)
    return tuple(Reason(words, code) for words, code in zip(sentences, codes, strict=True))


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _pose(record: dict[str, Any]) -> tuple[float, ...]:
    parts = record["dual_quaternion"]
    if parts is None:
        return (math.nan,) * 7
    shown = record[BATCH].get("shown")
    k = 1.0 if shown is None else factor(record["settings"]["target_units"], shown["units"])
    return (*(k * float(row[3]) for row in record["T_target_source"][:3]), *map(float, parts["real"]))
