from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from dqreg.inspection import Characteristic, FaceCoverage, Inspection, Plan
from dqreg.report.sheet import digests_of, head_rows, labels_of, ranges, sheet_of


def characteristic(name: str, outcome: str, remark: str = "", place: float = 0.0) -> Characteristic:
    value = np.nan if remark else 10.0123
    return Characteristic(
        name, "distance", (3,), 10.0, 9.9, 10.1, value, 0.0123, outcome, 5, 0.5, (place, 0, 0), remark
    )


ROWS = (characteristic("a", "pass"), characteristic("b", "fail"), characteristic("c", "undecided", "face 3: none", 1.0))
FACES = (FaceCoverage(0, "plane", 3.0, 900, 1.0, False), FaceCoverage(3, "plane", 1.0, 0, 0.0, True))
FOUND = Inspection("fail", ROWS, None, Plan({"part": "4711"}, (), "best-fit", ROWS), FACES)


def test_the_sheet_says_what_passes_what_is_missing_and_how_much_was_seen() -> None:
    sheet = sheet_of(FOUND, "mm", trusted=True)
    assert sheet is not None
    assert sheet["words"] == ["Aligned to best fit of the scan.", "1 of 3 characteristics pass.",
                              "1 could not be measured, for the reasons named below."]  # fmt: skip
    # A value has the digits of its uncertainty, down to the second.
    assert [row["numbers"][3:5] for row in sheet["rows"]] == [["10.012", "0.012"]] * 2 + [["not measured", "–"]]
    # Three quarters of the area, by hand; the face of the plan stands first.
    assert sheet["coverage"]["words"].startswith("75.0 % of the part's surface was scanned. 1 of its 2 faces")
    assert [row["cells"] for row in sheet["coverage"]["rows"]] == [["3"], ["0"]]


def test_a_sheet_without_a_unit_says_whose_it_is() -> None:
    units = [sheet_of(FOUND, unit, trusted=True)["unit"] for unit in ("mm", "")]
    assert units == ["mm", "the unit of the part, which its file does not name"]


def test_characteristics_of_one_place_share_a_label_with_the_worst_outcome() -> None:
    one, other = labels_of(FOUND, (), "mm")
    assert (one.text, one.kind, other.text, other.kind) == ("1, 2", "fail", "3", "undecided")


@pytest.mark.parametrize(("numbers", "text"), [([4], "4"), ([1, 2], "1, 2"), ([1, 2, 3, 5], "1–3, 5")])
def test_ranges(numbers: list[int], text: str) -> None:
    assert ranges(numbers) == text


def test_head_and_digests(tmp_path: Path) -> None:
    assert head_rows({"operator": "M. Mustermann", "part": "4711", "lot": "9"}) == [
        ("Part no.", "4711"),
        ("Operator", "M. Mustermann"),
        ("Lot", "9"),
    ]
    (tmp_path / "a.stl").write_bytes(b"solid")
    found = digests_of({"source": str(tmp_path / "a.stl"), "target": "array of 5 points"})
    assert found == [("a.stl", hashlib.sha256(b"solid").hexdigest())]
    # What was read wins over what is there; where that has changed and is shown, it does not.
    known = {"source": str(tmp_path / "a.stl"), "sha256": {"source": "as read"}}
    assert digests_of(known) == [("a.stl", "as read")]
    assert digests_of({**known, "changed": "a.stl has changed"}) == found
    assert digests_of({**known, "sha256": "of a stranger"}) == found
