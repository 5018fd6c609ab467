"""A first plan for a part: datums from its largest planes, holes, bosses and faces as characteristics."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dqreg._arrays import FloatArray, bounds
from dqreg.geometry import Mesh
from dqreg.inspection.part_faces import Face, part_faces
from dqreg.inspection.plan.round_faces import is_arc, slender
from dqreg.inspection.plan.suggested_datums import suggest_datums

# The tolerance that is written, to be changed: that share of the part's size, one digit.
TOLERANCE_DIAGONALS = 5e-4
# Share of a face from which on a scan says something of it.
MIN_SEEN_SHARE = 0.2
# Or from the scan's noise: so many of its standard deviations can be decided.
DECIDABLE_SIGMAS = 6.0
TOP = """\
# Deviations of the whole surface; unequal sides are plus = 0.2 and minus = 0.1. A [[face]] with its own tolerance is
# an exception.
# tolerance = {tolerance}
# What values are of: the datums, where there are any; or alignment = "best-fit"; or steps that follow each other:
# [[alignment]]
# name = "machined faces"
# kind = "best-fit"         # or tolerance, minimax, outside, inside, datums, points
# faces = [0, 3]            # none: all
# dof = "tz rx ry"          # what may move; none: all
"""
SECTION = """\
# A cut of part and scan for the report:
# [[section]]
# name = "middle"
# point = [{}]
# normal = [1, 0, 0]
# What the report shows beside its head, decisions and characteristics; all of it where nothing is chosen:
# [report]
# parts = ["view", "deviations", "regions", "sections", "faces", "checks", "uncertainty", "pose", "run"]
# cuts = ["middle"]           # which sections are drawn
# views = ["iso", "top"]      # pictures in print: a name, or [yaw, pitch] in degrees
"""
NO_DATUMS = "# No faces hold all six motions: values are those of the best fit. Datums are [[datum]] tables.\n"
# From so many diameters on the axis of a cylinder may bend.
SLENDER_DIAMETERS = 3.0
# Characteristics at most; the largest faces come first.
MAX_CHARACTERISTICS = 40


def suggested_plan(
    mesh: Mesh,
    covered: Mapping[int, float] | None = None,
    units: str | None = None,
    noise: float = 0.0,
) -> str:
    """A plan in TOML for a part, to be edited: three datums where it has them, its cylinders, its faces.

    ``covered`` is the share of each face that a scan covers: faces below a fifth are left out, with a comment.
    ``noise`` is that of the scan: tolerances that it cannot decide are not suggested.

    >>> from dqreg.synth.parts import box
    >>> print(suggested_plan(Mesh(*box((3.0, 2.0, 1.0)))).count("[[datum]]"))
    3
    """
    every = part_faces(mesh)
    faces = tuple(face for face in every if covered is None or covered.get(face.number, 0.0) >= MIN_SEEN_SHARE)
    size = max(mesh.diagonal * TOLERANCE_DIAGONALS, DECIDABLE_SIGMAS * noise)
    tolerance = round(size, -math.floor(math.log10(size)))
    units = units or mesh.units
    lines = [
        *_unit_words(mesh, units),
        f"# Tolerances are guesses from {_guessed(noise, units)}the part's size: replace them.",
        "# Run it: dqreg inspect SCAN PART --plan THIS_FILE --report sheet.html",
        *_left_out(every, faces),
        f'units = "{units}"\n' if units else '# units = "mm"\n',
        TOP.format(tolerance=f"{2 * tolerance:g}"),
        '[head]\npart = ""\ndrawing = ""\nserial = ""\noperator = ""\ndevice = ""\n',
    ]
    chosen = suggest_datums(mesh, faces, covered)
    datums = {each.name: each.face for each in chosen}
    if not datums:
        lines.append(NO_DATUMS)
    places = {face.number: _place(face, mesh.diagonal) for face in faces}
    lines += [f'[[datum]]  # {each.reason}\nname = "{each.name}"\n{places[each.face.number]}\n' for each in chosen]
    rows: list[str] = []
    for letter, face in datums.items():
        rows.append(_row(f"datum {letter} form", "form", places[face.number], tolerance))
        if letter != "A" and face.kind == "plane":
            rows.append(
                _row(f"datum {letter} to A", "perpendicularity", places[face.number], tolerance, 'datum = "A"\n')
            )
    known = {face.number for face in datums.values()}
    for face in sorted(faces, key=lambda face: -face.area):
        name, place = f"{'hole' if face.is_hole else face.kind} {face.number}", places[face.number]
        if face.kind == "cylinder" and not is_arc(mesh, face):
            rows.append(_row(f"{name} diameter", "diameter", place, tolerance))
            if datums:
                rows.append(_row(f"{name} position", "position", place, 2 * tolerance))
            diameters = slender(mesh, face)
            if diameters > 0.0 and not face.is_hole:
                rows.append(_row(f"{name} roundness", "roundness", place, tolerance))
            if diameters >= SLENDER_DIAMETERS:
                rows.append(_row(f"{name} axis", "straightness", place, 2 * tolerance, 'of = "axis"\n'))
        elif face.number not in known:
            rows.append(_row(f"{name} profile", "profile", place, 2 * tolerance))
    kept = rows[:MAX_CHARACTERISTICS]
    if len(rows) > MAX_CHARACTERISTICS:
        kept.append(f"# {len(rows) - MAX_CHARACTERISTICS} smaller faces are left out: see dqreg faces.\n")
    return "\n".join([*lines, *kept, SECTION.format(", ".join(_short(mesh.centre, mesh.diagonal)))])


def _place(face: Face, size: float) -> str:
    at = ", ".join(_short(face.centre, size))
    towards = ""
    if face.feature is not None and face.kind == "plane":
        towards = " towards (" + ", ".join(f"{x + 0.0:.3g}" for x in face.feature.axis.round(3)) + ")"
    kind = "hole" if face.is_hole else face.kind
    return f"face = {face.number:<12d} # {kind}{towards}, middle at ({at})"


def _short(point: FloatArray, size: float) -> list[str]:
    """Coordinates with four digits of the part's size, wherever its origin is: finer ones are rounding."""
    decimals = max(3 - math.floor(math.log10(size)), 0)
    fixed = [f"{round(float(x), decimals) + 0.0:.{decimals}f}" for x in point]
    return [each.rstrip("0").rstrip(".") if decimals else each for each in fixed]


