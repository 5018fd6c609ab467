"""A saved visit done again without the page: the same files, the same figures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from dqreg.studio.visit import Visit

if TYPE_CHECKING:
    from dqreg.registration.result.part_inspection import Inspected
    from dqreg.registration.result.result import Registration
    from dqreg.studio.worker_cache import Place


def replay(visit: str | os.PathLike[str] | Visit, folder: str | os.PathLike[str] = ".") -> Registration:
    """Do a visit again, and write its cleaned scan, pose, plan and report to a folder."""
    from dqreg.studio.aligning import result_of

    inspected_again(visit, folder)
    return result_of(_place(visit, folder))


def inspected_again(
    visit: str | os.PathLike[str] | Visit, folder: str | os.PathLike[str]
) -> tuple[Inspected, str | None]:
    """The same, and what was found: the part under its alignment, and its outcome where the visit judges it."""
    from dqreg.studio.alignments import judged
    from dqreg.studio.judging import write_sheet
    from dqreg.studio.plans import is_judged
    from dqreg.studio.worker_cache import forget

    # Done again means all of it, in a process that has done it before too.
    forget()
    place = _place(visit, folder)
    place.folder.mkdir(parents=True, exist_ok=True)
    write_sheet(place)
    found = judged(place)
    for name in ("progress.jsonl", "result_of.json"):
        (place.folder / name).unlink(missing_ok=True)
    return found, found.outcome if is_judged(place.visit) else None


def _place(visit: str | os.PathLike[str] | Visit, folder: str | os.PathLike[str]) -> Place:
    from dqreg.studio.worker_cache import Place

    found = visit if isinstance(visit, Visit) else Visit.load(Path(visit))
    return Place(Path(folder).absolute(), found)
