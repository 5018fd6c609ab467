"""Virtual scans with known truth: parts, a scanner, error measures and the cases made of them.

- `dqreg.synth.parts`: mechanical parts as closed meshes. - `dqreg.synth.views`, `dqreg.synth.noise`,
`dqreg.synth.scanner`: what sees the part, what goes wrong, the scan. - `dqreg.synth.coverage`: the share of
the surface that is seen. - `dqreg.synth.truth`, `dqreg.synth.bound`: known motions, distances from the truth,
the best accuracy there is. - `dqreg.synth.recipe`, `dqreg.synth.cases`: a case as a text file, and as a
folder.
"""

from dqreg.synth.bound import cramer_rao_bound
from dqreg.synth.cases import Case, demo_case, load_case, write_case
from dqreg.synth.coverage import visible_share
from dqreg.synth.noise import Noise
from dqreg.synth.recipe import Recipe, read_recipe
from dqreg.synth.scanner import Scan, scan_mesh
from dqreg.synth.truth import disturbance, random_pose, rms_vertex_displacement, worst_vertex_displacement
from dqreg.synth.views import Scanner

__all__ = [
    "Case",
    "Noise",
    "Recipe",
    "Scan",
    "Scanner",
    "cramer_rao_bound",
    "demo_case",
    "disturbance",
    "load_case",
    "random_pose",
    "read_recipe",
    "rms_vertex_displacement",
    "scan_mesh",
    "visible_share",
    "worst_vertex_displacement",
    "write_case",
]