def _unit_words(mesh: Mesh, units: str | None) -> list[str]:
    """In which unit the lengths of a plan are, of a part whose file does not say as well."""
    if units:
        return [f"# Lengths are in {units}, angles in degrees."]
    long = float(np.subtract(*bounds(mesh.vertices)[::-1]).max())
    return [
        f"# The part's file names no unit: lengths are its numbers, of which the part is {long:.4g} long; angles in",
        "# degrees. If those are mm, say so in the line of the units below, which is of this plan and of the part.",
    ]


def _guessed(noise: float, units: str | None) -> str:
    unit = f" {units}" if units else ""
    return f"the scan's noise ({noise:.2g}{unit}) and " if noise else ""


def _left_out(every: tuple[Face, ...], faces: tuple[Face, ...]) -> list[str]:
    missing = sorted({face.number for face in every} - {face.number for face in faces})
    if not missing:
        return []
    return [
        "# Not in this plan, because the scan covers less than a fifth of them: faces " + ", ".join(map(str, missing))
    ]


def _row(name: str, kind: str, place: str, tolerance: float, more: str = "") -> str:
    """A characteristic, whose line of the face says what and where that is."""
    return f'[[characteristic]]\nname = "{name}"\nkind = "{kind}"\n{place}\n{more}tolerance = {tolerance:g}\n'
