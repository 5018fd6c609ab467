"""One row of a batch: what it asks for, the marks of its files, and its registration."""

from __future__ import annotations

import dataclasses
import time
from collections import OrderedDict
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.errors import DqregError
from dqreg.files.code_identity import code_identity
from dqreg.files.file_digests import digest_of
from dqreg.files.poses import read_start
from dqreg.files.side_digests import DIGESTS
from dqreg.registration.batch.row_inspection import RowInspection, inspect_row
from dqreg.registration.batch.watch import Failure
from dqreg.registration.batch.worker import Status, Worker

if TYPE_CHECKING:
    from dqreg.registration.result.display_unit import ShownTarget
    from dqreg.registration.result.result import Registration
    from dqreg.registration.target import Target

Thumbnail = Callable[["Registration"], bytes | None]
# Key under which a result file says which row made it.
BATCH = "batch"
# Prepared targets that a worker keeps; more would only hold memory.
TARGETS_KEPT = 2
# Rows after which a worker process is replaced.
RECYCLED_AFTER = 256


@dataclasses.dataclass(frozen=True)
class Row:
    """One registration of many."""

    name: str  # Name of its files, without the ending; no two rows share one
    # scan, target: Files, absolute
    scan: Path
    target: Path
    start: str = "none"  # "none", "identity", or the absolute path of a pose
    options: dict[str, Any] = dataclasses.field(default_factory=dict)  # Keyword options of `dqreg.register`
    line: int = 0  # Line of the manifest, or place in the folder, counted from 1
    fault: str = ""  # Why it cannot be run; "" if it can
    asked: RowInspection = dataclasses.field(default_factory=RowInspection)  # How its part is inspected
    given: str = ""  # What it is called, where that is no file name; "" else

    @property
    def shown(self) -> str:
        """What people read as its name."""
        return self.given or self.name


@dataclasses.dataclass(frozen=True)
class RowResult:
    """What came of a row."""

    status: Status  # Whether there is a result; if not, why not
    message: str = ""  # What went wrong; "" if nothing
    # The result as `Registration.to_dict` has it, with the key "batch": name, inputs, code and seconds of the row
    record: dict[str, Any] | None = None
    thumbnail: bytes | None = None  # A small JPEG
    page: str | None = None  # The report of the row


def inputs_of(row: Row) -> dict[str, Any]:
    """All that the result of a row depends on, in plain JSON values."""
    more = {"inspection": row.asked.mark()} if row.asked != RowInspection() else {}
    return {
        "scan": digest_of(row.scan),
        "target": digest_of(row.target),
        "start": row.start if row.start in ("none", "identity") else digest_of(Path(row.start)),
        "options": dict(sorted(row.options.items())),
        **more,
    }


class Targets:
    """The last few prepared targets, so that a part is prepared once and not once a scan."""

    def __init__(self, kept: int = TARGETS_KEPT) -> None:
        self._kept = kept
        self._prepared: OrderedDict[tuple[Any, ...], tuple[Target, ShownTarget]] = OrderedDict()

    def shown(
        self, path: Path, own: str | None = None, asked: RowInspection | None = None
    ) -> tuple[Target, ShownTarget]:
        """Prepared target of a file, in the unit that is asked for; read again where the file has changed since.

        ``own`` is the unit of a file that does not say.
        """
        from dqreg.registration.result.display_unit import shown_target
        from dqreg.registration.target import prepare_target

        asked = asked or RowInspection()
        units = (own, asked.display_units, asked.plan_units)
        mark = (*digest_of(path), *units)
        if mark not in self._prepared:
            # Makes room first: no more than the kept number are ever in memory.
            while len(self._prepared) >= self._kept:
                self._prepared.popitem(last=False)
            # Under the mark from before it was read: had it changed meanwhile, the row fails and the next reads anew.
            shown = shown_target(path, *units)
            self._prepared[mark] = prepare_target(shown.geometry), shown
        self._prepared.move_to_end(mark)
        return self._prepared[mark]


def run_row(row: Row, targets: Targets, thumbnail: Thumbnail | None = None) -> RowResult:
    """Register one row."""
    began = time.perf_counter()
    try:
        before = inputs_of(row)
        result, shown = _registered(row, targets, keep_inputs=thumbnail is not None or row.asked != RowInspection())
        inspected, page = inspect_row(result, row.asked, shown)
        if inputs_of(row) != before:
            return RowResult(
                "error", "a file of this row changed while it was read; run it again once nothing writes to it"
            )
    except DqregError as error:
        return RowResult("error", str(error))
    except MemoryError as error:
        return RowResult("error", f"out of memory {error}".strip())
    except OSError as error:
        return RowResult("error", f"cannot read {error.filename or 'a file'}: {error.strerror or error}")
    except Exception as error:
        return RowResult("error", f"{type(error).__name__}: {error}")
    picture = _picture(thumbnail, result)
    seconds = time.perf_counter() - began
    about: dict[str, Any] = {"name": row.shown, "inputs": before, "code": code_identity(), "seconds": seconds}
    if inspected is not None:
        about["inspection"] = inspected
    if shown.scale != 1.0:
        about["shown"] = {"units": shown.units, "rms": result.rms}
    record = shown.native(result).to_dict()
    record["settings"][DIGESTS] = {"source": before["scan"][2], "target": before["target"][2]}
    return RowResult("ran", "", {**record, BATCH: about}, picture, page)


def _registered(row: Row, targets: Targets, *, keep_inputs: bool) -> tuple[Registration, ShownTarget]:
    """The result in the unit that is asked for; files of results are in the target's own."""
    from dqreg.registration.register import register

    start, own = read_start(row.start), row.options.get("target_units")
    target, shown = targets.shown(row.target, own, row.asked)
    options = row.options if shown.units == own else {**row.options, "target_units": shown.units}
    with shown.source_units(row.scan, options.get("source_units")) as source_units:
        options = {**row.asked.expected(shown), **options, "source_units": source_units}
        result = register(row.scan, target, shown.start(start), keep_inputs=keep_inputs, **options)
    return shown.named(result, row.target), shown


def _picture(thumbnail: Thumbnail | None, result: Registration) -> bytes | None:
    if thumbnail is None:
        return None
    try:
        return thumbnail(result)
    except Exception:
        return None


def row_worker(threads: int, idle: float | None = None) -> Worker:
    """A worker process for rows; where Open3D cannot load, no row could ever run, and its first call says so."""
    return Worker(threads, prepare=_load_libraries, most=RECYCLED_AFTER, idle=idle)


def run_isolated(
    worker: Worker,
    row: Row,
    timeout: float | None = None,
    thumbnail: Thumbnail | None = None,
    memory: float | None = None,
) -> RowResult:
    """Register one row in a worker process, within seconds and bytes."""
    answer = worker.call(partial(_run_here, row, thumbnail), timeout, memory)
    return RowResult(answer.kind, answer.message) if isinstance(answer, Failure) else answer


def _load_libraries() -> None:
    from dqreg._open3d import load_open3d

    load_open3d()


@cache
def _targets() -> Targets:
    """Those of this process."""
    return Targets()


def _run_here(row: Row, thumbnail: Thumbnail | None) -> RowResult:
    return run_row(row, _targets(), thumbnail)
