from __future__ import annotations

import importlib.metadata
import os
import sys

import numpy as np
import pytest

from dqreg._open3d import load_open3d
from dqreg.compare.engines import ENGINES, EngineOutput, Task, available, engine, missing
from dqreg.compare.engines import simpleicp as simpleicp_
from dqreg.compare.engines.harness import limited, silent
from dqreg.errors import InputError, MissingDependencyError, load_package
from tests.compare.engines.cases import task

HIDDEN = {
    "small_gicp gicp": ("small_gicp", "small-gicp"),
    "kiss-icp map": ("kiss_icp", "kiss-icp"),
    "simpleicp": ("simpleicp", "simpleicp"),
    "kiss-matcher": ("kiss_matcher", "kiss-matcher"),
    "trimesh mesh_other": ("rtree", "rtree"),
}


class Mine:
    name = "mine"

    def register(self, task: Task) -> EngineOutput:
        return EngineOutput(np.eye(4))


def test_names_and_objects_are_both_engines() -> None:
    assert engine("dqreg") is ENGINES["dqreg"]
    mine = Mine()
    assert engine(mine) is mine
    with pytest.raises(InputError, match="not an engine"):
        engine(3)  # type: ignore[arg-type]


def test_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean open3d point-to-plane"):
        engine("Open3D point2plane")
    with pytest.raises(InputError, match="known are dqreg, "):
        engine("zzzz")


def test_registry_is_read_only_and_named_consistently() -> None:
    assert all(name == item.name for name, item in ENGINES.items())
    with pytest.raises(TypeError):
        ENGINES["mine"] = ENGINES["dqreg"]  # type: ignore[index]


@pytest.mark.parametrize("name", list(HIDDEN))
def test_absent_peer_names_the_command(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, distribution = HIDDEN[name]
    for loaded in [key for key in sys.modules if key == module or key.startswith(f"{module}.")]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingDependencyError, match=f"pip install {distribution}"):
        ENGINES[name].register(task(name))


def test_absent_peer_is_not_available(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        if name == "small-gicp":
            raise importlib.metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(importlib.metadata, "version", version)
    assert missing(ENGINES["small_gicp icp"]) == ("small-gicp",)
    assert set(ENGINES) - set(available()) == {name for name, item in ENGINES.items() if "small-gicp" in item.needs}


def test_peer_that_is_there_but_broken_says_so(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_peer.py").write_text("import no_such_part\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingDependencyError, match=r"broken-peer cannot load.*no_such_part"):
        load_package("broken_peer", "broken-peer")


def test_simpleicp_refuses_a_pandas_it_cannot_use(monkeypatch: pytest.MonkeyPatch) -> None:
    versions = {"simpleicp": "2.0.15", "pandas": "3.1.1"}
    monkeypatch.setattr(importlib.metadata, "version", versions.__getitem__)
    with pytest.raises(MissingDependencyError, match="pip install 'pandas<3'"):
        simpleicp_.require_old_pandas()
    versions["pandas"] = "2.3.3"
    simpleicp_.require_old_pandas()


def test_silence_covers_python_and_c_and_ends(capfd: pytest.CaptureFixture[str]) -> None:
    def speak(word: str) -> None:
        sys.stdout.write(word)
        sys.stdout.flush()
        os.write(1, word.encode())
        os.write(2, word.encode())

    def speak_silently() -> None:
        with silent():
            speak("hidden")
            raise KeyError

    with pytest.raises(KeyError):
        speak_silently()
    speak("heard")
    printed = capfd.readouterr()
    assert "hidden" not in printed.out + printed.err
    assert printed.out.count("heard") == 2
    assert printed.err == "heard"


def test_thread_limit_holds_inside_and_ends_outside() -> None:
    utility = load_open3d().utility
    if not hasattr(utility, "set_max_threads"):
        pytest.skip("this Open3D has no limit to set; 0.20 brought it")
    before = utility.get_max_threads()
    with limited(1) as force:
        assert utility.get_max_threads() == force["open3d"] == 1
    assert utility.get_max_threads() == before
