from __future__ import annotations

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError, printable
from dqreg.inspection import Tolerance
from dqreg.registration.batch import Defaults, RowInspection, read_manifest
from dqreg.registration.batch.row import Row, inputs_of
from dqreg.registration.batch.row_names import NAME, RESERVED, RowNames
from tests.registration.batch.scenes import make_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    make_scene(folder, 2, points=50)
    np.savetxt(folder / "start.txt", np.eye(4))
    np.savetxt(folder / "mirror.txt", np.diag([1.0, 1.0, -1.0, 1.0]))
    return folder


def rows_of(folder: Path, text: str, **defaults):
    (folder / "m.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    return read_manifest(folder / "m.csv", Defaults(**defaults))


def test_cells_win_over_defaults_and_empty_cells_take_them(folder):
    text = (
        "scan,target,name,start,max-distance,accelerate\nscan0.npy,,first,,2.5,no\nscan1.npy,feeder.off,,start.txt,,\n"
    )
    a, b = rows_of(folder, text, target=folder / "bracket.off", start="identity", options={"max_distance": 7.0})
    assert (a.name, a.target.name, a.start) == ("first", "bracket.off", "identity")
    assert a.options == {"max_distance": 2.5, "accelerate": False}
    assert (b.name, b.target.name, b.start) == ("scan1", "feeder.off", str(folder / "start.txt"))
    assert b.options == {"max_distance": 7.0}
    assert (a.line, b.line) == (2, 3)


def test_paths_are_relative_to_the_manifest_and_absolute_afterwards(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (row,) = rows_of(folder, "scan,target\nscan0.npy,bracket.off\n")
    assert (row.scan, row.target) == (folder / "scan0.npy", folder / "bracket.off")


@pytest.mark.parametrize("text", [
    "scan;target\nscan0.npy;bracket.off\n", "scan\ttarget\nscan0.npy\tbracket.off\n",
    "\ufeffscan,target\r\nscan0.npy,bracket.off\r\n", ' Scan , TARGET \n "scan0.npy", bracket.off \n\n,\n',
])  # fmt: skip
def test_what_spreadsheets_write(folder, text):
    (row,) = rows_of(folder, text)
    assert row.scan.name == "scan0.npy"


def test_names_are_file_names_and_never_twice(folder):
    odd = folder / "späte (2) scan#1.npy"
    shutil.copy(folder / "scan0.npy", odd)
    rows = rows_of(folder, f"scan,target\nscan0.npy,bracket.off\nscan0.npy,feeder.off\n{odd.name},bracket.off\n")
    assert [row.name for row in rows] == ["scan0", "scan0-2", "späte_2_scan_1"]
    odd.unlink()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (0, 2, 1)])
def test_names_that_were_given_go_first(folder, order):
    """A name made of a scan takes none that another row was given."""
    lines = ["scan0.npy,feeder.off,double", "scan1.npy,feeder.off,double", "scan0.npy,feeder.off,scan1"]
    rows = rows_of(folder, "scan,target,name\n" + "\n".join(lines[k] for k in order) + "\n")
    (wrong,) = [row for row in rows if row.fault]
    assert "'double'" in wrong.fault
    assert next(row for row in rows if row.line == 2 + order.index(2)).name == "scan1"
    assert len({row.name for row in rows}) == 3


