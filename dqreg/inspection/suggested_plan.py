"""A first plan for a part: datums from its largest planes, holes, bosses and faces as characteristics."""

from __future__ import annotations

import math
from collections.abc import Mapping

from dqreg.geometry import Mesh
from dqreg.inspection.part_faces import Face, part_faces

# A second datum's normal turns from the first's by more than its cosine, and a third's from both.
SQUARE = 0.1
# The tolerance that is written, to be changed: that share of the part's size, one digit.
TOLERANCE = 5e-4
# Share of a face from which on a scan says something of it.
SEEN = 0.2
NO_DATUMS = "# No three planes at right angles: values are those of the best fit. Datums are [[datum]] tables.\n"
# Characteristics at most; the largest faces come first.
MOST = 40


def suggested_plan(mesh: Mesh, covered: Mapping[int, float] | None = None, units: str | None = None) -> str:
    """A plan in TOML for a part, to be edited: three datums where it has them, its cylinders, its faces.

    ``covered`` is the share of each face that a scan covers: faces below a fifth are left out, with a comment.

    >>> from dqreg.synth.parts import box
    >>> print(suggested_plan(Mesh(*box((3.0, 2.0, 1.0)))).count("[[datum]]"))
    3
    """
    every = part_faces(mesh)
    faces = tuple(face for face in every if covered is None or covered.get(face.number, 0.0) >= SEEN)
    size = mesh.diagonal * TOLERANCE
    tolerance = round(size, -math.floor(math.log10(size)))
    units = units or mesh.units
    unit = units or "the part's unit"
    lines = [
        f"# Lengths are in {unit}, angles in degrees. Tolerances are guesses from the part's size: replace them.",
        *_left_out(every, faces),
        f'units = "{units}"\n' if units else '# units = "mm"   # of this plan, and of a part whose file does not say\n',
        '[head]\npart = ""\ndrawing = ""\nserial = ""\noperator = ""\ndevice = ""\n',
    ]
    datums = _datums(faces)
    if not datums:
        lines.append(NO_DATUMS)
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


def _left_out(every: tuple[Face, ...], faces: tuple[Face, ...]) -> list[str]:
    missing = sorted({face.number for face in every} - {face.number for face in faces})
    if not missing:
        return []
    return [
        "# Not in this plan, because the scan covers less than a fifth of them: faces " + ", ".join(map(str, missing))
    ]


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
