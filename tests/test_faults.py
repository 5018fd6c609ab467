"""What goes wrong around the program: disks, signals, files that change, parts that are missing.

Always the same four: a clear line, no half-written file, no hang, an exit code as the contract says.
``DQREG_KILLS=50`` in the environment adds that many signals at any moment.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import secrets
import signal
import stat
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.cli.main import main
from dqreg.errors import InputError
from dqreg.files import CloudData, read_geometry, write_cloud
from dqreg.registration.batch.row import Targets, run_row
from dqreg.registration.result.result import Registration
from tests.registration.batch.scenes import all_gone, command, environment, left_over, make_scene, started

pytestmark = pytest.mark.skipif(os.name == "nt", reason="limits and signals of POSIX")
SIGNALS = int(os.environ.get("DQREG_KILLS", "0"))
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("faults"), 2)


def pair(scene):
    return scene.folder / "scan0.npy", scene.folder / "bracket.off", "--start", "identity", "--effort", "fast"


def run_here(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    return int(stop.value.code or 0)


def run_there(*arguments: object, variables: dict[str, str] | None = None, **options) -> subprocess.CompletedProcess:
    return subprocess.run(
        command(*arguments), env={**environment(), **(variables or {})}, capture_output=True, text=True, timeout=120.0,
        check=False, **options,
    )  # fmt: skip


def require_error(answer, *said: str, progress: bool = False) -> None:
    assert answer.returncode == 2, answer.stderr
    *before, last = answer.stderr.splitlines()
    assert last.startswith("dqreg: error: "), answer.stderr
    # Nothing else, but for the table of iterations where the work was done.
    rows = [line.split()[0] for line in before]
    assert rows == (["iteration", *map(str, range(1, len(rows)))] if progress else []), answer.stderr
    for words in said:
        assert words in last


def test_a_device_that_is_always_full_is_an_error_and_stays_a_device(scene, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    assert run_here("register", *pair(scene), "--quiet", "--out", "/dev/full") == 2
    captured = capsys.readouterr()
    assert captured.err == "dqreg: error: cannot write /dev/full: No space left on device\n"
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)


@pytest.mark.parametrize("kind", [pytest.param("register", marks=pytest.mark.soak), "batch"])
def test_a_full_standard_output_is_an_error(scene, tmp_path, kind):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    arguments = pair(scene) if kind == "register" else (scene.manifest, "--out", tmp_path / "out", "--workers", 1)
    with Path("/dev/full").open("wb") as full:
        answer = subprocess.run(
            command(kind, *arguments), env=environment(), stdout=full, stderr=subprocess.PIPE, text=True, timeout=120.0,
            check=False,
        )  # fmt: skip
    said = "cannot write to the standard output: No space left on device"
    require_error(answer, said, progress=kind == "register")
    if kind == "batch":
        # The row that was told of is kept.
        assert [path.name for path in (tmp_path / "out" / "results").iterdir()] == ["scan0.json"]


@contextlib.contextmanager
def full_disk():
    # As on a full disk, a write fails midway; unlike a full disk, it harms nobody else.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fills_up_leaves_what_was_there_and_no_half_file(scene, tmp_path, capsys):
    old = tmp_path / "old.json"
    old.write_text("old")
    for out in (old, tmp_path / "new.json"):
        with full_disk():
            assert run_here("register", *pair(scene), "--quiet", "--out", out) == 2
        assert capsys.readouterr().err == f"dqreg: error: cannot write {out}: File too large\n"
    assert old.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old.json"]


def test_of_several_outputs_those_before_the_disk_was_full_stay_whole(scene, tmp_path, capsys):
    pose, aligned = tmp_path / "pose.txt", tmp_path / "aligned.ply"
    with full_disk():
        assert run_here("register", *pair(scene), "--quiet", "--out", pose, "--aligned", aligned) == 2
    assert capsys.readouterr().err == f"dqreg: error: cannot write {aligned}: File too large\n"
    assert np.loadtxt(pose).shape == (4, 4)
    assert list(tmp_path.iterdir()) == [pose]


def test_a_disk_that_fills_up_in_a_batch_keeps_what_was_done(scene, tmp_path, capsys, monkeypatch):
    limit = contextlib.ExitStack()

    def answers(self, rows, thumbnail, stop):
        for row in rows:
            yield row, run_row(row, Targets())
            limit.enter_context(full_disk())

    monkeypatch.setattr("dqreg.registration.batch.run.Workers.answers", answers)
    out = tmp_path / "out"
    with limit:
        assert run_here("batch", scene.manifest, "--quiet", "--out", out) == 2
    said = capsys.readouterr().err
    kept = f"1 of 2 rows are kept in {out}: resume with --resume once that is mended"
    assert said == f"dqreg: error: cannot write {out / 'results' / 'scan1.json'}: File too large; {kept}\n"
    assert [path.name for path in (out / "results").iterdir()] == ["scan0.json"]
    assert left_over(out) == []
    monkeypatch.setattr("dqreg.registration.batch.run.Workers.answers", lambda _, rows, *__: (
        (row, run_row(row, Targets())) for row in rows
    ))  # fmt: skip
    assert run_here("batch", scene.manifest, "--out", out, "--resume") == 0
    assert "1 of 2 rows are done already" in capsys.readouterr().out


def without_privilege() -> None:
    # Root may write anywhere; without this one capability it is bound by permissions as everybody is.
    if os.geteuid() == 0:
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


@pytest.mark.parametrize("kind", ["register", "batch"])
def test_a_read_only_folder_is_refused_before_the_work(scene, tmp_path, kind):
    out = tmp_path / "locked"
    out.mkdir(mode=0o555)
    try:
        if kind == "register":
            answer = run_there("register", *pair(scene), "--out", out / "r.json", preexec_fn=without_privilege)
        else:
            answer = run_there("batch", scene.manifest, "--out", out, preexec_fn=without_privilege)
        require_error(answer, "locked", "ermission")
        assert answer.stdout == ""
        assert list(out.iterdir()) == []
    finally:
        out.chmod(0o755)


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.soak), signal.SIGTERM])
def test_a_signal_during_the_work_leaves_a_whole_result_or_none(scene, tmp_path, number):
    rng, token, out = np.random.default_rng(int(number)), secrets.token_hex(8), tmp_path / "r.json"
    with started("register", *pair(scene), "--out", out, token=token) as run:
        run.stdout.readline()  # the first words: it is at work
        time.sleep(rng.uniform(0.0, 0.1))
        run.send_signal(number)
        _, errors = run.communicate(timeout=60.0)
    assert run.returncode in (0, 128 + number, -signal.SIGTERM), errors
    assert "Traceback" not in errors
    assert_whole(out, tmp_path, token)


@pytest.mark.skipif(not SIGNALS, reason="long: set DQREG_KILLS")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_at_any_moment_leave_a_whole_result_or_none(scene, tmp_path, number, record_property):
    rng, token, out = np.random.default_rng(int(number)), secrets.token_hex(8), tmp_path / "r.json"
    began = time.monotonic()
    with started("register", *pair(scene), "--out", out) as run:
        assert run.wait(120.0) == 0
    seconds, ends = time.monotonic() - began, Counter()
    out.unlink()
    for _ in range(SIGNALS):
        with started("register", *pair(scene), "--out", out, token=token) as run:
            time.sleep(rng.uniform(0.0, 1.1 * seconds))
            run.send_signal(number)
            _, errors = run.communicate(timeout=60.0)
        # While Python loads its parts it cannot be asked for good words; how it ended is written down.
        ends[f"{run.returncode} {errors.strip().splitlines()[-1:]}"] += 1
        assert_whole(out, tmp_path, token)
    record_property("ends", json.dumps(ends))


def assert_whole(out: Path, folder: Path, token: str) -> None:
    if out.exists():
        Registration.load(out)
        out.unlink()
    assert left_over(folder) == []
    assert all_gone(token)


FORMATS = ("a.ply", "a.csv", "a.off", "a.npy")


def clouds(folder: Path) -> dict[str, list[bytes]]:
    """Two versions of a file in each format, of different sizes."""
    rng, made = np.random.default_rng(0), {}
    for name in FORMATS:
        made[name] = []
        for count in (300, 700):
            points = rng.uniform(size=(count, 3))
            path = folder / f"{count}-{name}"
            if name.endswith(".ply"):
                write_cloud(path, points, None)
            elif name.endswith(".csv"):
                np.savetxt(path, points, delimiter=",", header="x,y,z", comments="")
            elif name.endswith(".npy"):
                np.save(path, points)
            else:
                faces = "".join(f"3 {i} {i + 1} {i + 2}\n" for i in range(count - 2))
                corners = "".join(f"{x} {y} {z}\n" for x, y, z in points.tolist())
                path.write_text(f"OFF\n{count} {count - 2} 0\n{corners}{faces}")
            made[name].append(path.read_bytes())
    return made


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_is_written_while_it_is_read_is_read_or_refused(tmp_path, name):
    versions, path, stop = clouds(tmp_path)[name], tmp_path / name, threading.Event()
    path.write_bytes(versions[0])

    def write() -> None:
        number = 0
        while not stop.is_set():
            number += 1
            # As a scanner's program does: emptied, then filled piece by piece.
            with path.open("wb") as stream:
                data = versions[number % 2]
                for piece in range(0, len(data), 2_000):
                    stream.write(data[piece : piece + 2_000])
                    stream.flush()
                    # Every second time it is slow, and left whole for a while in the end: both are met within moments.
                    stop.wait(0.002 * (number % 2))
            stop.wait(0.02 * (number % 2))

    writer = threading.Thread(target=write)
    writer.start()
    read = refused = 0
    deadline = time.monotonic() + 4.0
    try:
        while min(read, refused) < 3 and time.monotonic() < deadline:
            try:
                found = read_geometry(path)
            except InputError:
                refused += 1
            else:
                read += 1
                points = found.points if isinstance(found, CloudData) else found.vertices
                assert np.isfinite(points).all()
    finally:
        stop.set()
        writer.join()
    assert read + refused > 0


CUT = """
import sys
import numpy as np
from dqreg.errors import InputError
from dqreg.files import read_geometry
load = np.load
def cut(path, *arguments, **options):
    array = load(path, *arguments, **options)
    open(path, "r+b").truncate(200)
    return array
