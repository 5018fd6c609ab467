"""What of a report a plan asks for: its parts, which of the sections are drawn, and from where the part is shown."""

from __future__ import annotations

import dataclasses
from typing import Any

from dqreg.errors import InputError
from dqreg.inspection.plan.keys import number_of, require_known, require_one_of

# Parts of a report that a plan may choose among, in their order on the page. Head, decisions and characteristics always
# stand there, and so do the digests of both files: a sheet without them could not be signed.
PARTS = ("view", "deviations", "regions", "sections", "faces", "checks", "uncertainty", "pose", "run")
# Points of view with a name; others are two angles.
VIEWS = ("best", "front", "right", "back", "left", "top", "bottom", "iso", "iso-right", "iso-back", "iso-left",
         "iso-below", "iso-below-back")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class PlannedReport:
    """What the report shows beside its head, decisions and characteristics.

    Attributes
    ----------
    parts : tuple of str
        Parts of the page, in their order on it: "view", "deviations", "regions", "sections", "faces", "checks",
        "uncertainty", "pose", "run".
    cuts : tuple of str or None
        Names of the sections that are drawn; None: all.
    views : tuple of str
        Points of view of the pictures in print: names, or "yaw/pitch" in degrees; none: those that show most.
    """

    parts: tuple[str, ...] = PARTS
    cuts: tuple[str, ...] | None = None
    views: tuple[str, ...] = ()

    def draws(self, name: str) -> bool:
        """Whether the report shows a section.

        Parameters
        ----------
        name : str
            Of the section in the plan.

        Returns
        -------
        bool
            True where no cuts are chosen.

        Examples
        --------
        >>> PlannedReport().draws("A-A"), PlannedReport(cuts=("B-B",)).draws("A-A")
        (True, False)
        """
        return self.cuts is None or name in self.cuts


def planned_report(values: dict[str, Any], sections: tuple[str, ...], name: str) -> PlannedReport:
    """The ``report`` table of a plan, given the names of its sections."""
    where = f"{name}: report"
    table = values.get("report", {})
    require_known(table, ("parts", "cuts", "views"), where)
    parts = _names(table, "parts", PARTS, where)
    cuts = _names(table, "cuts", sections, where)
    if cuts and parts is not None and "sections" not in parts:
        raise InputError(f'{where}: cuts are given, but parts leave out "sections", which would show them')
    views = tuple(_view(each, where) for each in _list(table, "views", where))
    if parts is None:
        return PlannedReport(cuts=cuts, views=views)
    return PlannedReport(tuple(part for part in PARTS if part in parts), cuts, views)


def _names(table: dict[str, Any], key: str, known: tuple[str, ...], where: str) -> tuple[str, ...] | None:
    if key not in table:
        return None
    found = _list(table, key, where)
    for each in found:
        require_one_of(each, known, f"{where}: {key}")
    return tuple(found)


def _list(table: dict[str, Any], key: str, where: str) -> list[Any]:
    found = table.get(key, [])
    if not isinstance(found, list):
        raise InputError(f"{where}: {key} is a list of names; got {found!r:.60}")
    return found


def _view(given: Any, where: str) -> str:
    if isinstance(given, list) and len(given) == 2:
        yaw, pitch = (number_of({"views": each}, "views", where) for each in given)
        return f"{yaw:g}/{pitch:g}"
    require_one_of(given, VIEWS, f"{where}: views")
    return str(given)
