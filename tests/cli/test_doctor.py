from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from packaging.requirements import Requirement

from dqreg.cli import doctor as room
from dqreg.cli.doctor import Check, doctor, examine
from dqreg.errors import MissingDependencyError

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
LIBGL = "Open3D cannot load: the system library libGL.so.1 is missing; run: apt-get install libgl1"


def install(monkeypatch: pytest.MonkeyPatch, **versions: str | None) -> None:
    """Pretend that these distributions have these versions, or (None) are missing."""
    real = importlib.metadata.version

    def version(name: str) -> str:
        key = name.replace("-", "_")
        if key not in versions:
            return real(name)
        found = versions[key]
        if found is None:
            raise importlib.metadata.PackageNotFoundError(name)
        return found

    monkeypatch.setattr(importlib.metadata, "version", version)


def by_name() -> dict[str, Check]:
    return {check.name: check for check in examine()}


def break_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> Any:
        raise MissingDependencyError(LIBGL)

    monkeypatch.setattr(room, "load_open3d", fail)


def test_here_all_that_is_required_works() -> None:
    checks = by_name()
    required = {"Python", "dqreg", "numpy", "scipy", "open3d", "trimesh", "click", "rich", "processor cores"}
    assert required <= set(checks)
    assert all(checks[name].ok and checks[name].version and not checks[name].remedy for name in required)
    assert int(checks["processor cores"].version or 0) >= 1
    assert checks["numpy"].version == importlib.metadata.version("numpy")


def test_checks_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        examine()[0].ok = False  # type: ignore[misc]


