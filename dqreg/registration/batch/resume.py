"""The folder of a batch: one result file a row, from which an interrupted batch is resumed.

A row is done once its result file has its name, which it takes in one step; nothing else is kept about it. Files are
written by the one process that holds the folder's lock, never by workers: a worker that outlives its parent for a
moment can write nothing.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from dqreg.errors import DqregError, InputError
from dqreg.files.atomic import write_atomically
from dqreg.files.code_identity import code_identity
from dqreg.files.folder_lock import held_folder
from dqreg.files.json_records import read_json
from dqreg.registration.batch.line import REPORTS, RESULTS
from dqreg.registration.batch.row import BATCH, Row, RowResult, inputs_of
from dqreg.registration.result.part_inspection import require_record
from dqreg.registration.result.result import Registration

# ROWS names the rows of the last session, and is as old as its beginning.
THUMBNAILS, ROWS = "thumbnails", ".rows"
# What `write_atomically` leaves where it is killed.
LEFT_OVER = re.compile(r"\.[0-9a-f]{16}\.tmp")


class Folder:
    """Results of a batch on disk; made by `open_folder`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.outdated: set[str] = set()  # Names of rows that another dqreg, or other versions, have done

    def result(self, row: Row) -> Path:
        """Result file of a row."""
        return self.path / RESULTS / f"{row.name}.json"

    def thumbnail(self, row: Row) -> Path:
        """Picture of a row; it need not exist."""
        return self.path / THUMBNAILS / f"{row.name}.jpg"

    def report(self, row: Row) -> Path:
        """Page of a row; it need not exist."""
        return self.path / REPORTS / f"{row.name}.html"

    def begin(self, names: Iterable[str]) -> None:
        """Say which rows there are: a summary that is older is that of an earlier session."""
        write_atomically(self.path / ROWS, json.dumps(list(names)))

    def finished(self, row: Row) -> dict[str, Any] | None:
        """What the result file of a row holds; None where it is not done, or not with these inputs and this code."""
        path = self.result(row)
        try:
            record = read_json(path, "a result")
            if record[BATCH]["inputs"] != json.loads(json.dumps(inputs_of(row))):
                return None
            if record[BATCH].get("code") != code_identity():
                self.outdated.add(row.name)
                return None
            if row.asked.report and not self.report(row).is_file():
                return None
            about = {**record[BATCH], "seconds": float(record[BATCH]["seconds"])}
            if row.asked.inspects:
                require_record(about["inspection"])
            # What was loaded is checked; the text beside it is not.
            return {**Registration.load(path).to_dict(), BATCH: about}
        except (OSError, ValueError, KeyError, TypeError, ArithmeticError, RecursionError):
            return None

    def save(self, row: Row, done: RowResult) -> RowResult:
        """Keep what came of a row; it is on the disk when this returns. What cannot be kept is an error of the row."""
        try:
            self._save(row, done)
        except (DqregError, ValueError) as error:
            if not self.writable():
                raise
            return RowResult("error", f"its result cannot be saved: {error}")
        return done

    def writable(self) -> bool:
        """Whether files can be written to the folder at all: the disk is not full, the drive is there."""
        probe = self.path / RESULTS / ".probe"
        try:
            write_atomically(probe, "x" * 65_536)
            probe.unlink()
        except (DqregError, OSError):
            return False
        return True

    def _save(self, row: Row, done: RowResult) -> None:
        if done.record is None:
            for old in (self.result(row), self.thumbnail(row), self.report(row)):
                with contextlib.suppress(OSError):
                    old.unlink()
            return
        # The picture first: where the result stands, the row is done.
        if done.thumbnail is not None:
            write_atomically(self.thumbnail(row), done.thumbnail)
        if done.page is not None:
            self.report(row).parent.mkdir(exist_ok=True)
            write_atomically(self.report(row), done.page)
        write_atomically(self.result(row), json.dumps(done.record, indent=1, allow_nan=False) + "\n")


@contextlib.contextmanager
def open_folder(path: str | os.PathLike[str], *, resume: bool) -> Iterator[Folder]:
    """Take a folder for a batch."""
    place = Path(path)
    _refuse(place, resume=resume)
    with held_folder(place, "dqreg batch", RESULTS, THUMBNAILS):
        # Asked again, now that nobody else can put one there.
        _refuse(place, resume=resume)
        for each in (place, place / RESULTS, place / THUMBNAILS):
            for entry in each.iterdir():
                if LEFT_OVER.fullmatch(entry.name):
                    entry.unlink(missing_ok=True)
        yield Folder(place)


def _refuse(place: Path, *, resume: bool) -> None:
    if place.exists() and not place.is_dir():
        raise InputError(f"cannot write results to {place}: it is a file; give a folder as --out")
    if resume:
        return
    held = sum(1 for _ in (place / RESULTS).glob("*.json"))
    if held:
        results = "a result" if held == 1 else f"{held} results"
        raise InputError(f"the folder {place} holds {results} already; add --resume to resume, or give another --out")
