"""A saved visit done again without the page: the same files, the same figures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from dqreg.studio.visit import Visit

if TYPE_CHECKING:
    from dqreg.registration.result import Registration


def replay(visit: str | os.PathLike[str] | Visit, folder: str | os.PathLike[str] = ".") -> Registration:
    """Do a visit again, and write its cleaned scan, pose, plan and report to a folder."""
    from dqreg.studio.aligning import result_of
    from dqreg.studio.judging import write_sheet
    from dqreg.studio.worker_cache import Place, forget

    found = visit if isinstance(visit, Visit) else Visit.load(Path(visit))
    # Done again means all of it, in a process that has done it before too.
    forget()
    goal = Path(folder)
    goal.mkdir(parents=True, exist_ok=True)
    place = Place(goal.absolute(), found)
    write_sheet(place)
    for name in ("progress.jsonl", "result_of.json"):
        (goal / name).unlink(missing_ok=True)
    return result_of(place)
