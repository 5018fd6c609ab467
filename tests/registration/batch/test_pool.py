from __future__ import annotations

import dataclasses
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.errors import InputError
from dqreg.registration.batch import Row, Workers, read_manifest, run_batch
from dqreg.registration.batch.pool import Backlog
from tests.registration.batch.hostile import thumbnail
from tests.registration.batch.scenes import make_scene, results


@given(st.lists(st.integers(0, 4), max_size=30), st.lists(st.integers(0, 5), max_size=2))
@settings(max_examples=60, deadline=None)
def test_every_row_is_given_out_once_and_prepared_targets_come_first(targets, prepared):
    rows = [Row(str(number), Path("s"), Path(str(target))) for number, target in enumerate(targets)]
    backlog, held = Backlog(rows), [Path(str(target)) for target in prepared]
    taken = list(iter(lambda: backlog.take(held), None))
    assert sorted(int(row.name) for row in taken) == list(range(len(rows)))
    ready = [row.target in held for row in taken]
    assert ready == sorted(ready, reverse=True)
    for target in held:
        of = [int(row.name) for row in taken if row.target == target]
        assert of == sorted(of)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("pool"), 5)


def test_crash_and_bad_file_cost_one_row_each(scene, tmp_path):
    rows = list(read_manifest(scene.manifest))
    for number, kind in enumerate(("crash", "raise")):
        shutil.copy(rows[number].scan, tmp_path / f"{kind}.npy")
        rows[number] = dataclasses.replace(rows[number], name=kind, scan=tmp_path / f"{kind}.npy")
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY\x01")
    rows[2] = dataclasses.replace(rows[2], name="bad", scan=tmp_path / "bad.npy")
    found = run_batch(rows, tmp_path / "out", Workers(workers=2, timeout=120.0, threads=1), thumbnail=thumbnail)
    by = {line.row.name: line for line in found.lines}
    assert [by[name].verdict for name in ("crash", "bad")] == ["crashed", "error"]
    assert f"signal {signal.SIGABRT.value}" in by["crash"].reasons[0]
    assert "out of cheese" in by["crash"].reasons[0]
    assert "bad.npy" in by["bad"].reasons[0]
    assert {line.verdict for name, line in by.items() if name.startswith(("scan", "raise"))} == {"accepted"}
    assert sorted(results(tmp_path / "out")) == ["raise", "scan3", "scan4"]
    # A picture that cannot be drawn costs the picture.
    assert sorted(path.stem for path in (tmp_path / "out" / "thumbnails").iterdir()) == ["scan3", "scan4"]
    assert not found.accepted
    assert not found.stopped
    # The poses are right: the truth is the motion that made the scan; 1e-3 S is ten times the noise.
    for name in ("scan3", "scan4"):
        T = np.array(results(tmp_path / "out")[name]["T_target_source"])
        assert np.abs(T - scene.truths[name]).max() < 0.2


@pytest.mark.parametrize("bad", [{"workers": 0}, {"threads": 0}, {"timeout": 0.0}, {"timeout": float("nan")},
                                 {"workers": 1, "scheduler": "tcp://x:1"}])  # fmt: skip
def test_crews_are_checked(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        Workers(**bad)
