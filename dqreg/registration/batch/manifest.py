"""The rows of a batch: from a CSV manifest, or from a folder of scans and a target; all checked before the work."""

from __future__ import annotations

import csv
import dataclasses
import io
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dqreg.errors import DqregError, InputError, did_you_mean, printable
from dqreg.files import READERS
from dqreg.files.natural_order import natural_order
from dqreg.files.poses import START_WORDS, read_start
from dqreg.files.untrusted import read_record, require_own_kind, require_readable
from dqreg.inspection.plan.file import HEAD
from dqreg.inspection.tolerances import Tolerance, share_of_percent, tolerance_from
from dqreg.registration.batch.cell_options import check_options, option_name, parse_option
from dqreg.registration.batch.row import Row
from dqreg.registration.batch.row_inspection import RowInspection
from dqreg.registration.batch.row_names import RowNames

COLUMNS = ("scan", "target", "name", "start", "plan", "tolerance", "required", *HEAD)
# The same under the words of `register`.
SAME = {"source": "scan", "part": "target"}
# Bad rows named in one message; more are counted.
NAMED = 3


@dataclasses.dataclass(frozen=True)
class Defaults:
    """Values of the cells that a row leaves empty."""

    target: Path | None = None  # The part
    start: str = "none"  # As in `Row`
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # Keyword options of `dqreg.register`
    asked: RowInspection = dataclasses.field(default_factory=RowInspection)  # How the parts are inspected


def read_manifest(path: str | os.PathLike[str], defaults: Defaults | None = None) -> tuple[Row, ...]:
    """Rows of a manifest, checked: one that cannot be run says why, and only where none can is that an error.

    A CSV file has a head with the columns scan and target, and if wanted name, start, and options of
    `dqreg.register`; empty cells take the default; paths are relative to the manifest's folder. Of a folder, every file
    that can be read as a scan is a row; then the defaults must name the target.
    """
    place, defaults = Path(path), defaults or Defaults()
    check_options(dict(defaults.options))
    if place.is_dir():
        cells = list(_of_folder(place, defaults))
        base = place
    else:
        cells = list(_of_csv(place))
        base = place.parent
    rows, faults = [], []
    seen = RowNames((line, values.get("name", "")) for line, values in cells)
    for line, values in cells:
        try:
            row = _row(line, values, base, defaults)
            row = _called(row, seen.named(row, given=bool(values.get("name"))), values)
        except DqregError as error:
            fault = printable(f"line {line}: {error}" if place.is_file() else str(error))
            asked = RowInspection(head=_head(values, defaults.asked))
            row = Row(values.get("name", ""), *_as_written(values, base, defaults), line=line, fault=fault, asked=asked)
            row = _called(row, seen.named_or_scan(row), values)
            faults.append(fault)
        rows.append(row)
    if faults and len(faults) == len(rows):
        more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
        raise InputError(f"{place}, {'; '.join(faults[:NAMED])}{more}")
    if not rows:
        raise InputError(f"{place} holds no rows; expected one line a scan" if place.is_file() else _no_scans(place))
    return tuple(rows)


