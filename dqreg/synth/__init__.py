"""Virtual scans with known truth: parts, scanners, error models and the cases made of them.

- `dqreg.synth.parts`: mechanical parts as closed meshes, and their symmetries.
- `dqreg.synth.cameras`, `dqreg.synth.patterns`, `dqreg.synth.tactile`: cameras, structured light and LiDAR, probes.
- `dqreg.synth.scene`, `dqreg.synth.motion`, `dqreg.synth.noise`: surroundings, motion and errors.
- `dqreg.synth.raycast`, `dqreg.synth.scanner`: what rays meet, and the scan.
- `dqreg.synth.faults`: waves on a face, a feature moved or of another size.
- `dqreg.synth.coverage`: the fraction of the surface that is seen.
- `dqreg.synth.truth`, `dqreg.synth.range_bound`: known motions, pose errors, and the least error there is.
- `dqreg.synth.recipe`, `dqreg.synth.cases`: a case as a text file, and as a folder.
"""

from dqreg.synth.cameras import Scanner
from dqreg.synth.cases import Case, demo_case, load_case, write_case
from dqreg.synth.coverage import visible_share
from dqreg.synth.faults import form_error, moved_feature
from dqreg.synth.motion import Motion
from dqreg.synth.noise import Noise
from dqreg.synth.patterns import Lidar, StructuredLight
from dqreg.synth.range_bound import cramer_rao_bound
from dqreg.synth.recipe import Recipe, read_recipe
from dqreg.synth.scan import Scan
from dqreg.synth.scanner import scan_mesh
from dqreg.synth.scene import Scene
from dqreg.synth.tactile import TactileProbe, touch_mesh
from dqreg.synth.truth import (
    disturbance,
    nearest_truth,
    random_pose,
    rms_vertex_displacement,
    worst_vertex_displacement,
)

__all__ = [
    "Case",
    "Lidar",
    "Motion",
    "Noise",
    "Recipe",
    "Scan",
    "Scanner",
    "Scene",
    "StructuredLight",
    "TactileProbe",
    "cramer_rao_bound",
    "demo_case",
    "disturbance",
    "form_error",
    "load_case",
    "moved_feature",
    "nearest_truth",
    "random_pose",
    "read_recipe",
    "rms_vertex_displacement",
    "scan_mesh",
    "touch_mesh",
    "visible_share",
    "worst_vertex_displacement",
    "write_case",
]