np.load = cut
try:
    read_geometry(sys.argv[1])
except InputError:
    pass
"""


def test_a_file_that_is_cut_short_while_it_is_mapped_does_not_kill_the_program(tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(0).uniform(size=(20_000, 3)))
    answer = subprocess.run([sys.executable, "-c", CUT, tmp_path / "a.npy"], env=environment(), check=False)
    assert answer.returncode == 0


FAKE = 'raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")\n'


@pytest.mark.parametrize("kind", ["register", "batch"])
def test_open3d_that_cannot_load_is_one_line_with_the_remedy(scene, tmp_path, kind):
    (tmp_path / "fake").mkdir()
    (tmp_path / "fake" / "open3d.py").write_text(FAKE)
    variables = {"PYTHONPATH": os.pathsep.join([str(tmp_path / "fake"), environment()["PYTHONPATH"]])}
    out = tmp_path / "out"
    if kind == "register":
        words = ("register", *pair(scene), "--quiet", "--out", out, "--report", tmp_path / "report.html")
    else:
        words = ("batch", scene.manifest, "--quiet", "--out", out, "--workers", 1)
    require_error(run_there(*words, variables=variables), "libGL.so.1", "apt-get install libgl1")
    assert list(tmp_path.rglob("*.json")) == []
    assert not (tmp_path / "report.html").exists()


def test_a_mesh_is_registered_to_without_open3d_and_clouds_name_what_is_missing(scene, tmp_path, capsys, monkeypatch):
    load_open3d.cache_clear()
    monkeypatch.setitem(sys.modules, "open3d", None)
    try:
        assert run_here("register", *pair(scene), "--quiet", "--out", tmp_path / "r.json") == 0
        scan, _, *options = pair(scene)
        assert run_here("register", scan, scene.folder / "scan1.npy", *options, "--out", tmp_path / "c.json") == 2
    finally:
        load_open3d.cache_clear()
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("dqreg: error: Open3D cannot load: ")
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]


@pytest.mark.parametrize(
    ("module", "arguments", "said"),
    [
        ("distributed", ["batch", "{manifest}", "--scheduler", "tcp://127.0.0.1:9"], "pip install 'dqreg[cluster]'"),
        ("kiss_icp", ["odometry", "{frames}", "--engine", "kiss-icp"], "pip install"),
    ],
)
def test_a_missing_optional_part_is_one_line_with_the_command(
    scene, tmp_path, monkeypatch, capsys, module, arguments, said
):
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.chdir(tmp_path)
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(2):
        write_cloud(frames / f"{number}.ply", np.random.default_rng(0).uniform(size=(500, 3)), None)
    names = {"manifest": scene.manifest, "frames": frames}
    assert run_here(*(word.format(**names) for word in arguments)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("dqreg: error: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
