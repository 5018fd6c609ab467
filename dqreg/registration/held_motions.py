"""What both sides of some pairs say of the motions: normals of the scan, and which motions the shape holds."""

from __future__ import annotations

from dqreg._arrays import FloatArray, product
from dqreg.geometry import CloudSurface, MeshSurface, Surface
from dqreg.geometry.mesh_normals import smooth_normals_of
from dqreg.icp import Correspondences
from dqreg.trust.information import held_part


def own_normals(surface: Surface, pairs: Correspondences) -> FloatArray | None:
    """Normals of the scan in the target's frame, (n, 3), where those of the target are estimates too."""
    if not isinstance(surface, CloudSurface) or not pairs.closest.normals.any():
        return None
    return product(pairs.scan.normals, pairs.T_target_source[:3, :3].T)


def held_by_shape(pairs: Correspondences, weights: FloatArray) -> FloatArray | None:
    """What leaves of a twist about the target's origin what the shape holds, (6, 6); None where it holds all six.

    None as well where there are no normals to tell it.
    """
    surface, found = pairs.surface, pairs.closest
    if surface is None or not found.normals.any():
        return None
    smooth, own = found.normals, own_normals(surface, pairs)
    if isinstance(surface, MeshSurface):
        smooth = smooth_normals_of(surface.mesh, found.points, found.elements, found.normals)
    return held_part(pairs.moved, found.normals, weights, 0.5 * surface.diagonal, smooth, own)
