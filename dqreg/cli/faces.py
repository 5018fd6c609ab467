"""`dqreg faces PART`: the faces of a part with their shape, size and place."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dqreg.cli.outputs import as_json_option, consoles, print_json
from dqreg.cli.registration_options import units_option
from dqreg.cli.values import FILE, UNITS
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.geometry import Mesh
    from dqreg.inspection import Face
    from dqreg.report.table import Table


@click.command("faces")
@click.argument("part", type=FILE)
@click.option("--near", type=float, nargs=3, metavar="X Y Z", help="Only the face that is closest to this point.")
@click.option("--box", type=float, nargs=6, metavar="X Y Z X Y Z", help="Only the faces that lie in this box as a "
              "whole: two opposite corners.")  # fmt: skip
@units_option("target", "PART, where its file does not say")
@click.option("--display-units", type=UNITS, help="Length unit of the table, and of all lengths given here  [default: "
              "PART's].")  # fmt: skip
@as_json_option
def faces_command(
    part: Path,
    near: tuple[float, float, float] | None,
    box: tuple[float, ...] | None,
    target_units: str | None,
    display_units: str | None,
    as_json: bool,
) -> int:
    """List the faces of PART: planes, cylinders (holes and bosses), cones, spheres, tori (fillets) and free faces.

    \b
    dqreg faces part.stl
    dqreg faces part.stl --near 46.5 20 5          which face is here?
    dqreg faces part.stl --box 0 0 9 120 80 11     which lie in this box?
    dqreg faces part.stl --target-units m --display-units mm      in the unit of the plan
    dqreg faces part.stl --json

    Exit codes: 0, or 2 for bad input.
    """
    from dqreg.inspection import faces_in_box, nearest_face, part_faces
    from dqreg.report.table import print_tables

    mesh, _ = read_part_in(part, target_units, display_units)
    if display_units is not None and target_units is None and read_part(part).units is None:
        raise InputError(
            f"--display-units {display_units}: {part.name} names no length unit; name it with --target-units"
        )
    faces = part_faces(mesh)
    if near is not None:
        faces = (nearest_face(mesh, faces, near),)
    if box is not None:
        within = {face.number for face in faces_in_box(mesh, faces, box)}
        faces = tuple(face for face in faces if face.number in within)
        if not faces:
            raise InputError("no face of the part lies as a whole in that box")
    if as_json:
        print_json({"units": mesh.units, "faces": [dataclasses.asdict(face) for face in faces]})
        return 0
    console, _ = consoles(quiet=False, as_json=False)
    print_tables(console, [_table(faces, mesh.units or "", part.name)])
    return 0


def read_part(path: Path) -> Mesh:
    """The mesh of a file; `InputError` where it holds a cloud."""
    from dqreg.files import MeshData, read_geometry
    from dqreg.geometry import Mesh

    read = read_geometry(path)
    if not isinstance(read, MeshData):
        raise InputError(f"{path} is a cloud of points and has no faces: give the part as a mesh")
    return Mesh(read.vertices, read.faces, units=read.units, regions=read.regions)


def read_part_in(path: Path, units: str | None, wanted: str | None) -> tuple[Mesh, float]:
    """The part in a unit that was asked for, and the factor to it: 1 where its own unit is not known, or is that one.

    ``units`` is that of the part where its file does not say.
    """
    from dqreg.files.units import factor

    mesh = read_part(path)
    own = units or mesh.units
    if wanted is None or own is None or own == wanted:
        return dataclasses.replace(mesh, units=own or wanted), 1.0
    scale = factor(own, wanted)
    return dataclasses.replace(mesh, vertices=mesh.vertices * scale, units=wanted), scale


def _table(faces: tuple[Face, ...], unit: str, name: str) -> Table:
    from dqreg.report.table import Column, Table

    columns = (
        Column("face"),
        Column("shape"),
        Column("diameter", unit, ".6g"),
        Column("area", f"{unit}^2" if unit else "", ".5g"),
        Column("normal or axis"),
        Column("middle", unit),
    )
    rows = tuple(
        (str(face.number), _shape(face), _diameter(face), face.area, _vector(face), _place(face)) for face in faces
    )
    return Table("faces", f"Faces of {name}", columns, rows)


def _shape(face: Face) -> str:
    if face.torus is not None:
        return f"torus (radii {face.torus.major_radius:.6g}, {face.torus.minor_radius:.6g})"
    return f"{face.kind} (hole)" if face.is_hole else face.kind


def _diameter(face: Face) -> float | None:
    return None if face.feature is None or face.kind == "plane" else face.feature.diameter


def _vector(face: Face) -> str:
    shape = face.torus or face.feature
    if shape is None or face.kind == "sphere":
        return ""
    return " ".join(f"{x + 0.0:.3g}" for x in shape.axis.round(6))


def _place(face: Face) -> str:
    return " ".join(f"{x + 0.0:.6g}" for x in face.centre.round(9))
