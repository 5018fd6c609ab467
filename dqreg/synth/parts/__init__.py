"""Mechanical parts as closed triangle meshes, built from their dimensions alone, without a CSG library.

Every part is a pair ``vertices (v, 3) float64, faces (f, 3) int64``. It is watertight, its normals
(right-hand rule) point outwards, and round features are inscribed polygons.
"""

from dqreg.synth.parts.bracket import bracket
from dqreg.synth.parts.plain import Mesh, box, cylinder, plate

__all__ = ["Mesh", "box", "bracket", "cylinder", "plate"]