@pytest.mark.parametrize("name", ["numpy", "scipy", "trimesh", "click", "rich"])
def test_a_missing_part_fails_with_its_command(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    install(monkeypatch, **{name: None})
    check = by_name()[name]
    assert (check.version, check.ok, check.extra) == (None, False, "")
    assert check.remedy == f"pip install '{name}{check.needed}'"
    assert check.needed.startswith(">=")


ASKED = [
    "numpy>=1.26",
    "open3d-cpu>=0.19; sys_platform == 'linux'",
    "open3d>=0.19; sys_platform != 'linux'",
    "gone>=1; sys_platform == 'nowhere'",
    "dqreg[odometry]; extra == 'peers'",
    "kiss-icp>=1.2; extra == 'odometry'",
    "small-gicp>=1.0; extra == 'all'",
    "small-gicp>=1.0; extra == 'peers'",
    "never>=1; python_version < '3' and extra == 'peers'",
    "ruff>=0.9; extra == 'lint'",
]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the package asks for, whatever is installed here."""
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ASKED)


@pytest.mark.usefixtures("asked")
def test_every_extra_is_listed_with_its_bound_from_the_metadata() -> None:
    listed = {check.name: (check.needed, check.extra) for check in examine() if check.needed}
    assert listed == {"numpy": (">=1.26", ""), "kiss-icp": (">=1.2", "odometry"), "small-gicp": (">=1.0", "peers")}


@pytest.mark.usefixtures("asked")
@pytest.mark.parametrize(("name", "extra"), [("kiss-icp", "odometry"), ("small-gicp", "peers")])
def test_a_missing_peer_is_no_failure(monkeypatch: pytest.MonkeyPatch, name: str, extra: str) -> None:
    install(monkeypatch, **{name.replace("-", "_"): None})
    check = by_name()[name]
    assert (check.version, check.ok, check.remedy) == (None, True, f"pip install 'dqreg[{extra}]'")


@pytest.mark.usefixtures("asked")
def test_a_version_below_the_bound_fails_where_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, numpy="1.25.9", kiss_icp="1.1", small_gicp="1.0.1")
    checks = by_name()
    assert (checks["numpy"].ok, checks["numpy"].remedy) == (False, "pip install 'numpy>=1.26'")
    assert (checks["kiss-icp"].ok, checks["kiss-icp"].remedy) == (True, "pip install 'dqreg[odometry]'")
    assert checks["small-gicp"].remedy == ""
    lines = CliRunner().invoke(doctor, []).output.splitlines()
    assert "old\tkiss-icp\t1.1\tpip install 'dqreg[odometry]'\t>=1.2\todometry" in lines


@pytest.mark.parametrize(
    ("system", "machine", "libc", "python", "served"),
    [
        ("Linux", "x86_64", ("glibc", "2.36"), (3, 11), True),
        ("Linux", "aarch64", ("glibc", "2.35"), (3, 14), True),
        ("Linux", "x86_64", ("glibc", "2.34"), (3, 11), False),
        ("Linux", "x86_64", ("", ""), (3, 11), False),
        ("Linux", "x86_64", ("glibc", "2.40"), (3, 15), False),
        ("Darwin", "arm64", ("", ""), (3, 12), True),
        ("Darwin", "x86_64", ("", ""), (3, 12), False),
        ("Windows", "AMD64", ("", ""), (3, 12), True),
        ("Windows", "ARM64", ("", ""), (3, 12), False),
    ],
)
def test_platforms_that_open3d_does_not_serve_are_told(
    monkeypatch: pytest.MonkeyPatch, system: str, machine: str, libc: tuple[str, str], python: tuple[int, int],
    served: bool,
) -> None:  # fmt: skip
    # From the wheels' names at PyPI, Open3D 0.20.0: manylinux_2_35 (x86_64, aarch64), macosx arm64, win_amd64.
    for name, value in (("system", system), ("machine", machine), ("libc_ver", libc)):
        monkeypatch.setattr(room.platform, name, lambda value=value: value)
    monkeypatch.setattr(room.sys, "version_info", python)
    check = room._platform()
    assert check.ok
    assert (check.remedy == "") == served
    assert served or "glibc 2.35" in check.remedy


@pytest.mark.skipif(sys.platform != "linux", reason="only Open3D's Linux wheels need libusb")
def test_a_missing_libusb_wheel_is_no_failure_while_open3d_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, libusb_package=None)
    check = by_name()["libusb-package"]
    assert (check.version, check.ok) == (None, True)
    assert check.remedy.startswith("pip install 'libusb-package>=")


def test_open3d_fails_with_the_sentence_of_the_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    break_open3d(monkeypatch)
    assert by_name()["open3d"] == Check("open3d", None, ok=False, remedy=LIBGL)


def test_two_open3ds_must_not_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, open3d="0.19.0", open3d_cpu="0.20.0")
    check = by_name()["one Open3D only"]
    assert not check.ok
    assert check.version == "open3d 0.19.0 and open3d-cpu 0.20.0"
    assert check.remedy == "pip uninstall -y open3d open3d-cpu && pip install open3d-cpu"
    install(monkeypatch, open3d=None, open3d_cpu="0.20.0")
    assert "one Open3D only" not in by_name()


def test_an_old_python_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "LEAST_PYTHON", (99, 0))
    check = by_name()["Python"]
    assert not check.ok
    assert check.remedy == "install Python 99.0 or newer"


def test_the_source_folder_counts_as_dqreg(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, dqreg=None)
    assert by_name()["dqreg"].ok


def test_piped_output_is_one_plain_line_per_check() -> None:
    result = CliRunner().invoke(doctor, [])
    assert result.exit_code == 0, result.output
    lines = [line.split("\t") for line in result.output.splitlines()]
    assert [line[1] for line in lines] == [check.name for check in examine()]
    assert {line[0] for line in lines} <= {"ok", "optional", "old"}
    assert "\x1b" not in result.output


def test_a_failure_is_marked_and_ends_with_one(monkeypatch: pytest.MonkeyPatch) -> None:
    break_open3d(monkeypatch)
    result = CliRunner().invoke(doctor, [])
    assert result.exit_code == 1
    assert f"FAIL\topen3d\tmissing\t{LIBGL}" in result.output.splitlines()


def test_an_optional_part_does_not_change_the_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, kiss_matcher=None)
    result = CliRunner().invoke(doctor, [])
    assert result.exit_code == 0
    assert any(line.startswith("optional\tkiss-matcher\tmissing\tpip install ") for line in result.output.splitlines())


def test_a_terminal_gets_a_table_with_every_remedy_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    break_open3d(monkeypatch)
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    with pytest.raises(SystemExit) as ended:
        doctor([])
    assert ended.value.code == 1
    table = capsys.readouterr().out
    assert LIBGL in table
    assert "what to do" in table
    assert all(check.name in table for check in examine())


def test_importing_the_command_loads_nothing_heavy() -> None:
    heavy = "('open3d', 'scipy', 'trimesh', 'matplotlib', 'rich.table')"
    code = f"import sys, dqreg.cli.doctor; sys.exit(any(name in sys.modules for name in {heavy}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_json_holds_the_same_checks() -> None:
    result = CliRunner().invoke(doctor, ["--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output) == [dataclasses.asdict(check) for check in examine()]


def test_compile_fills_the_folder_and_the_table_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from dqreg.kernels.compiling import cache, compile_all

    compiled = []
    monkeypatch.setattr(compile_all, "compile_for_all_users", lambda: compiled.append(True))
    for words in ([], ["--compile"]):
        result = CliRunner().invoke(doctor, words)
        assert result.exit_code == 0, result.output
    assert compiled == [True]
    found = by_name()["compiled inner loops"]
    assert found.ok
    assert str(cache.beside_package().name) in (found.version or "")
    monkeypatch.setattr(cache, "folders", lambda: ((), None))
    assert "NUMBA_CACHE_DIR" in by_name()["compiled inner loops"].remedy


def test_without_numba_the_folder_is_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, numba=None)
    assert "compiled inner loops" not in by_name()


def test_the_extra_all_is_every_extra_that_a_user_may_ask_for() -> None:
    extras = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (bundle,) = extras["all"]
    # Two are there for those who name them, and bring nothing that dqreg uses.
    expected = extras.keys() - set(room.UNNAMED_EXTRAS) - {"odometry", "3mf"}
    assert set(Requirement(bundle).extras) == expected
