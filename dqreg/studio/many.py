"""Many parts: what a batch has written so far, a row a scan; and a row as a visit of its own."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from pathlib import Path
from typing import Any

from dqreg.errors import InputError
from dqreg.files.untrusted import read_record
from dqreg.inspection.plan.file import HEAD
from dqreg.registration.batch.file_digests import digest_of
from dqreg.registration.batch.line import RESULTS
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
        found = {path.stem: self._row(path) for path in sorted((self.folder / RESULTS).glob("*.json"))}
        over = (self.folder / SUMMARY_CSV).is_file()
        if over:
            text = (self.folder / SUMMARY_CSV).read_text(encoding="utf-8", errors="replace")
            for line in csv.DictReader(io.StringIO(text)):
                missing = {"level": line.get("verdict"), "why": line.get("reasons"), "scan": line.get("scan")}
                # The rows above have the names of their files.
                name = Path(line.get("result") or "").stem or line.get("name")
                found.setdefault(str(name), missing | {"opens": False})
        return {"over": over, "rows": [{"name": name, **row} for name, row in found.items()]}

    def visit(self, name: str) -> Visit:
        """A visit of a row's scan and part under the pose that was found; only if the files are those of the batch."""
        record = self._record(self.folder / RESULTS / f"{name}.json", name)
        try:
            inputs, T = record[BATCH]["inputs"], record["T_target_source"]
            marks, units = [inputs[side] for side in ("scan", "target")], record["settings"]
            places = [Path(mark[0]) for mark in marks]
            names = [units.get(f"{side}_units") for side in ("source", "target")]
        except (KeyError, TypeError, IndexError) as error:
            raise InputError(f"the result of {name} was not written by a batch ({error!r})") from error
        for place, mark in zip(places, marks, strict=True):
            # A result from elsewhere could name any file of this machine.
            if digest_of(place) != mark:
                raise InputError(f"{place.name} has changed since the batch read it")
        scan, part = (Side(place.name, str(place), unit) for place, unit in zip(places, names, strict=True))
        plain = {"start": "rival", "T_start": T} if T and T[0][0] is not None else {}
        return _asked(Visit(scan, part), inputs.get("inspection")).changed(plain)

    def _row(self, path: Path) -> dict[str, Any]:
        try:
            record = self._record(path, path.stem)
            verdict = record["verdict"]
            return {
                "level": verdict["level"],
                "why": "; ".join(map(str, verdict["reasons"])),
                "scan": Path(record[BATCH]["inputs"]["scan"][0]).name,
                "rms": record["rms"],
                "unit": record["settings"].get("target_units"),
                "inliers": record["inlier_fraction"],
                "outcome": (record[BATCH].get("inspection") or {}).get("outcome"),
                "opens": True,
            }
        except (InputError, KeyError, TypeError, IndexError) as error:
            return {"level": "error", "why": f"its result cannot be read: {error}", "opens": False}

    def _record(self, path: Path, name: str) -> dict[str, Any]:
        known = {each.stem: each for each in (self.folder / RESULTS).glob("*.json")}
        if name not in known:
            raise InputError(f"the batch has no row {name!r:.60}")
        when = path.stat().st_mtime_ns
        if path not in self._read or self._read[path][0] != when:
            try:
                record = json.loads(read_record(path, "a result"))
            except ValueError as error:
                raise InputError(f"the result of {name} is no JSON: {error}") from error
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