def _of_csv(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Line number and cells by column, of every line that is not empty."""
    text = read_record(path, "a CSV manifest or a folder of scans")
    # Spreadsheets write semicolons or tabs in half of the world.
    head = text.partition("\n")[0]
    delimiter = max(",;\t", key=head.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True, skipinitialspace=True)
    try:
        columns = _columns(path, next(reader, []))
        for cells in reader:
            values = [cell.strip() for cell in cells]
            if not any(values):
                continue
            if len(values) > len(columns):
                raise InputError(
                    f"{path}, line {reader.line_num}: found {len(values)} cells; the head names {len(columns)} columns"
                )
            yield reader.line_num, dict(zip(columns, values, strict=False))
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: not CSV ({error})") from error


def _columns(path: Path, head: list[str]) -> list[str]:
    words = (cell.strip().lower() for cell in head)
    columns = [name if name in COLUMNS else option_name(name) for name in (SAME.get(word, word) for word in words)]
    known = [*COLUMNS, *option_name()]
    for name, found in zip(head, columns, strict=True):
        word = name.strip().lower()
        if found is None:
            hint = did_you_mean(word, known) or f"; known are {', '.join(known)}"
            raise InputError(f"{path}, line 1: unknown column {name.strip()!r}{hint}")
        if columns.count(found) > 1:
            raise InputError(f"{path}, line 1: the column {found} is there twice")
    if "scan" not in columns:
        raise InputError(f"{path}, line 1: expected a head with the columns scan and target; found {', '.join(head)}")
    return [name for name in columns if name is not None]


def _of_folder(folder: Path, defaults: Defaults) -> Iterator[tuple[int, dict[str, str]]]:
    if defaults.target is None:
        raise InputError(f"{folder} is a folder of scans; give their part with --target FILE")
    target = os.path.realpath(defaults.target)
    scans = (entry for entry in folder.iterdir() if entry.suffix.lower() in READERS and entry.is_file())
    visible = sorted(
        (s for s in scans if not s.name.startswith(".") and os.path.realpath(s) != target), key=natural_order
    )
    for number, scan in enumerate(visible, 1):
        yield number, {"scan": scan.name}


def _no_scans(folder: Path) -> str:
    return f"{folder} holds no scans; expected files that end in one of {' '.join(sorted(READERS))}"


def _row(line: int, values: Mapping[str, str], base: Path, defaults: Defaults) -> Row:
    scan = _file(values.get("scan", ""), base, "scan")
    if values.get("target"):
        target = _file(values["target"], base, "target")
    elif defaults.target is not None:
        target = _file(os.fspath(defaults.target.absolute()), base, "target")
    else:
        raise InputError("the cell target is empty, and no --target is given")
    start = values.get("start") or defaults.start
    if start not in START_WORDS:
        # Those of the command line are relative to where it was typed.
        start = os.path.abspath(base / start if values.get("start") else start)  # noqa: PTH100 - keeps links as they are
    read_start(start)
    own = {key: parse_option(key, text) for key, text in values.items() if key not in COLUMNS and text}
    options = {**defaults.options, **own}
    check_options(options)
    if start == "none" and "dof" in options:
        raise InputError(f"dof {options['dof']!r} locks motions of a start, and there is none; give the row a start")
    asked = _asked(values, base, defaults.asked)
    return Row(values.get("name", ""), scan, target, start, options, line, asked=asked)


def _asked(values: Mapping[str, str], base: Path, default: RowInspection) -> RowInspection:
    """How the part of a row is inspected: its own cells, else the defaults."""
    from dqreg.inspection import read_plan

    own: dict[str, Any] = {}
    if values.get("plan"):
        own["plan"] = Path(os.path.abspath(base / values["plan"]))  # noqa: PTH100 - keeps links as they are
    if values.get("tolerance"):
        own["tolerance"] = _tolerance(values["tolerance"])
    if values.get("required"):
        own["required_share"] = share_of_percent(_number("required", values["required"]), "required")
    asked = dataclasses.replace(default, head=_head(values, default), **own)
    # A part that is not inspected needs no page.
    asked = dataclasses.replace(asked, report=asked.report and asked.inspects)
    if asked.plan is not None:
        read_plan(asked.plan)
    return asked


def _head(values: Mapping[str, str], default: RowInspection) -> tuple[tuple[str, str], ...]:
    return tuple({**dict(default.head), **{name: values[name] for name in HEAD if values.get(name)}}.items())


def _called(row: Row, name: str, values: Mapping[str, str]) -> Row:
    """A row with the name of its files, and that which was given where it is another one."""
    given = values.get("name", "")
    return dataclasses.replace(row, name=name, given="" if given == name else printable(given))


def _tolerance(text: str) -> float | Tolerance:
    try:
        return tolerance_from(text)
    except InputError as error:
        raise InputError(f"tolerance: {error}") from None


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name} must be a number; got {text!r:.100}") from None


def _as_written(values: Mapping[str, str], base: Path, defaults: Defaults) -> tuple[Path, Path]:
    target = values.get("target") or defaults.target or ""
    return base / printable(values.get("scan", "")), base / printable(os.fspath(target))


def _file(text: str, base: Path, column: str) -> Path:
    if not text:
        raise InputError(f"the cell {column} is empty; expected a path")
    path = Path(os.path.abspath(base / text))  # noqa: PTH100 - keeps links as they are
    require_readable(path)
    extension = path.suffix.lower()
    if extension not in READERS:
        raise InputError(f"cannot read {path}: the extension {extension!r} is none of {' '.join(sorted(READERS))}")
    require_own_kind(path, extension)
    return path
