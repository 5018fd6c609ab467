"""A triangle mesh as a surface: exact closest points on its faces, in float64."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.mesh import Mesh
from dqreg.geometry.surface import Closest, Hint, as_queries

if TYPE_CHECKING:
    from dqreg.kernels.trees.triangle_tree import TriangleTree


class MeshSurface:
    """A triangle mesh as a surface.

    A compiled tree of boxes over the triangles answers in float64; it is built when it is first asked.

    Parameters
    ----------
    mesh : Mesh
        The target part.

    Attributes
    ----------
    oriented : bool
        True: the normals of faces point outwards.

    Examples
    --------
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    >>> MeshSurface(mesh).closest(np.array([[0.5, 0.5, 3.0], [-1.0, -1.0, 0.0]])).points.tolist()
    [[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]
    """

    oriented = True

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.diagonal = mesh.diagonal
        self.centre = mesh.centre

    @property
    def borders(self) -> MeshBoundary | None:
        """Where the surface ends; None for a closed mesh."""
        return self.mesh.borders

    @cached_property
    def _tree(self) -> TriangleTree:
        # Numba is loaded where a target is first asked.
        from dqreg.kernels.trees.triangle_tree import TriangleTree

        return TriangleTree.of(self.mesh.corners, self.mesh.face_normals)

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Closest point on the triangles for each query.

        Parameters
        ----------
        points : ndarray, (n, 3)
            Queries in the mesh's frame; n may be 0. What is not finite is answered as what lies beyond ``within``.
        hint : (ndarray, Closest), optional
            Earlier places of the same queries and the answer there: the search begins with those faces.
        within : float
            Distance from which on nothing is looked for: points and normals are NaN there, distances infinite and
            faces -1.

        Returns
        -------
        Closest
            Points, face normals, distances and face numbers.

        Raises
        ------
        InputError
            If the queries are no (n, 3) real numbers.
        """
        points = as_queries(points)
        return Closest(*self._tree.closest(points, None if hint is None else hint[1].elements, within))

    def _closest_facing(
        self, points: FloatArray, directions: FloatArray, cosine: float, within: float
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Closest points on faces that look to a direction each, distances and faces: inf and -1 where none is near."""
        return self._tree.closest_facing(points, directions, cosine, within)

    def _distances_at(
        self, rotations: FloatArray, shifts: FloatArray, points: FloatArray, within: float, *, by_point: bool = False
    ) -> FloatArray:
        """Distances of m points under each of n poses, (n, m), infinite from a length on."""
        return self._tree.distances(rotations, shifts, points, within, by_point=by_point)
