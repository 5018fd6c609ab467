"""A STEP part cut into triangles as finely as the scan can tell."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.files.step import CHORD, file_unit, read_step
from dqreg.files.units import factor
from dqreg.files.untrusted import require_own_kind, require_readable
from dqreg.geometry import Mesh, PointCloud, prepare_scan
from dqreg.geometry.opening import open_geometry

# Largest distance of a triangle from its surface, in the scan's noise and in its spacing: neither shows it.
OF_NOISE, OF_SPACING = 0.1, 0.05
# And in sizes of the part: finer than the first, numbers end; coarser than the second, the shape does.
FINEST, COARSEST = 1e-6, 1e-3
# Points at which planes are fitted for it.
FITTED = 2_000


def is_step(target: Any) -> bool:
    """Whether a target is the path of a STEP file."""
    return isinstance(target, (str, os.PathLike)) and Path(target).suffix.lower() in (".step", ".stp")


def read_for(target: Any, source: Any, source_units: str | None) -> tuple[Mesh, float]:
    """The part of a STEP file for a scan, and the chord that was chosen, in the file's unit."""
    path = require_readable(target)
    require_own_kind(path, path.suffix.lower())
    scan = open_geometry(source, "source")
    points = scan.points if isinstance(scan, PointCloud) else scan.vertices
    found = prepare_scan(PointCloud(points), FITTED)
    unit, own = file_unit(path), source_units or scan.units
    scale = factor(own, unit) if own is not None else 1.0
    size = float(np.linalg.norm(np.ptp(points, axis=0))) * scale
    wanted = min(OF_NOISE * found.noise, OF_SPACING * found.spacing) * scale
    # The scan's size stands for the part's where the file is read: it is asked again by the part itself.
    chord = float(np.clip(wanted, FINEST * size, COARSEST * size)) if wanted > 0.0 else CHORD * size
    data = read_step(path, chord)
    part = float(np.linalg.norm(np.ptp(data.vertices, axis=0)))
    if not FINEST * part <= chord <= COARSEST * part:
        chord = float(np.clip(chord, FINEST * part, COARSEST * part))
        data = read_step(path, chord)
    return Mesh(data.vertices, data.faces, data.units, regions=data.regions), chord
