from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from dqreg.errors import InputError
from dqreg.files import READERS, read_cloud, read_geometry, read_mesh
from dqreg.files.untrusted import ENDINGS

ALL = [read_cloud, read_mesh, read_geometry]


def test_the_endings_that_are_proposed_are_those_that_can_be_read() -> None:
    records = {".json", ".toml", ".tum", ".g2o", ".bag", ".mcap", ".db3"}
    assert set(ENDINGS) - records == set(READERS)


@pytest.mark.parametrize("read", ALL)
def test_a_missing_file_offers_its_neighbours(tmp_path: Path, read: Any) -> None:
    (tmp_path / "scan_01.ply").touch()
    with pytest.raises(InputError, match=r"no such file; expected perhaps scan_01\.ply in the same folder"):
        read(tmp_path / "scan_1.ply")
    # What lies beside it and is no scan is not what was meant.
    (tmp_path / "mig.py").touch()
    with pytest.raises(InputError, match="no such file; expected the path of a scan or part"):
        read(tmp_path / "mi.ply")
    with pytest.raises(InputError, match="no such file; expected the path of a scan or part"):
        read(str(tmp_path / "zzzzzzzz.stl"))
    with pytest.raises(InputError, match=r"the folder .* cannot be listed"):
        read(tmp_path / "no_folder" / "scan.ply")


def test_a_folder_an_empty_file_and_a_pipe_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder; expected one file in it"):
        read_geometry(tmp_path)
    (tmp_path / "empty.ply").touch()
    with pytest.raises(InputError, match=r"an empty file \(0 bytes\)"):
        read_geometry(tmp_path / "empty.ply")
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(InputError, match="a device or a pipe"):
        read_geometry(tmp_path / "pipe.ply")
    with pytest.raises(InputError, match="found the standard input, a pipe; expected a file on disk"):
        read_geometry("-")


def test_a_forbidden_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "scan.ply"
    file.write_text("ply\n")
    # The superuser may read everything, so the refusal is staged.
    monkeypatch.setattr(Path, "open", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    with pytest.raises(InputError, match=r"scan\.ply: found permission denied; expected a file that may be read"):
        read_geometry(file)


@pytest.mark.parametrize("path", [3, None, b"scan.ply", ["scan.ply"]])
def test_what_is_no_path_is_refused(path: Any) -> None:
    with pytest.raises(InputError, match="a path must be text or a pathlib path; got"):
        read_geometry(path)


@pytest.mark.parametrize("path", ["a\0.ply", "n" * 5000 + ".ply", ""])
def test_a_path_that_cannot_be_is_refused(path: str) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_geometry(path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("scan.plyy", r"extension '\.plyy'; expected one of .* did you mean \.ply\?"),
        ("scan.xlsx", r"extension '\.xlsx'; expected one of \.3mf \.asc \.bin \.csv"),
        ("scan", "a name without extension"),
        ("part.x_t", "exact CAD surfaces; .* export the part as STEP"),
        ("part.igs", "exact CAD surfaces"),
        ("scan.ptx", r"a scanner's format; .* export the scan as E57 \(read with dqreg\[scans\]\) or PLY"),
        ("scan.fls", "a scanner's format"),
        ("scan.ply.gz", "a compressed file; .* unpack it first"),
        ("drive.bag", "a bag of many scans; .* dqreg odometry reads it"),
        ("depth.png", "an image; .* dqreg.PointCloud.from_depth makes a cloud"),
        ("part.vtp", "VTK's own data; .* save it as PLY"),
    ],
)
def test_an_unknown_kind_lists_the_known_ones(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_text("something")
    with pytest.raises(InputError, match=message) as caught:
        read_geometry(tmp_path / name)
    assert all(extension in str(caught.value) for extension in READERS)


@pytest.mark.parametrize(
    ("name", "head", "message"),
    [
        ("scan.ply", b"\xff\xd8\xff\xe0\0\x10JFIF", "a JPEG image; expected what the extension .ply promises"),
        ("scan.xyz", b"\x89PNG\r\n", "a PNG image"),
        ("part.stl", b"ply\nformat", r"a PLY file; .* rename it to \.ply"),
        ("scan.ply", b"# .PCD v0.7\n", r"a PCD file; .* rename it to \.pcd"),
        ("scan.npy", b"PK\x03\x04", "a zip archive"),
        ("part.gltf", b"glTF\2\0\0\0", r"rename it to \.glb"),
        ("scan.ply", b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        ("scan.pcd", b"<!DOCTYPE html><html>", "a web page"),
        ("scan.csv", b"\x1f\x8b\x08", "unpack it first"),
    ],
)
def test_a_mislabelled_file_is_told_by_its_first_bytes(tmp_path: Path, name: str, head: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(head)
    with pytest.raises(InputError, match=message):
        read_geometry(tmp_path / name)


@pytest.mark.parametrize("extension", sorted(READERS))
def test_noise_in_any_format_is_an_input_error_and_silent(
    tmp_path: Path, extension: str, capfd: pytest.CaptureFixture[str]
) -> None:
    if extension == ".3mf":
        pytest.importorskip("lxml")
        pytest.importorskip("networkx")
    if extension in (".step", ".stp"):
        pytest.importorskip("cascadio")
    file = tmp_path / f"noise{extension}"
    for seed in range(4):
        file.write_bytes(bytes((seed + 7 * k * k) % 256 for k in range(300)))
        with pytest.raises(InputError, match="cannot read"):
            read_geometry(file)
    assert capfd.readouterr() == ("", "")