def test_columns_have_the_words_of_the_command_too(folder):
    (row,) = rows_of(folder, "source,part\nscan0.npy,bracket.off\n")
    assert row == rows_of(folder, "scan,target\nscan0.npy,bracket.off\n")[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scan,target\nno.npy,bracket.off\n", "line 2: .*no.npy"),
        ("scan,source,target\nscan0.npy,scan0.npy,bracket.off\n", "line 1: .*scan is there twice"),
        ("scan,target\n,bracket.off\n", "line 2: the cell scan is empty"),
        ("scan,target\nscan0.npy,\n", "line 2: the cell target is empty"),
        ("scan,target,effort\nscan0.npy,bracket.off,huge\n", "line 2: .*'huge'"),
        ("scan,target,max_distance\nscan0.npy,bracket.off,wide\n", "line 2: .*'wide'"),
        ("scan,target,max_distance\nscan0.npy,bracket.off,-1\n", "line 2: .*-1"),
        ("scan,target,seed\nscan0.npy,bracket.off,1.5\n", "line 2: seed .*'1.5'"),
        ("scan,target,accelerate\nscan0.npy,bracket.off,perhaps\n", "line 2: accelerate .*yes or no"),
        ("scan,target,source_units\nscan0.npy,bracket.off,yards\n", "line 2: .*'yards'"),
        ("scan,target,start\nscan0.npy,bracket.off,here.txt\n", "line 2: .*here.txt"),
        ("scan,target,start\nscan0.npy,bracket.off,mirror.txt\n", "line 2: .*mirror"),
        ("scan,target,start\nscan0.npy,bracket.off,scan1.npy\n", "line 2: .*4x4"),
        ("scan,target,dof\nscan0.npy,bracket.off,z\n", "line 2: .*z"),
        ("scan,target,time_limit\nscan0.npy,bracket.off,inf\n", "line 2: time_limit .*finite .*'inf'"),
        ("scan,target\nscan\0.npy,bracket.off\n", "line 2: .*null"),
        ("scan,target\nrows.csv.bak,bracket.off\n", "line 2: .*rows.csv.bak"),
        ("scan,target\nscan0.npy,bracket.off,x\n", "line 2: found 3 cells"),
        ('scan,target\n"scan0.npy,bracket.off\n', "line 2: not CSV|line 3: not CSV"),
        ("scan,taget\nscan0.npy,bracket.off\n", "line 1: .*did you mean target"),
        ("scan,scan\nscan0.npy,bracket.off\n", "line 1: .*twice"),
        ("a\n", "line 1: "),
        ("", "empty file .*manifest"),
        ("scan,target\n\n", "no rows"),
        (b"\xff\xfe\x00", "UTF-8"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_line(folder, text, said):
    with pytest.raises(InputError, match=said) as error:
        rows_of(folder, text)
    assert "m.csv" in str(error.value)


def test_all_bad_rows_are_counted(folder):
    with pytest.raises(InputError, match=r"line 2: .*line 3: .*line 4: .*and 2 more"):
        rows_of(folder, "scan,target\n" + "no.npy,bracket.off\n" * 5)


def test_a_folder_is_its_scans_in_natural_order_without_the_part(folder, tmp_path):
    for number in (10, 9, 1):
        shutil.copy(folder / "scan0.npy", tmp_path / f"s_{number}.npy")
    shutil.copy(folder / "bracket.off", tmp_path / "part.off")
    (tmp_path / "notes.md").write_text("x")
    (tmp_path / ".hidden.npy").write_text("x")
    rows = read_manifest(tmp_path, Defaults(target=tmp_path / "part.off"))
    assert [row.name for row in rows] == ["s_1", "s_9", "s_10"]
    with pytest.raises(InputError, match="--target"):
        read_manifest(tmp_path)
    (tmp_path / "sub").mkdir()
    with pytest.raises(InputError, match="no scans"):
        read_manifest(tmp_path / "sub", Defaults(target=tmp_path / "part.off"))


def test_convergence_is_an_option(folder):
    (row,) = rows_of(folder, "scan,target,convergence\nscan0.npy,bracket.off,1e-3\n")
    assert row.options == {"convergence": 1e-3}


def test_a_scale_to_solve_and_viewpoints_are_cells(folder):
    text = "scan,target,scale,viewpoint\nscan0.npy,bracket.off,solve,\nscan1.npy,bracket.off,,0 0 5; 1 2 3\n"
    assert [row.options for row in rows_of(folder, text)] == [{"scale": "solve"}, {"viewpoint": [[0, 0, 5], [1, 2, 3]]}]


def test_parts_are_inspected_by_columns_and_defaults(folder):
    (folder / "plan.toml").write_text('[[characteristic]]\nkind = "form"\nface = 0\ntolerance = 0.1\n')
    head = "scan,target,plan,tolerance,required,serial\n"
    text = f"{head}scan0.npy,bracket.off,plan.toml,,,S 7\nscan1.npy,bracket.off,,0.2,99,\n"
    first, second = rows_of(folder, text, asked=RowInspection(tolerance=0.5, head=(("part", "4711"),)))
    assert (first.asked.plan, first.asked.tolerance) == (folder / "plan.toml", 0.5)
    assert dict(first.asked.head) == {"part": "4711", "serial": "S 7"}
    assert (second.asked.plan, second.asked.tolerance, second.asked.required_share) == (None, 0.2, 0.99)
    assert "inspection" in inputs_of(first)
    assert "inspection" not in inputs_of(dataclasses.replace(first, asked=RowInspection()))
    faulty = "scan0.npy,bracket.off,no.toml,,,\nscan0.npy,bracket.off,,-1,,\nscan0.npy,bracket.off,,0.2,0.95,\n"
    rows = rows_of(folder, text + faulty)
    assert rows[4].fault.endswith("required is in per cent; got 0.95: was 95 meant?")
    assert "cannot read the plan" in rows[2].fault
    assert "tolerance must be a length above 0" in rows[3].fault


def test_a_tolerance_of_a_row_may_have_two_sides(folder):
    text = "scan;target;tolerance\n" + "".join(f"scan0.npy;bracket.off;{x}\n" for x in ("+0.2/-0.05", "0,2", "+1/+1"))
    first, second, third = rows_of(folder, text)
    assert first.asked.tolerance == Tolerance(-0.05, 0.2)
    assert inputs_of(first)["inspection"]["tolerance"] == [-0.05, 0.2]
    assert inputs_of(first) != inputs_of(
        dataclasses.replace(first, asked=RowInspection(tolerance=Tolerance(-0.05, 0.3)))
    )
    assert "line 3: tolerance: '0,2' is neither a length nor two sides such as +0.2/-0.05" in second.fault
    assert "line 4: tolerance: a tolerance lies between two lengths" in third.fault


def test_a_name_may_hold_blanks_and_a_row_with_a_fault_keeps_its_name(folder):
    rows = rows_of(folder, "scan,target,name\nscan0.npy,bracket.off,Part №7 (left)\nno.npy,bracket.off,Part 8\n")
    assert [row.name for row in rows] == ["Part №7 (left)", "Part 8"]
    assert rows[1].fault


@pytest.mark.parametrize(
    "given", ["../x", "con", "NUL.x", "Com1", "lpt9.a.b", "a.", "字" * 120, "Part ü/2", ".a", "-a", "x" * 200, "a\x1bb"]
)
def test_a_name_that_is_no_file_name_is_shown_as_given_and_its_files_have_one_of_their_own(folder, given):
    text = f"scan,target,name,serial\nscan0.npy,bracket.off,{given},S 1\nscan1.npy,bracket.off,{given}?,S 2\n"
    one, other = rows_of(folder, text)
    assert (one.shown, dict(one.asked.head), one.fault) == (printable(given), {"serial": "S 1"}, "")
    assert one.name != other.name
    for row in (one, other):
        assert NAME.fullmatch(row.name)
        assert not RESERVED.match(row.name)
        assert len(f"{row.name}.json".encode()) <= 255
    # The same on every run, whatever the other rows are.
    alone = rows_of(folder, f"scan,target,name\nscan1.npy,bracket.off,b\nscan0.npy,bracket.off,{given}\n")
    assert alone[1].name == one.name
    twice = rows_of(folder, f"{text}scan1.npy,bracket.off,{given},S 3\n")[2]
    assert "is that of line 2, too" in twice.fault
    assert (twice.shown, dict(twice.asked.head)) == (printable(given), {"serial": "S 3"})


def test_a_row_that_cannot_be_run_says_why_and_the_others_are_kept(folder):
    text = (
        "scan,target,name,time_limit\nscan0.npy,bracket.off,a,\nscan0.npy,no.off,,\nscan1.npy,bracket.off,A,\n"
        "scan\0.npy,bracket.off,,\nscan1.npy,bracket.off,,inf\nscan1.npy,bracket.off,,9\n"
    )
    rows = rows_of(folder, text)
    said = ["", "line 3: .*no.off", "line 4: .*'A' .*line 2", "line 5: .*null", "line 6: .*'inf'", ""]
    assert all(re.search(words, row.fault) if words else not row.fault for row, words in zip(rows, said, strict=True))
    assert len({row.name for row in rows}) == len(rows)
    assert rows[-1].options == {"time_limit": 9.0}


@pytest.mark.parametrize("stem", ["字" * 84, "con", "aux.b", "con.1", "a...", "\udcff" * 3, "é" * 120, "🙂" * 60])
def test_names_made_of_scans_fit_every_system(folder, stem):
    rows = read_rows_of_stems(folder, [stem, stem])
    assert len({row.name for row in rows}) == 2
    for row in rows:
        assert len(f"{row.name}.json".encode()) <= 255
        assert not RESERVED.match(row.name)
        assert not row.name.endswith(".")


def read_rows_of_stems(folder, stems):
    names = RowNames()
    rows = [Row("", folder / f"{stem}.npy", folder / "bracket.off", line=k) for k, stem in enumerate(stems)]
    return [dataclasses.replace(row, name=names.named(row, given=False)) for row in rows]
