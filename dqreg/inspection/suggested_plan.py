"""A first plan for a part: datums from its largest planes, holes, bosses and faces as characteristics."""

from __future__ import annotations

import math

from dqreg.geometry import Mesh
from dqreg.inspection.part_faces import Face, part_faces

# A second datum's normal turns from the first's by more than its cosine, and a third's from both.
SQUARE = 0.1
# The tolerance that is written, to be changed: that share of the part's size, one digit.
TOLERANCE = 5e-4
# Characteristics at most; the largest faces come first.
MOST = 40


def suggested_plan(mesh: Mesh) -> str:
    """A plan in TOML for a part, to be edited: three datums where it has them, its cylinders, its faces.

    >>> from dqreg.synth.parts import box
    >>> print(suggested_plan(Mesh(*box((3.0, 2.0, 1.0)))).count("[[datum]]"))
    3
    """
    faces = part_faces(mesh)
    size = mesh.diagonal * TOLERANCE
    tolerance = round(size, -math.floor(math.log10(size)))
    unit = mesh.units or "the part's unit"
    lines = [
        f"# Lengths are in {unit}, angles in degrees. Tolerances are guesses from the part's size: replace them.",
        '[head]\npart = ""\ndrawing = ""\nserial = ""\noperator = ""\n',
    ]
    datums = _datums(faces)
    lines += [f'[[datum]]\nname = "{letter}"\nface = {face.number}\n' for letter, face in datums.items()]
    rows: list[str] = []
    for letter, face in datums.items():
        rows.append(_row(f"datum {letter} form", "form", face, tolerance))
        if letter != "A":
            rows.append(_row(f"datum {letter} to A", "perpendicularity", face, tolerance, 'datum = "A"\n'))
    known = {face.number for face in datums.values()}
    for face in sorted(faces, key=lambda face: -face.area):
        name = f"{'hole' if face.is_hole else face.kind} {face.number}"
        if face.kind == "cylinder":
            rows.append(_row(f"{name} diameter", "diameter", face, tolerance))
            if datums:
                rows.append(_row(f"{name} position", "position", face, 2 * tolerance))
        elif face.number not in known:
            rows.append(_row(f"{name} profile", "profile", face, 2 * tolerance))
    return "\n".join([*lines, *rows[:MOST]])


def _datums(faces: tuple[Face, ...]) -> dict[str, Face]:
    chosen: list[Face] = []
    for face in sorted(faces, key=lambda face: -face.area):
        if len(chosen) < 3 and face.kind == "plane" and face.feature is not None:
            axes = [other.feature.axis for other in chosen if other.feature is not None]
            if all(abs(float(axis @ face.feature.axis)) < SQUARE for axis in axes):
                chosen.append(face)
    # Two planes leave a motion open: a frame needs all three.
    return dict(zip("ABC", chosen, strict=True)) if len(chosen) == 3 else {}


def _row(name: str, kind: str, face: Face, tolerance: float, more: str = "") -> str:
    return (
        f'[[characteristic]]\nname = "{name}"\nkind = "{kind}"\nface = {face.number}\n{more}tolerance = {tolerance:g}\n'
    )
