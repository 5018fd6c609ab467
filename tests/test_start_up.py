"""What `import dqreg` loads, and what a signal does while the program is still loading."""

from __future__ import annotations

import inspect
import json
import os
import re
import secrets
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import dqreg
from tests.registration.batch.scenes import CODE, all_gone, command, environment, left_over, make_scene

HEAVY = ("scipy", "numba", "open3d", "trimesh", "matplotlib", "numpy", "rich", "jinja2")
SIGNALS = int(os.environ.get("DQREG_KILLS", "0")) or 3
LINE = {
    signal.SIGINT: "dqreg: error: stopped by the user; no file is left half-written\n",
    signal.SIGTERM: "dqreg: error: ended by a signal (SIGTERM); no file is left half-written\n",
}


def loaded_by(code: str) -> set[str]:
    """Packages in memory after some lines."""
    tail = "import json, sys; print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
    words = [sys.executable, "-c", f"{code}\n{tail}"]
    answer = subprocess.run(words, env=environment(), capture_output=True, text=True, check=True)
    return set(json.loads(answer.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    ("code", "light"),
    [
        ("import dqreg; dir(dqreg)", HEAVY),
        ("import dqreg; dqreg.InputError", HEAVY),
        ("import dqreg; dqreg.solve", ("numba", "open3d", "trimesh", "matplotlib", "rich", "jinja2")),
        ("import dqreg.cli.main, dqreg.cli.lazy_group", HEAVY),
    ],
)
def test_nothing_is_loaded_before_it_is_used(code, light):
    assert loaded_by(code) & set(light) == set()


def test_a_registration_amid_clutter_loads_no_graphs_of_scipy():
    # Fifty milliseconds, which a time limit knows nothing of.
    code = """import sys, dqreg, numpy as np
from dqreg.synth.parts import bracket
part, rng = dqreg.Mesh(*bracket()), np.random.default_rng(63_301)
points = np.vstack([part.corners.mean(axis=1), rng.uniform(0.0, 200.0, (600, 3)) * [1.0, 1.0, 0.0]])
dqreg.register(points, part, "identity")
sys.modules = {name.replace("scipy.sparse", "graphs"): None for name in sys.modules}"""
    found = loaded_by(code)
    assert "numba" in found
    assert "graphs" not in found


@pytest.mark.parametrize("words", [["--help"], ["register", "--help"], ["show", "-h"], ["batch", "-h"], ["demo", "-h"]])
def test_help_loads_nothing_heavy(words):
    code = f"from dqreg.cli.lazy_group import cli; cli.main({words!r}, standalone_mode=False)"
    assert loaded_by(code) & set(HEAVY) == set()


def test_every_public_name_has_a_home_and_the_table_has_no_other():
    assert set(dqreg._HOMES) | {"solvers"} == set(dqreg.__all__)
    for name, home in dqreg._HOMES.items():
        if name != "Odometry":
            found = getattr(dqreg, name)
            assert found is getattr(sys.modules[home], name)
    assert set(dqreg.__all__) <= set(dir(dqreg))


def test_type_checkers_are_told_the_same_names():
    # Of the block that only they read.
    source = inspect.getsource(dqreg)
    told = source.partition("if TYPE_CHECKING:\n")[2].partition("\n\n")[0]
    homes = {}
    for line in told.splitlines():
        found = re.fullmatch(r"    from (dqreg\.[\w.]+) import (.+)", line)
        if found:
            homes |= dict.fromkeys(found.group(2).split(", "), found.group(1))
    assert homes == dqreg._HOMES


def test_register_stays_the_function_when_its_module_is_imported():
    code = (
        "import dqreg.registration.register, dqreg; "
        "from dqreg.registration.register import register; assert dqreg.register is register"
    )
    assert "dqreg" in loaded_by(code)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        dqreg.nonsense  # noqa: B018
    with pytest.raises(AttributeError, match="did you mean register"):
        dqreg.registr  # noqa: B018


def test_rooms_are_reachable_and_listed_and_nothing_else_is():
    for room in dqreg._ROOMS:
        assert getattr(dqreg, room) is sys.modules[f"dqreg.{room}"]
    public = {name for name in dir(dqreg) if not name.startswith("__")}
    assert public == {*dqreg.__all__, *dqreg._ROOMS}
    assert {"odometry", "compat", "multiway"} <= public


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("start"), 1)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.soak)])
def test_a_signal_while_it_loads_is_one_line_and_the_code(scene, tmp_path, number):
    rng, token, out = np.random.default_rng(int(number)), secrets.token_hex(8), tmp_path / "r.json"
    # The entry tells when it stands; from there on nothing may come out but the line.
    code = CODE.replace("console()", "print('begun', flush=True); console()")
    assert code != CODE
    words = command("register", scene.folder / "scan0.npy", scene.folder / "bracket.off", "--start", "identity",
                    "--effort", "fast", "--quiet", "--out", out)  # fmt: skip
    words[2] = code
    for _ in range(SIGNALS):
        run = subprocess.Popen(words, env=environment(token), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               start_new_session=True)  # fmt: skip
        assert run.stdout is not None
        run.stdout.readline()
        # The handlers stand after a millisecond; loading takes a third of a second on an idle machine.
        time.sleep(0.02 + rng.uniform(0.0, 0.4))
        run.send_signal(number)
        _, errors = run.communicate(timeout=60.0)
        assert (run.returncode, errors.lstrip("\n")) in ((128 + number, LINE[number]), (0, "")), errors
        if out.exists():
            # The signal may come between the last file and the end: what is there is whole.
            assert json.loads(out.read_text(encoding="utf-8"))["verdict"]["level"] == "accepted"
        else:
            assert run.returncode
        out.unlink(missing_ok=True)
    assert left_over(tmp_path) == []
    assert all_gone(token)
