"""Many parts: what a batch has written so far, a row a scan; and a row as a visit of its own."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from dqreg.errors import InputError
from dqreg.files.csv_text import csv_rows
from dqreg.files.file_digests import digest_of
from dqreg.files.json_records import read_json
from dqreg.files.strict_json import plain
from dqreg.files.untrusted import read_record
from dqreg.inspection.plan.file import HEAD
from dqreg.registration.batch.line import RESULTS
from dqreg.registration.batch.resume import ROWS
from dqreg.registration.batch.row import BATCH
from dqreg.registration.batch.run import SUMMARY_CSV
from dqreg.studio.plans import with_plan
from dqreg.studio.visit import Side, Visit


class Many:
    """The folder of a batch that runs or has run; it is only read."""

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"cannot show the batch {folder}: expected the folder that dqreg batch --out names")
        self.folder = folder
        self._read: dict[Path, tuple[int, dict[str, Any]]] = {}

    def rows(self) -> dict[str, Any]:
        """Every row that has ended, by name; those without a result are known once the batch is over."""
        summary, names = self._summary(), self._names()
        if summary is None:
            known = {path.stem: path for path in sorted((self.folder / RESULTS).glob("*.json"))}
            found = {name: self._row(path) for name, path in known.items() if names is None or name in names}
        else:
            found = dict(map(self._of_summary, summary))
        rows = [{"name": name, **row} for name, row in found.items() if row is not None]
        return {"over": summary is not None, "rows": plain(rows), "total": None if names is None else len(names)}

    def _summary(self) -> list[dict[str, str]] | None:
        """Rows of the summary; None where it is not there yet, or that of a session before the one that runs."""
        path, begun = self.folder / SUMMARY_CSV, self.folder / ROWS
        try:
            if begun.is_file() and path.stat().st_mtime_ns < begun.stat().st_mtime_ns:
                return None
            return list(csv_rows(path.read_text(encoding="utf-8", errors="replace")))
        except FileNotFoundError:
            return None
        except (OSError, InputError) as error:
            raise InputError(f"{SUMMARY_CSV} of the batch cannot be read: {error}") from error

    def _names(self) -> set[str] | None:
        """Names of the rows of the manifest; None of a folder of old."""
        try:
            return set(map(str, json.loads(read_record(self.folder / ROWS, "the rows of a batch"))))
        except (InputError, ValueError, TypeError):
            return None

    def _of_summary(self, line: dict[str, str]) -> tuple[str, dict[str, Any] | None]:
        # Rows that have a result are called as its file is.
        stem = Path(line.get("result", "")).stem
        row = self._row(self.folder / RESULTS / f"{stem}.json") if stem else None
        missing = {"level": line.get("verdict"), "why": line.get("reasons"), "scan": line.get("scan"), "opens": False}
        return stem or line.get("name", ""), row or missing

    def visit(self, name: str) -> Visit:
        """A visit of a row's scan and part under the pose that was found; only if the files are those of the batch."""
        known = {each.stem: each for each in (self.folder / RESULTS).glob("*.json")}
        if name not in known:
            raise InputError(f"the batch has no row {name!r:.60}")
        try:
            record = self._record(known[name], name)
            inputs, T = record[BATCH]["inputs"], record["T_target_source"]
            marks, units = [inputs[side] for side in ("scan", "target")], record["settings"]
            places = [Path(mark[0]) for mark in marks]
            names = [units.get(f"{side}_units") for side in ("source", "target")]
            pose = {"start": "rival", "T_start": T} if T and T[0][0] is not None else {}
        except OSError as error:
            raise InputError(f"the result of {name} cannot be read: {error.strerror or error}") from error
        except (KeyError, TypeError, IndexError, AttributeError) as error:
            raise InputError(f"the result of {name} was not written by a batch ({error!r})") from error
        for place, mark in zip(places, marks, strict=True):
            # A result from elsewhere could name any file of this machine.
            if digest_of(place) != mark:
                raise InputError(f"{place.name} has changed since the batch read it")
        scan, part = (Side(place.name, str(place), unit) for place, unit in zip(places, names, strict=True))
        return _asked(Visit(scan, part), inputs.get("inspection")).changed(pose)

    def _row(self, path: Path) -> dict[str, Any] | None:
        """A row with a result; None where that was taken away just now."""
        try:
            record = self._record(path, path.stem)
            verdict = record["verdict"]
            return {
                "level": str(verdict["level"]),
                "why": "; ".join(map(str, verdict["reasons"])),
                "scan": Path(record[BATCH]["inputs"]["scan"][0]).name,
                "rms": record["rms"],
                "unit": record["settings"].get("target_units"),
                "inliers": record["inlier_fraction"],
                "outcome": (record[BATCH].get("inspection") or {}).get("outcome"),
                "opens": True,
            }
        except FileNotFoundError:
            return None
        except (InputError, OSError, KeyError, TypeError, IndexError, AttributeError) as error:
            return {"level": "error", "why": f"its result cannot be read: {error}", "opens": False}

    def _record(self, path: Path, name: str) -> dict[str, Any]:
        when = path.stat().st_mtime_ns
        if path not in self._read or self._read[path][0] != when:
            record = read_json(path, f"the result of {name}")
            # Iterations are most of a result, and no table shows them.
            record.pop("history", None)
            self._read[path] = when, record
        return self._read[path][1]


def _asked(visit: Visit, asked: Any) -> Visit:
    """The visit judged as the batch judged its part: by its plan, its tolerance, with the head of its row."""
    try:
        if asked is None:
            return visit
        if asked["plan"] is not None:
            plan = Path(asked["plan"][0])
            if digest_of(plan) != asked["plan"]:
                raise InputError(f"the plan {plan.name} has changed since the batch read it")
            visit = with_plan(visit, plan.read_text(encoding="utf-8"))
        if asked["tolerance"] is not None:
            sides = asked["tolerance"]
            plus, minus = (sides[1], -sides[0]) if isinstance(sides, list) else (sides, None)
            visit = dataclasses.replace(visit, tolerance=plus, minus=minus)
        if visit.tolerance is not None and asked["required_share"] is not None:
            visit = dataclasses.replace(visit, required=100.0 * asked["required_share"])
        head = {**dict(visit.head), **{key: words for key, words in asked["head"].items() if key in HEAD}}
        return dataclasses.replace(visit, head=tuple((key, head[key]) for key in HEAD if key in head))
    except (KeyError, TypeError, AttributeError, IndexError, OSError, UnicodeDecodeError) as error:
        raise InputError(f"what the batch asked of its parts cannot be read ({error!r})") from error
