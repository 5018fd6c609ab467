from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from dqreg.cli.main import main
from dqreg.files import write_cloud
from tests.hostile.bad_files import BAD_FILES, bytes_of
from tests.hostile.scenes import PART, SCAN, START
from tests.registration.result.test_result import failed, good

# Files that every command which takes a scan or a part is given.
FILES = ["empty", "noise named ply", "ply of 10^12 points, binary", "stl named ply", "npy of objects",
         "3mf with entities", "gltf that names a file outside", "npz of 100 MB of zeros"]  # fmt: skip
COMMANDS = {
    "register, scan": ["register", "{bad}", "{part}", "--start", "identity"],
    "register, part": ["register", "{scan}", "{bad}", "--start", "identity"],
    "register, start": ["register", "{scan}", "{part}", "--start", "{bad}"],
    "evaluate": ["evaluate", "{bad}", "--truth", "{pose}"],
    "evaluate, truth": ["evaluate", "{pose}", "--truth", "{bad}"],
    "show": ["show", "{bad}"],
    "synth": ["synth", "{bad}", "--out", "{out}"],
    "compare": ["compare", "{bad}", "--out", "{out}"],
    "batch": ["batch", "{bad}"],
}
WRONG = {
    "no such command": ["registre"],
    "no arguments": ["register"],
    "one argument": ["register", "{scan}"],
    "unknown option": ["register", "{scan}", "{part}", "--magic"],
    "start without value": ["register", "{scan}", "{part}", "--start"],
    "start that is none": ["register", "{scan}", "{part}", "--start", "nowhere.txt"],
    "start of NaN": ["register", "{scan}", "{part}", "--start", "{nan}"],
    "start of a mirror": ["register", "{scan}", "{part}", "--start", "{mirror}"],
    "start of a failed result": ["register", "{scan}", "{part}", "--start", "{failed}"],
    "start of a broken result": ["register", "{scan}", "{part}", "--start", "{broken}"],
    "method": ["register", "{scan}", "{part}", "--method", "magic"],
    "effort": ["register", "{scan}", "{part}", "--effort", "heroic"],
    "seed": ["register", "{scan}", "{part}", "--seed", "-1"],
    "seed of text": ["register", "{scan}", "{part}", "--seed", "x"],
    "angle": ["register", "{scan}", "{part}", "--max-angle", "nan"],
    "distance": ["register", "{scan}", "{part}", "--max-distance", "inf"],
    "tolerance": ["register", "{scan}", "{part}", "--tolerance", "nan"],
    "reach": ["register", "{scan}", "{part}", "--reach", "-1"],
    "units": ["register", "{scan}", "{part}", "--source-units", "parsec"],
    "out in no folder": ["register", "{scan}", "{part}", "--out", "{out}/gone/result.json"],
    "out on a folder": ["register", "{scan}", "{part}", "--out", "{out}"],
    "deviations of no kind": ["register", "{scan}", "{part}", "--deviations", "{out}/a.xyzzy"],
    "a scan that is a folder": ["register", "{out}", "{part}"],
}


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Good files, and poses that are none."""
    folder = tmp_path_factory.mktemp("places")
    write_cloud(folder / "scan.ply", SCAN)
    lines = [f"v {x} {y} {z}" for x, y, z in PART.vertices] + [f"f {a} {b} {c}" for a, b, c in PART.faces + 1]
    (folder / "part.obj").write_text("\n".join(lines))
    for name, T in (("pose", START), ("nan", np.full((4, 4), np.nan)), ("mirror", np.diag([1.0, 1, -1, 1]))):
        np.savetxt(folder / f"{name}.txt", T)
    failed().save(folder / "failed.json")
    broken = good().to_dict() | {"T_target_source": (2.0 * np.eye(4)).tolist()}
    (folder / "broken.json").write_text(json.dumps(broken))
    (folder / "out").mkdir()
    names = {"scan": "scan.ply", "part": "part.obj", "pose": "pose.txt", "nan": "nan.txt", "mirror": "mirror.txt",
             "failed": "failed.json", "broken": "broken.json", "out": "out"}  # fmt: skip
    return {key: str(folder / name) for key, name in names.items()}


def assert_refused(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and one line on stderr that is no trace."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    told = capfd.readouterr()
    assert ended.value.code == 2
    assert told.err.count("\n") == 1
    assert told.err.startswith("dqreg: error: ")
    assert "Traceback" not in told.err + told.out


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", FILES)
def test_every_command_refuses_a_file_from_a_stranger(
    command: str, name: str, places: dict[str, str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / BAD_FILES[name][0]
    bad.write_bytes(bytes_of(name))
    assert_refused([word.format(bad=bad, **places) for word in COMMANDS[command]], capfd)


# Kinds of places that are no file: a pipe would be waited for, a device never ends, a name too long raises by itself.
PLACES = ("pipe", "device", "long name", "long name in a folder", "circle of links")


@pytest.mark.parametrize("command", [*COMMANDS, "compare, sweep", "batch, target", "odometry"])
@pytest.mark.parametrize("kind", PLACES)
def test_every_command_refuses_a_place_that_is_no_file(
    command: str, kind: str, places: dict[str, str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.json"
    if kind == "pipe":
        os.mkfifo(bad)
    elif kind == "circle of links":
        bad.symlink_to(bad)
    else:
        bad = {"device": Path("/dev/zero"), "long name": tmp_path / ("x" * 300)}.get(kind, tmp_path / "x" / ("字" * 90))
    more = {
        "compare, sweep": ["compare", "--sweep", "{bad}"],
        "batch, target": ["batch", "{out}", "--target", "{bad}"],
        "odometry": ["odometry", "{bad}"],
    }
    words = {**COMMANDS, **more}[command]
    assert_refused([word.format(bad=bad, **places) for word in words], capfd)


def test_a_name_too_long_to_write_is_one_line(places: dict[str, str], capfd: pytest.CaptureFixture[str]) -> None:
    out = places["out"] + "/" + "字" * 90 + ".json"
    assert_refused(["register", places["scan"], places["part"], "--out", out], capfd)


def test_names_never_reach_a_terminal_raw(
    places: dict[str, str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    odd = "a\x1b[2J\x9b\u202e\r.ply"
    with pytest.raises(SystemExit):
        main(["register", str(tmp_path / odd), places["part"]])
    shutil.copy(places["scan"], tmp_path / odd)
    arguments = ["--start", places["pose"], "--effort", "fast", "--out", str(tmp_path / f"{odd}.json")]
    with pytest.raises(SystemExit):
        main(["register", str(tmp_path / odd), places["part"], *arguments])
    with pytest.raises(SystemExit):
        main(["evaluate", str(tmp_path / f"{odd}.json"), "--truth", places["pose"], "--out", str(tmp_path / odd)])
    told = "".join(capfd.readouterr())
    assert r"a\x1b[2J\x9b\u202e\r.ply" in told
    assert [char for char in told if not char.isprintable() and char != "\n"] == []


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_command_line_is_one_line_on_stderr(
    name: str, places: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    assert_refused([word.format(**places) for word in WRONG[name]], capfd)
