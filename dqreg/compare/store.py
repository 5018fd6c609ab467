"""Runs on disk: JSON lines, only ever appended to, so that a killed comparison resumes where it stopped.

The first line of each session holds machine and versions of the lines after it. An incomplete last line, of a killed
process or a full disk, is cut off before the next one is written; a damaged line anywhere else is an error.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from dqreg.compare.engines.registry import EngineSpec
from dqreg.compare.identity import UNTOLD
from dqreg.compare.records import RunRecord
from dqreg.errors import InputError
from dqreg.files.atomic import require_writable
from dqreg.files.strict_json import plain, record_from

FORMAT = "dqreg comparison 1"
# A run that takes longer is not repeated: its scatter is small relative to it, and repeats would take long.
SLOW_SECONDS = 10.0
# Letters of a date that say the day.
DAY = len("2026-11-28")
# Keys of files of version 0.1, by which these still load.
RENAMED_KEYS = {"from_nothing": "without_initial_pose", "claims": "self_report"}


class JsonLines:
    """A file of JSON lines that begins with its format and is only ever appended to."""

    def __init__(self, path: str | os.PathLike[str] | None, form: str) -> None:
        self.path = None if path is None else require_writable(path)
        self._form = form
        self.lines: list[dict[str, Any]] = []  # What stood in it
        if self.path is not None and self.path.exists():
            self.lines, whole = _read(self.path, form)
            if whole < self.path.stat().st_size:
                os.truncate(self.path, whole)

    def begin(self, session: Mapping[str, Any]) -> None:
        """Record machine and versions of the following lines."""
        self.append([{"format": self._form, **session}])

    def append(self, lines: Iterable[dict[str, Any]]) -> None:
        """Keep lines; they are on the disk when this returns."""
        if self.path is None:
            return
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
        try:
            with self.path.open("ab") as stream:
                stream.write(text.encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise InputError(f"cannot write {self.path}: {error.strerror or error}") from error


class Store:
    """A file of runs; those that were cut off earlier than a run may take now are not taken from it."""

    def __init__(self, path: str | os.PathLike[str] | None, timeout: float = 0.0) -> None:
        self._file, self._timeout = JsonLines(path, FORMAT), timeout
        self.runs: list[RunRecord] = []
        self.sessions: list[dict[str, Any]] = []
        # Runs that stood in the file, with the day on which they were made.
        self.found: list[tuple[RunRecord, str]] = []
        self._counts: dict[tuple[str, str, str], int] = {}
        self._closed: set[tuple[str, str, str]] = set()
        for line in self._file.lines:
            self._take(line)

    def begin(self, session: Mapping[str, Any]) -> None:
        """Record machine and versions of the following runs."""
        self.sessions.append(dict(session))
        self._file.begin(session)

    def add(self, runs: Iterable[RunRecord]) -> None:
        """Keep runs; they are on the disk when this returns."""
        runs = list(runs)
        self._file.append(plain(run) for run in runs)
        for run in runs:
            self._keep(run)

    @property
    def path(self) -> Path | None:
        """The file; None where nothing is kept."""
        return self._file.path

    def done(self, key: str, spec: EngineSpec) -> int:
        """Number of runs of a task by an engine as it is now."""
        return self._counts.get((key, spec.name, spec.identity), 0)

    def finished(self, key: str, spec: EngineSpec, repeats: int) -> bool:
        """Whether an engine has nothing left to do on a task."""
        return self.done(key, spec) >= repeats or (key, spec.name, spec.identity) in self._closed

    def _take(self, line: dict[str, Any]) -> None:
        if "format" in line:
            self.sessions.append({key: value for key, value in line.items() if key != "format"})
        else:
            run = record_from(RunRecord, {RENAMED_KEYS.get(key, key): value for key, value in line.items()})
            if run.status == "timeout" and run.wall_seconds < self._timeout:
                return
            self.found.append((run, str((self.sessions or [{}])[-1].get("date", ""))[:DAY]))
            self._keep(run)

    def _keep(self, run: RunRecord) -> None:
        self.runs.append(run)
        place = run.key, run.engine, run.identity
        self._counts[place] = self._counts.get(place, 0) + 1
        if is_last(run):
            self._closed.add(place)


def kept_words(store: Store, keys: Collection[str], engines: Iterable[EngineSpec]) -> str:
    """What of a file is taken over, made when, and what is left out since the code of an engine is another now."""
    codes = {spec.name: spec.identity for spec in engines}
    here = [(run, day) for run, day in store.found if run.key in keys and run.engine in codes]
    days = sorted({day or "an unknown day" for run, day in here if run.identity == codes[run.engine]})
    taken = sum(run.identity == codes[run.engine] for run, _ in here)
    untold = [name for name, code in codes.items() if code.startswith(UNTOLD)]
    others = [run.engine for run, _ in here if run.identity != codes[run.engine] and run.engine not in untold]
    words = [f"{_runs(taken)} taken from {store.path}, made on {', '.join(days)}."] if taken else []
    if others:
        names = ", ".join(dict.fromkeys(others))
        words.append(f"{_runs(len(others))} in {store.path} left out, made by other code or versions: {names}.")
    if untold and store.path is not None:
        words.append(
            f"Never taken from a file: {', '.join(untold)}. Such an object may be another each time (it cannot be "
            "pickled, or its code stands in no file); give the path of a Python file that holds it."
        )
    return " ".join(words)


def _runs(count: int) -> str:
    return f"{count} {'run' if count == 1 else 'runs'}"


def is_last(run: RunRecord) -> bool:
    """Whether a run is the last of its engine on its task, however many were asked for."""
    return run.status != "ran" or run.seconds > SLOW_SECONDS


def _read(path: Path, form: str) -> tuple[list[dict[str, Any]], int]:
    """Lines of a file, and the number of bytes that are whole lines."""
    try:
        if not path.is_file():
            raise InputError(f"cannot read {path}: it is a device or a pipe; give another --out")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    whole = content.rfind(b"\n") + 1
    lines = []
    for number, text in enumerate(content[:whole].splitlines(), 1):
        try:
            line = json.loads(text)
            if not isinstance(line, dict) or (number == 1 and line.get("format") != form):
                raise ValueError("not a line of a comparison")
        except (ValueError, RecursionError) as error:
            raise InputError(
                f"{path}, line {number}: {error}; give another --out, or remove the file to start again"
            ) from error
        lines.append(line)
    if not lines and content:
        raise InputError(f"{path} is no file of a comparison; give another --out")
    return lines, whole
