# Either outcome is right here, so errors are looked at where they are caught.
# ruff: noqa: PT017, SIM105, PT012
from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import CloudData, MeshData, read_geometry
from dqreg.registration.result.result import Registration
from tests.hostile.bad_files import BAD_FILES, bytes_of
from tests.hostile.good_files import good_files

OPENED: list[str] | None = None


def _listen(event: str, arguments: tuple[Any, ...]) -> None:
    if OPENED is not None and event in ("open", "socket.connect", "subprocess.Popen", "os.system", "exec"):
        OPENED.append(f"{event} {arguments[0]!s}")


@cache
def _add_listener() -> None:
    # Hooks cannot be taken away again, and cost every process that has one: this one comes with the first test that
    # asks, and sleeps between them.
    sys.addaudithook(_listen)


@pytest.fixture
def opened() -> Iterator[list[str]]:
    """What the code under test opens, connects to or runs."""
    global OPENED  # noqa: PLW0603
    _add_listener()
    OPENED = []
    yield OPENED
    OPENED = None


def assert_sound(data: CloudData | MeshData) -> None:
    """What a reader promises of whatever it hands back."""
    if isinstance(data, CloudData):
        assert data.points.shape == (len(data.points), 3)
        assert len(data.points) >= 1
        assert np.isfinite(data.points).all()
        assert data.normals is None or np.isfinite(data.normals).all()
        assert data.dropped >= 0
    else:
        assert np.isfinite(data.vertices).all()
        assert len(data.faces) >= 1
        assert data.faces.min() >= 0
        assert data.faces.max() < len(data.vertices)


@pytest.mark.parametrize("name", good_files())
def test_the_good_files_are_good(name: str, tmp_path: Path) -> None:
    extension, content = good_files()[name]
    (tmp_path / f"a{extension}").write_bytes(content)
    data = read_geometry(tmp_path / f"a{extension}")
    assert_sound(data)
    if isinstance(data, CloudData):
        assert len(data.points) == 12
    else:
        assert (len(data.vertices), len(data.faces)) == (8, 12)


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_refused_by_name_or_read_soundly(name: str, tmp_path: Path) -> None:
    file, _, words = BAD_FILES[name]
    path = tmp_path / file
    path.write_bytes(bytes_of(name))
    if words is not None:
        with pytest.raises(InputError, match=rf"(?s)cannot read .*{file}.*({words})"):
            read_geometry(path)
        return
    try:
        data = read_geometry(path)
    except InputError as error:
        assert str(path) in str(error)
    else:
        assert_sound(data)


@pytest.mark.parametrize("name", good_files())
def test_a_file_cut_anywhere_is_refused_or_sound(name: str, tmp_path: Path) -> None:
    extension, content = good_files()[name]
    path = tmp_path / f"a{extension}"
    whole, refused = 0, 0
    for length in np.unique(np.linspace(0, len(content) - 1, 60).astype(int)):
        path.write_bytes(content[:length])
        try:
            assert_sound(read_geometry(path))
            whole += 1
        except InputError:
            refused += 1
    # Text tables have no count of their rows, and the last digit of a last row is not missed.
    assert whole == 0 or name in ("xyz", "xyzn", "csv", "obj", "off", "stl text", "ply cloud text", "ply mesh text",
                                  "pcd text", "kitti", "pts")  # fmt: skip
    assert refused > 0


@pytest.mark.parametrize("name", good_files())
def test_a_file_with_changed_bytes_is_refused_or_sound(name: str, tmp_path: Path) -> None:
    extension, content = good_files()[name]
    path = tmp_path / f"a{extension}"
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(content)
        for place in rng.integers(0, len(content), rng.integers(1, 4)):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged))
        try:
            assert_sound(read_geometry(path))
        except InputError as error:
            assert str(path) in str(error)


@pytest.mark.parametrize("name", [*good_files(), "obj with a material elsewhere", "gltf that names a file outside",
                                  "gltf that hides the dots", "glb that names a file outside", "npy of objects",
                                  "npy of code", "3mf with a file for an entity"])  # fmt: skip
def test_nothing_outside_the_folder_is_opened_and_nothing_is_run(name: str, tmp_path: Path, opened: list[str]) -> None:
    if name in BAD_FILES:
        file, content = BAD_FILES[name][0], bytes_of(name)
    else:
        file, content = f"a{good_files()[name][0]}", good_files()[name][1]
    folder = tmp_path / "inner"
    folder.mkdir()
    for secret in ("secret.bin", "secret.mtl"):
        (tmp_path / secret).write_bytes(b"newmtl a\n" + bytes(4096))
    (folder / file).write_bytes(content)
    # Once before: the parsers themselves are imported then, which opens files too.
    for _ in range(2):
        opened.clear()
        try:
            read_geometry(folder / file)
        except InputError:
            pass
    places = [event.removeprefix("open ") for event in opened if event.startswith("open ")]
    assert [place for place in places if not Path(place).is_relative_to(folder)] == []
    assert [event for event in opened if not event.startswith("open ")] == []


def test_a_link_out_of_the_folder_is_not_followed_from_inside_a_file(tmp_path: Path) -> None:
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(4096))
    (folder / "buffer.bin").symlink_to(tmp_path / "secret.bin")
    path = folder / "a.gltf"
    path.write_bytes(bytes_of("gltf that names a missing file").replace(b"gone.bin", b"buffer.bin"))
    with pytest.raises(InputError, match="own folder"):
        read_geometry(path)


@pytest.mark.parametrize("path", ["", "\0", "a\0b.ply", "x" * 5000 + ".ply", "/dev/null", "/dev/zero", ".", "..", "~"])
def test_a_path_that_is_none_is_refused_by_name(path: str) -> None:
    with pytest.raises(InputError), warnings.catch_warnings():
        warnings.simplefilter("error")
        read_geometry(path)


@pytest.mark.parametrize("path", [None, 3, 1.5, [], b"a.ply", object(), ("a.ply",)])
def test_what_is_no_path_is_refused_by_name(path: Any) -> None:
    with pytest.raises(InputError, match="path"):
        read_geometry(path)


CORPUS = sorted(Path(__file__).with_name("corpus").iterdir())
# The formats that the first byte of a corpus file chooses from, as `fuzz_readers` counts them.
SUFFIXES = [".ply", ".pcd", ".xyz", ".xyzn", ".csv", ".npy", ".npz", ".stl", ".off", ".obj", ".glb", ".gltf", ".3mf",
            ".json", ".las", ".e57", ".bin", ".pts"]  # fmt: skip


@pytest.mark.parametrize("name", [place.name for place in CORPUS])
def test_what_the_fuzzer_found_stays_mended(name: str, tmp_path: Path) -> None:
    data = Path(__file__).with_name("corpus").joinpath(name).read_bytes()
    path = tmp_path / f"a{SUFFIXES[data[0] % len(SUFFIXES)]}"
    path.write_bytes(data[1:])
    try:
        if path.suffix == ".json":
            Registration.load(path)
        else:
            assert_sound(read_geometry(path))
    except InputError as error:
        assert str(path) in str(error)
