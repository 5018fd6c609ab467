"""Mechanical parts as closed triangle meshes, built from their dimensions alone, without a CSG library.

Every part is a pair ``vertices (v, 3) float64, faces (f, 3) int64``. It is watertight, its normals
(right-hand rule) point outwards, and round features are inscribed polygons. `dqreg.synth.parts.kinds` holds
them by name, with the symmetries of each.
"""

from dqreg.rigid.symmetry import Symmetry
from dqreg.synth.parts.blade import blade
from dqreg.synth.parts.blocks import block, feeder, prism
from dqreg.synth.parts.bracket import bracket
from dqreg.synth.parts.kinds import KINDS, symmetry_of
from dqreg.synth.parts.plain import Mesh, box, cylinder, plate
from dqreg.synth.parts.sheet import angle
from dqreg.synth.parts.turned import flange, gear

__all__ = [
    "KINDS",
    "Mesh",
    "Symmetry",
    "angle",
    "blade",
    "block",
    "box",
    "bracket",
    "cylinder",
    "feeder",
    "flange",
    "gear",
    "plate",
    "prism",
    "symmetry_of",
]
