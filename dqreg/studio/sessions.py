"""The sessions of a server: each a visit with its folder, its history and a worker process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import os
import secrets
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.errors import DqregError, InputError
from dqreg.files.atomic import require_folder, write_atomically
from dqreg.files.strict_json import plain
from dqreg.files.untrusted import read_record
from dqreg.registration.batch.watch import Failure
from dqreg.registration.batch.worker import Worker
from dqreg.studio.tasks import ASIDE, DEPENDS, NAMES, Values, perform, warm
from dqreg.studio.visit import Side, Visit

if TYPE_CHECKING:
    from dqreg.studio.many_parts import Many
    from dqreg.studio.travel import Travel

VISIT, RESULTS = "visit.json", "results.json"
# Seconds after which a worker without work ends.
IDLE_SECONDS = 900.0
# Shares of the machine's memory that workers may take.
WORKER_MEMORY_SHARE, ASIDE_MEMORY_SHARE = 0.7, 0.3
# Undo goes back that far.
MAX_UNDO_STEPS = 200
# Visits kept by a server, and worker processes at a time.
MAX_VISITS, MAX_WORKERS = 40, 3
LOST = "The results of this visit could not be read ({}). What was chosen is all there: do the steps again."


class StoppedError(Exception):
    """A run was cancelled by the user."""


class BrokenError(Exception):
    """A run ended without an answer; says how."""


@dataclasses.dataclass(eq=False)
class Session:
    """A visit on the server, while it is worked on."""

    name: str
    folder: Path
    visit: Visit
    past: list[Visit] = dataclasses.field(default_factory=list)
    results: dict[str, Any] = dataclasses.field(default_factory=dict)
    running: str = ""  # Name of the task that runs; "" if none does
    touched: float = dataclasses.field(default_factory=time.time)
    lost: str = ""  # Why the results of another day are not there; "" where they are

    def __post_init__(self) -> None:
        self._worker: Worker | None = None
        self._asides: list[Worker] = []
        self._lock = asyncio.Lock()
        self._stopping = False

    @property
    def is_idle(self) -> bool:
        """Whether it has a worker process that has nothing to do."""
        return self._worker is not None and not self.running

    def change(self, visit: Visit) -> None:
        """Go on with another state; the one before can be brought back."""
        if visit != self.visit:
            self._become(visit, [*self.past[-MAX_UNDO_STEPS:], self.visit])

    def undo(self) -> None:
        """Back to the state before the last change."""
        if not self.past:
            raise InputError("there is nothing to undo")
        self._become(self.past[-1], self.past[:-1])

    def _become(self, visit: Visit, past: list[Visit]) -> None:
        stale = {
            name
            for name, fields in DEPENDS.items()
            if any(getattr(visit, field) != getattr(self.visit, field) for field in fields)
        }
        results = {name: result for name, result in self.results.items() if name not in stale}
        # On the disk before it is so here: a change that cannot be kept is none. The results first, for a state that
        # another one's stand beside must never be there.
        self._write_results(results)
        visit.save(self.folder / VISIT)
        self.visit, self.past, self.results, self.touched = visit, past, results, time.time()

    def save(self) -> None:
        """Keep the visit and what came of it, for whoever opens it again."""
        self._write_results(self.results)
        self.visit.save(self.folder / VISIT)

    def _write_results(self, results: dict[str, Any]) -> None:
        write_atomically(self.folder / RESULTS, json.dumps(results, allow_nan=False))
        self.lost = ""

    @staticmethod
    def load(folder: Path) -> Session:
        """A visit of another day; results that cannot be read are done without, and it says so."""
        visit, results, lost = Visit.load(folder / VISIT), {}, ""
        try:
            results = _results_of(read_record(folder / RESULTS, "the results of a visit"))
        except DqregError as error:
            lost = LOST.format(str(error).replace(f"{folder}{os.sep}", ""))
        found = Session(folder.name, folder, visit, [], results, lost=lost)
        with contextlib.suppress(OSError):
            found.touched = (folder / VISIT).stat().st_mtime
        return found

    async def run(self, task: str, values: Values) -> Any:
        """Do a task in the worker process; one at a time."""
        async with self._lock:
            visit, self._stopping, self.running = self.visit, False, task
            try:
                answer = await asyncio.to_thread(self._call, partial(perform, task, self.folder, visit, values))
            finally:
                self.running = ""
        if isinstance(answer, Failure):
            if self._stopping:
                raise StoppedError
            raise BrokenError(answer.message)
        return self._kept(task, visit, answer)

    async def aside(self, task: str, values: Values) -> Any:
        """Answer a question in a process of its own, which ends with it: the work does not wait."""
        visit, worker = self.visit, Worker(1, prepare=warm)
        self._asides.append(worker)
        try:
            call = partial(perform, task, self.folder, visit, values)
            answer = await asyncio.to_thread(worker.call, call, memory=_memory(ASIDE_MEMORY_SHARE))
        finally:
            self._asides.remove(worker)
            worker.close()
        if isinstance(answer, Failure):
            raise BrokenError(answer.message)
        return self._kept(task, visit, answer)

    def _kept(self, task: str, visit: Visit, answer: Any) -> Any:
        # A result of a state that is not the present one any more is of no use.
        depends = DEPENDS.get(task)
        if depends is not None and all(getattr(visit, f) == getattr(self.visit, f) for f in depends):
            self.results[task] = answer
            # Known here even where the disk is full: on another day it is missing, and can be had again.
            with contextlib.suppress(InputError):
                self._write_results(self.results)
        return answer

    def cancel(self) -> None:
        """End what runs; a new worker process is started for the next task."""
        self._stopping = True
        self._end()

    def close(self) -> None:
        """End all that runs."""
        self._end()
        for each in self._asides:
            each.close()

    def _end(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()

    def _call(self, task: Callable[[], Any]) -> Any:
        if self._worker is None or self._worker.closed:
            self._worker = Worker(os.cpu_count() or 1, prepare=warm, idle=IDLE_SECONDS)
        return self._worker.call(task, memory=_memory(WORKER_MEMORY_SHARE))


def _results_of(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{RESULTS} is no JSON: {error}") from error
    if not (isinstance(values, dict) and all(name in NAMES and isinstance(values[name], dict) for name in values)):
        raise InputError(f"{RESULTS} holds no results")
    return dict(plain(values))


def _memory(share: float) -> float:
    import psutil

    return share * float(psutil.virtual_memory().total)


class Sessions:
    """All sessions of a server, in one folder."""

    def __init__(
        self,
        folder: Path,
        scan: Path | None = None,
        part: Path | None = None,
        many: Many | None = None,
        travel: Travel | None = None,
    ) -> None:
        self.folder, self.many, self.travel = folder, many, travel
        self.named = scan, part
        self._one_aside = asyncio.Lock()
        self.by_name: dict[str, Session] = {}
        for place in sorted(folder.glob(f"*/{VISIT}")):
            # What is no visit of ours is left alone.
            with contextlib.suppress(DqregError, OSError, ValueError):
                self.by_name[place.parent.name] = Session.load(place.parent)

    def open(self, visit: Visit | None = None) -> Session:
        """A new visit, with the files that the command line named where no others are given."""
        name = secrets.token_hex(6)
        scan, part = (None if path is None else Side(path.name, str(path.absolute())) for path in self.named)
        session = Session(name, require_folder(self.folder / name), visit or Visit(scan, part))
        session.save()
        if len(self.by_name) >= MAX_VISITS:
            oldest = min(self.by_name.values(), key=lambda each: each.touched)
            oldest.close()
            del self.by_name[oldest.name]
        self.by_name[name] = session
        return session

    def find(self, name: str) -> Session:
        """A session by its name."""
        if name not in self.by_name:
            raise InputError("this visit is not here any more: begin a new one")
        return self.by_name[name]

    async def run(self, session: Session, task: str, values: Values) -> Any:
        """Do a task of a visit; the workers of visits that nobody looks at any more make room."""
        idle = [each for each in self.by_name.values() if each.is_idle and each is not session]
        for each in sorted(idle, key=lambda other: other.touched)[: max(0, len(idle) - MAX_WORKERS + 1)]:
            each.close()
        session.touched = time.time()
        if task in ASIDE:
            async with self._one_aside:
                return await session.aside(task, values)
        return await session.run(task, values)

    def close(self) -> None:
        """End all worker processes."""
        for session in self.by_name.values():
            session.close()
        if self.travel is not None:
            self.travel.close()
