"""No child process imports what lies in the working folder or beside the scans, whatever its name."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dqreg.registration.batch.worker import safe_environment, safe_path
from tests.registration.batch.scenes import CODE, ROOT, make_scene, summary

# Like the console script: a file elsewhere, so that the parent itself never looks into the working folder.
PROGRAM = CODE.replace("; console()", "\nif __name__ == '__main__':\n    console()")
# A scheduler, and a worker under its nanny as `dqreg batch` says to start one.
CLUSTER = f"""
import subprocess, sys
{PROGRAM.partition("if __name__")[0]}
if __name__ == "__main__":
    import distributed
    from dqreg.cli.main import main
    with distributed.LocalCluster(n_workers=0, processes=False, protocol='tcp://', dashboard_address=None) as here:
        address = here.scheduler_address
        words = [sys.executable, "-P", "-m", "dask", "worker", address, "--nthreads", "1", "--no-dashboard"]
        worker = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        sys.argv += ["--scheduler", address]
        try:
            distributed.Client(here).wait_for_workers(1, timeout=120)
            # Not by `console`, which ends a process with threads at once: the worker would live on.
            main()
        finally:
            worker.terminate()
            worker.wait()
"""


@pytest.fixture
def planted(tmp_path):
    """A scene, and a working folder beside it, each with a file of every standard module's name; and their marks."""
    scene, working, marks = make_scene(tmp_path / "scene", 2), tmp_path / "working", tmp_path / "marks"
    working.mkdir()
    marks.mkdir()
    for folder in (scene.folder, working):
        for name in sys.stdlib_module_names:
            mark = marks / f"{folder.name}.{name}"
            (folder / f"{name}.py").write_text(f"open({str(mark)!r}, 'w').close()\n")
    return scene, working, marks


def ran(
    tmp_path: Path, folder: Path, program: str, *arguments: object, flags: tuple[str, ...] = ()
) -> subprocess.CompletedProcess[str]:
    script = tmp_path / "program" / "dqreg_main.py"
    script.parent.mkdir()
    script.write_text(program)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    words = [sys.executable, *flags, str(script), *map(str, arguments)]
    variables = {**environment, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, timeout=300.0, check=False)


def marked(marks: Path) -> list[str]:
    return sorted(path.name for path in marks.iterdir())


@pytest.mark.parametrize("place", ["working", pytest.param("scene", marks=pytest.mark.soak)])
def test_a_batch_imports_nothing_of_the_working_folder(planted, tmp_path, place):
    scene, working, marks = planted
    folder = working if place == "working" else scene.folder
    run = ran(tmp_path, folder, PROGRAM, "batch", scene.manifest, "--out", tmp_path / "out", "--workers", "1")
    assert marked(marks) == []
    assert run.returncode == 0, run.stderr
    assert [row["verdict"] for row in summary(tmp_path / "out")] == ["accepted", "accepted"]


def test_a_batch_on_dask_imports_nothing_of_the_working_folder(planted, tmp_path):
    pytest.importorskip("distributed")
    scene, working, marks = planted
    run = ran(tmp_path, working, CLUSTER, "batch", scene.manifest, "--out", tmp_path / "out")
    assert marked(marks) == []
    assert run.returncode == 0, run.stderr
    assert [row["verdict"] for row in summary(tmp_path / "out")] == ["accepted", "accepted"]


@pytest.mark.parametrize("flags", [pytest.param((), marks=pytest.mark.soak), ("-E",)])
def test_a_comparison_imports_nothing_of_the_working_folder(planted, tmp_path, flags):
    _, working, marks = planted
    # An engine of the script itself is found as well.
    program = (
        f"import sys\nsys.path.insert(1, {str(ROOT)!r})\n"
        "import numpy as np\nfrom dqreg.compare import Protocol, compare\n"
        "from dqreg.synth import demo_case, load_case\n"
        "class Knowing:\n    name = 'knowing'\n"
        "    def register(self, task):\n        return load_case(demo_case()).T_target_source\n"
        "if __name__ == '__main__':\n"
        "    protocol = Protocol(settings=('manual',), repeats=1, isolate=True)\n"
        "    print([run.success for run in compare(demo_case(), ['dqreg', Knowing()], protocol=protocol).runs])\n"
    )
    run = ran(tmp_path, working, program, flags=flags)
    assert marked(marks) == []
    assert run.stdout == "[True, True]\n", run.stderr


def test_nothing_stands_before_the_standard_library(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    library = [str(Path(os.__file__).parent), str(Path(os.__file__).parent / "lib-dynload")]
    others = ["/some/where", "/some/site-packages"]
    # An interactive session has the working folder as an empty word: it stays, behind.
    assert safe_path(["", *others[:1], *library, *others[1:]]) == [*library, str(tmp_path), *others]
    assert safe_path([*library, *others]) == [*library, *others]


def test_grandchildren_are_told_as_well():
    assert safe_environment(3)["PYTHONSAFEPATH"] == "1"
    assert safe_environment(3)["OMP_NUM_THREADS"] == "3"
