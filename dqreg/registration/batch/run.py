"""A batch: many registrations, one result file each, one summary; resumed after an interruption at any moment."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from dqreg._numbers import is_number, is_whole
from dqreg.errors import DqregError, InputError
from dqreg.files.atomic import require_writable, write_atomically
from dqreg.registration.batch.line import Line, line_of
from dqreg.registration.batch.pool import Answer, Stop, on_this_machine
from dqreg.registration.batch.resume import THUMBNAILS, Folder, open_folder
from dqreg.registration.batch.row import Row, RowResult, Thumbnail
from dqreg.registration.batch.summary import summary_csv, to_html
from dqreg.registration.batch.trends import trends_csv, trends_of, values_csv

SUMMARY_CSV, SUMMARY_HTML, VALUES_CSV, TRENDS_CSV = "summary.csv", "summary.html", "values.csv", "trends.csv"
TIMEOUT = 600.0


@dataclasses.dataclass(frozen=True)
class Workers:
    """The worker processes of a batch: here, or on a cluster."""

    workers: int | None = None  # Processes on this machine; None takes one a core
    scheduler: str | None = None  # Address of a Dask scheduler, to work on its cluster instead
    threads: int | None = None  # Threads of each worker process; None shares the cores out
    timeout: float | None = TIMEOUT  # Seconds for one row

    def __post_init__(self) -> None:
        for name in ("workers", "threads"):
            value = getattr(self, name)
            if value is not None and not (is_whole(value) and value >= 1):
                raise InputError(f"{name} must be a whole number, 1 or more; got {value!r:.60}")
        if self.timeout is not None and not (is_number(self.timeout) and 0.0 < self.timeout < math.inf):
            raise InputError(f"timeout must be seconds above 0; got {self.timeout!r}")
        if self.scheduler is not None and self.workers is not None:
            raise InputError("workers are those of the cluster where a scheduler is given; give one of the two")

    def answers(self, rows: Sequence[Row], thumbnail: Thumbnail | None, stop: Stop) -> Iterator[Answer]:
        """What comes of rows, as they get done; see `on_this_machine`."""
        if self.scheduler is None:
            return on_this_machine(
                rows, workers=self.workers, threads=self.threads, timeout=self.timeout, thumbnail=thumbnail, stop=stop
            )
        from dqreg.registration.batch.dask_cluster import on_cluster

        return on_cluster(
            rows, self.scheduler, threads=self.threads or 1, timeout=self.timeout, thumbnail=thumbnail, stop=stop
        )


@dataclasses.dataclass(frozen=True)
class Batch:
    """What came of a batch."""

    lines: tuple[Line, ...]  # One a row, in the manifest's order
    stopped: bool  # Whether it was stopped before all rows were done
    files: tuple[Path, ...]  # The summaries

    @property
    def accepted(self) -> bool:
        """Whether every row ran and was accepted."""
        return all(line.verdict == "accepted" for line in self.lines)

    @property
    def passed(self) -> bool:
        """Whether every part that was to be inspected passes."""
        return all(line.part == "pass" for line in self.lines if line.row.asked.inspects)


@dataclasses.dataclass(frozen=True)
class BatchProgress:
    """How far a batch is."""

    # done, total: Rows; those kept from an earlier session are done
    done: int
    total: int
    seconds_left: float  # Learned from the rows done in this session; NaN at first
    line: Line | None = None  # The row that has just ended
    outdated: int = 0  # Rows of an earlier session that are done again, since other code or versions did them


def run_batch(
    rows: Sequence[Row],
    out: str | os.PathLike[str],
    workers: Workers | None = None,
    *,
    resume: bool = False,
    title: str = "",
    thumbnail: Thumbnail | None = None,
    observe: Callable[[BatchProgress], object] | None = None,
    stop: Stop = lambda: False,
) -> Batch:
    """Register many rows; results, pictures and the summary go to a folder. A row that cannot be run costs no other.

    With ``resume``, rows whose result is complete, and whose files, options and code have not changed since, are not
    done again. Once ``stop`` says True, running rows are dropped and the summary is written.
    """
    workers, tell = workers or Workers(), observe or (lambda _: None)
    with open_folder(out, resume=resume) as folder:
        names = (SUMMARY_CSV, SUMMARY_HTML, *((VALUES_CSV, TRENDS_CSV) if any(r.asked.inspects for r in rows) else ()))
        files = tuple(require_writable(folder.path / name) for name in names)
        sound = [row for row in rows if not row.fault]
        lines = _kept(folder, sound) if resume else {}
        folder.begin(row.name for row in rows)
        todo = [row for row in sound if row.name not in lines]
        progress = _watched(len(rows), len(lines))
        tell(dataclasses.replace(progress(), outdated=len(folder.outdated)))
        for row in (row for row in rows if row.fault):
            lines[row.name] = line_of(row, folder.save(row, RowResult("error", row.fault)))
            tell(progress(lines[row.name]))
        try:
            # Closed before the summary is written: nothing of ours may run on behind it.
            with contextlib.closing(workers.answers(todo, thumbnail, stop)) as answers:  # type: ignore[type-var]
                for row, done in answers:
                    lines[row.name] = line_of(row, folder.save(row, done))
                    tell(progress(lines[row.name]))
            ordered = _in_order(rows, lines)
            _write(folder, ordered, title)
        except DqregError as error:
            with contextlib.suppress(DqregError):
                _write(folder, _in_order(rows, lines), title)
            kept = sum(line.ran for line in lines.values())
            words = f"{kept} of {len(rows)} rows are kept in {folder.path}: resume with --resume once that is mended"
            raise InputError(f"{error}; {words}") from error
    return Batch(ordered, len(lines) < len(rows), files)


def _kept(folder: Folder, rows: Sequence[Row]) -> dict[str, Line]:
    found = ((row, folder.finished(row)) for row in rows)
    return {
        row.name: line_of(row, RowResult("ran", "", record), kept=True) for row, record in found if record is not None
    }


def _in_order(rows: Sequence[Row], lines: dict[str, Line]) -> tuple[Line, ...]:
    return tuple(lines.get(row.name) or Line(row, "not run", ("the batch was stopped before",)) for row in rows)


def _write(folder: Folder, lines: Sequence[Line], title: str) -> None:
    """Write the summaries; one that there is no room for costs no other."""
    contents: dict[str, Callable[[], str]] = {SUMMARY_CSV: lambda: summary_csv(lines)}
    if any(line.row.asked.inspects for line in lines):
        contents[VALUES_CSV] = lambda: values_csv(lines)
        contents[TRENDS_CSV] = lambda: trends_csv(trends_of(lines))
    name = title or folder.path.absolute().name
    contents[SUMMARY_HTML] = lambda: to_html(name, lines, folder.path / THUMBNAILS)
    lost: list[DqregError] = []
    for file, content in contents.items():
        try:
            write_atomically(folder.path / file, content())
        except DqregError as error:
            lost.append(error)
    if lost:
        raise lost[0]


def _watched(rows: int, kept: int) -> Callable[..., BatchProgress]:
    """What to call with the line of each row that has ended; its first call, without one, begins."""
    from dqreg.report.work_bar import TimeLeft

    left, now, done = TimeLeft([("", rows - kept)]), time.monotonic(), kept

    def progress(line: Line | None = None) -> BatchProgress:
        nonlocal now, done
        if line is not None:
            before, now, done = now, time.monotonic(), done + 1
            left.done("", 1.0, now - before)
        return BatchProgress(done, rows, left.seconds, line)

    return progress
