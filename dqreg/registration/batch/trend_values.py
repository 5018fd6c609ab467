"""Values of the parts of a batch, and which of them are the same value of a drawing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dqreg.registration.batch.line import Line

    # A part, the place of the value among those of the part, from 1, and the value as `Inspected.record` has it
    Row = tuple[Line, int, dict[str, Any]]

# Kinds of values of a decision: which faces have one differs from part to part, and so does their place.
OF_DECISION = ("share", "deviation")
# Kinds whose nominal value, and with it the limits, may be of another place on each part.
MOVING = ("thickness",)


def values_of(lines: Iterable[Line]) -> Iterator[Row]:
    """Every value of every part."""
    for line in lines:
        if line.inspection is not None:
            for number, value in enumerate(line.inspection["values"], 1):
                yield line, number, value


def unit_of(line: Line, value: dict[str, Any]) -> str:
    """Unit of a value; "" where it is not known."""
    assert line.inspection is not None
    return {"angle": "degree", "share": "%"}.get(str(value["kind"]), str(line.inspection["units"] or ""))


def key_of(row: Row) -> tuple[object, ...]:
    """The same for two rows where they are one value of one drawing, in one unit and within the same limits."""
    line, number, value = row
    kind = str(value["kind"])
    place = 0 if kind in OF_DECISION else number
    # Those of a tapered wall are of the place where it is worst, and there are none where it was not scanned.
    limits = () if kind in MOVING else (value["low"], value["high"])
    return line.drawing, place, str(value["name"]), kind, unit_of(line, value), *limits


def followed(rows: Sequence[Row]) -> list[Row]:
    """Rows of one key with one nominal value: where theirs differ, each value from its own."""
    nominals = {value["nominal"] for _, _, value in rows} - {None}
    if len(nominals) > 1 and rows[0][2]["kind"] in MOVING:
        rows = [(line, number, _from_nominal(value)) for line, number, value in rows]
    # The first with limits says those of the trend.
    return sorted(rows, key=lambda row: row[2]["nominal"] is None)


def _from_nominal(value: dict[str, Any]) -> dict[str, Any]:
    name = f"{value['name']}, from its nominal value"
    nominal = value["nominal"]
    if nominal is None:
        return {**value, "name": name}
    # Digits that a difference leaves are noise.
    numbers = {key: None if (x := value[key]) is None else float(f"{x - nominal:.6g}") for key in ("low", "high")}
    measured = None if value["value"] is None else value["value"] - nominal
    return {**value, "name": name, "nominal": 0.0, **numbers, "value": measured}


def drawing_words(lines: Sequence[Line]) -> dict[tuple[str, str], str]:
    """What each drawing of a batch is called, in the order of the manifest; "" where there is but one."""
    # By the first row of each: others may have a copy of its files.
    rows = {line.drawing: line.row for line in reversed(lines)}
    rows = {line.drawing: rows[line.drawing] for line in lines}
    targets = {target: row.target for (target, _), row in rows.items()}
    alike = len({path.name for path in targets.values()}) < len(targets)
    words = {}
    for drawing, row in rows.items():
        plans = {plan for target, plan in rows if target == drawing[0]}
        of = f"{row.target.parent.name}/{row.target.name}" if alike else row.target.name
        by = f" by {row.asked.plan.name if row.asked.plan else 'its tolerance'}" if len(plans) > 1 else ""
        words[drawing] = of + by if len(rows) > 1 else ""
    return words
