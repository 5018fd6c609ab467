"""A batch whose disk is full: what is kept is said, and summed up as far as it can be written."""

from __future__ import annotations

import pytest

from dqreg.errors import InputError
from dqreg.registration.batch import Row, Workers, run, run_batch
from dqreg.registration.batch.resume import Folder
from dqreg.registration.batch.row import RowResult

RECORD = {
    "verdict": {"level": "accepted", "reasons": []},
    "rms": 0.1,
    "inlier_fraction": 1.0,
    "dual_quaternion": None,
    "settings": {"target_units": "mm"},
    "batch": {"seconds": 1.0},
}


def test_a_full_disk_says_what_is_kept_and_leaves_a_summary(tmp_path, monkeypatch):
    rows = [Row(name, tmp_path / "a.ply", tmp_path / "b.stl", line=k) for k, name in enumerate(("one", "two", "three"))]
    monkeypatch.setattr(Workers, "answers", lambda *_: ((row, RowResult("ran", "", RECORD)) for row in rows))
    save, write = Folder.save, run.write_atomically

    def saved(folder, row, done):
        if row.name == "two":
            raise InputError("cannot write two.json: No space left on device")
        return save(folder, row, done)

    def written(path, content):
        if path.name == "summary.csv":
            raise InputError("cannot write summary.csv: No space left on device")
        write(path, content)

    monkeypatch.setattr(Folder, "save", saved)
    monkeypatch.setattr(run, "write_atomically", written)
    with pytest.raises(InputError, match=r"two\.json: No space.*; 1 of 3 rows are kept in .*: resume with --resume"):
        run_batch(rows, tmp_path / "out")
    assert "not run" in (tmp_path / "out" / "summary.html").read_text()
