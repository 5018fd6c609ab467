"""A checked triangle mesh: vertices, faces, and what follows from them."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray, as_vectors, bounds, require_workable_ends
from dqreg._records import made_of, one_line, remember
from dqreg.errors import InputError
from dqreg.geometry import exports
from dqreg.geometry.boundary import MeshBoundary
from dqreg.geometry.checked_faces import CHUNK_FACES, checked_faces, checked_regions, repeated_faces, solid_faces
from dqreg.geometry.topology import FaceFans, SameNodes, Topology


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles of a part, float64; faces without area, and repeats that open a closed mesh, are left out.

    Parameters
    ----------
    vertices : array_like, (v, 3)
        Corner positions in the part's frame, any length unit. Not copied where they are rows of float64.
    faces : array_like of int, (f, 3)
        Three vertex indices per triangle, counter-clockwise seen from outside.
    units : str, optional
        Length unit, where the file says so.
    dropped : int
        Faces left out so far because they have no area; those found here are added.
    flat : array_like of int, (k, 3), optional
        Faces without area found so far. They are no surface, but they may close the seam between two others.
    regions : array_like of int, (f,), optional
        Number of the part's face that each triangle is of, where its file tells (STEP).

    Raises
    ------
    InputError
        If there is no face with an area, an index points outside the vertices, a used vertex is not finite, or
        lengths are beyond what float64 can square.

    Examples
    --------
    >>> mesh = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    >>> mesh.face_normals.tolist(), mesh.diagonal
    ([[0.0, 0.0, 1.0]], 2.8284271247461903)
    >>> len(mesh.to_open3d().triangles), float(mesh.to_trimesh().area)
    (1, 2.0)
    """

    __repr__ = one_line
    vertices: FloatArray
    faces: IntArray
    units: str | None = None
    dropped: int = 0
    flat: IntArray = dataclasses.field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64), repr=False)
    regions: IntArray | None = dataclasses.field(default=None, repr=False)
    _repeated: int = dataclasses.field(default=0, repr=False, init=False)

    def __post_init__(self) -> None:
        vertices = as_vectors(self.vertices, "vertices", finite=False)
        faces = checked_faces(self.faces, len(vertices))
        solid, ends = solid_faces(vertices, faces)
        require_workable_ends(ends[0], ends[1], "vertices")
        if not solid.any():
            raise InputError(f"the mesh has {len(faces)} faces, none with an area; a target needs triangles")
        if self.regions is not None:
            object.__setattr__(self, "regions", checked_regions(self.regions, len(faces))[solid])
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", np.ascontiguousarray(faces[solid]))
        object.__setattr__(self, "flat", np.concatenate([self.flat, faces[~solid]]))
        object.__setattr__(self, "dropped", self.dropped + int(len(faces) - np.count_nonzero(solid)))
        if solid.all():
            remember(self, bounds=ends)
        left_out = repeated_faces(self._same_nodes, self.faces, self.flat)
        if left_out is not None:
            object.__setattr__(self, "faces", self.faces[~left_out])
            object.__setattr__(self, "regions", None if self.regions is None else self.regions[~left_out])
            object.__setattr__(self, "_repeated", int(np.count_nonzero(left_out)))

    def _shifted(self, offset: FloatArray) -> Mesh:
        """The mesh at another place, (3,), nearer to the origin: what was checked once holds there too."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        # Rounding keeps order, so that the ends of what is shifted are the ends shifted.
        known = {"bounds": self.bounds + offset, "_same_nodes": self._same_nodes}
        return made_of(Mesh, {**fields, "vertices": self.vertices + offset, **known})

    @cached_property
    def corners(self) -> FloatArray:
        """The three corner positions of each face, (f, 3, 3)."""
        return np.take(self.vertices, self.faces, axis=0)

    @property
    def face_normals(self) -> FloatArray:
        """Unit normal of each face, (f, 3), by the right-hand rule over its corners."""
        return self._face_columns[0]

    @property
    def face_areas(self) -> FloatArray:
        """Area of each face, (f,)."""
        return self._face_columns[1]

    @cached_property
    def _face_columns(self) -> tuple[FloatArray, FloatArray]:
        from dqreg.kernels.meshes.mesh_faces import face_columns
        from dqreg.kernels.threads import as_plain, over_chunks

        normals, areas = np.zeros((len(self.faces), 3)), np.zeros(len(self.faces))
        over_chunks(face_columns, len(areas), as_plain(self.vertices), self.faces, normals, areas, chunk=CHUNK_FACES)
        return normals, areas

    @cached_property
    def _shares_before(self) -> FloatArray:
        """Share of the area of all faces up to each, itself too, (f,)."""
        before: FloatArray = np.cumsum(self.face_areas / self.face_areas.sum())
        before /= before[-1]
        return before

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean, (3,), and covariance, (3, 3), of the surface: exact."""
        from dqreg.kernels.meshes.mesh_faces import MOMENTS, surface_moments
        from dqreg.kernels.threads import as_plain, over_chunks

        count, columns = len(self.faces), (as_plain(self.corners), self.face_areas, self.centre)
        sums = np.zeros((count // CHUNK_FACES + 1, MOMENTS))
        over_chunks(surface_moments, count, *columns, CHUNK_FACES, sums, chunk=CHUNK_FACES)
        total = sums.sum(axis=0)
        mean, second = total[1:4] / total[0], np.zeros((3, 3))
        second[np.triu_indices(3)] = total[4:] / total[0]
        second = np.triu(second) + np.triu(second, 1).T
        return self.centre + mean, second - np.outer(mean, mean)

    @cached_property
    def topology(self) -> Topology:
        """Which faces meet where, with vertices in one place taken as one."""
        return Topology.of(self.vertices, self.faces, self.flat)

    @property
    def face_neighbours(self) -> IntArray:
        """Face across each of the three sides (first to second corner, ...), (f, 3); itself where there is none."""
        return self.topology.neighbours

    @cached_property
    def is_closed(self) -> bool:
        """Whether every side of every face is shared: the mesh bounds a body, it is watertight."""
        return self._same_nodes.soundness(self.faces, self.flat).closed

    @cached_property
    def _same_nodes(self) -> SameNodes:
        return SameNodes.of(self.vertices, self.faces, self.flat)

    @cached_property
    def _fans(self) -> FaceFans:
        return FaceFans(self.faces, self._same_nodes, self.corners, self.face_normals)

    @cached_property
    def borders(self) -> MeshBoundary | None:
        """Where an open mesh ends; None for a closed one."""
        if self.is_closed:
            return None
        corners = np.concatenate([self.faces, self.flat])
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
        edges = ends[self.topology.free_sides]
        return MeshBoundary.of(self.vertices, edges, self.diagonal, float(self.face_areas.sum()))

    @property
    def is_consistently_wound(self) -> bool:
        """Whether faces that share a side run along it in opposite senses, as outward normals on all of them ask."""
        return self.topology.uneven_sides == 0

    @cached_property
    def body_volumes(self) -> FloatArray:
        """Signed volume of each connected body, (b,): negative where its faces are wound inward."""
        bodies = self.topology.bodies[: len(self.faces)]
        volumes = np.linalg.det(self.corners - self.centre) / 6.0
        return np.bincount(bodies, volumes, int(self.topology.bodies.max()) + 1).astype(np.float64)

    @property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, cubic length units; meaningful for a closed mesh only."""
        return float(self.body_volumes.sum())

    @cached_property
    def inward_bodies(self) -> tuple[int, int]:
        """How many of the outermost bodies are wound inward, and how many outermost bodies there are.

        A body whose bounding box lies inside that of another is taken for a cavity of it, which is wound inward
        rightly.
        """
        bodies, count = self.topology.bodies[: len(self.faces)], len(self.body_volumes)
        if bodies.min() == bodies.max():
            return int(self.body_volumes[bodies[0]] < 0.0), 1
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        np.minimum.at(low, bodies, self.corners.min(axis=1))
        np.maximum.at(high, bodies, self.corners.max(axis=1))
        order, outermost = np.argsort(-np.prod(np.maximum(high - low, 0.0), axis=1)), list[int]()
        for body in order[np.isfinite(low[order]).all(axis=1)]:
            within = (low[outermost] <= low[body]).all(axis=1) & (high[outermost] >= high[body]).all(axis=1)
            if not within.any():
                outermost.append(int(body))
        return int(np.count_nonzero(self.body_volumes[outermost] < 0.0)), len(outermost)

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with the mesh as the boundary of a body, in words; empty for a sound one."""
        found = []
        if self.topology.open_sides:
            found.append(f"{self.topology.open_sides} sides of faces are open: the mesh is not watertight")
        if self.topology.uneven_sides:
            found.append(f"{self.topology.uneven_sides} sides join faces that are wound against each other")
        inward, outermost = self.inward_bodies
        if not found and inward:
            found.append(f"{inward} of {outermost} bodies are wound inward")
        if self.dropped:
            found.append(f"{self.dropped} faces have no area")
        if self._repeated:
            found.append(f"{self._repeated} faces are there twice")
        return tuple(found)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the bounding box of the used vertices, (2, 3)."""
        return np.stack(bounds(self.corners.reshape(-1, 3)))

    @property
    def centre(self) -> FloatArray:
        """Middle of the bounding box, (3,)."""
        return np.asarray(self.bounds.mean(axis=0))

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal: the size S that relative lengths refer to."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    def to_open3d(self) -> Any:
        """The mesh as Open3D's (legacy) TriangleMesh.

        Returns
        -------
        open3d.geometry.TriangleMesh
            Without normals; call its ``compute_vertex_normals()`` to see it shaded.
        """
        return exports.mesh_to_open3d(self.vertices, self.faces)

    def to_trimesh(self) -> Any:
        """The mesh as trimesh's Trimesh, with its unit: nothing is merged or repaired.

        Returns
        -------
        trimesh.Trimesh
        """
        return exports.to_trimesh(self.vertices, self.faces, self.units)

    def to_pyvista(self) -> Any:
        """The mesh as PyVista's PolyData, a copy.

        Returns
        -------
        pyvista.PolyData

        Raises
        ------
        MissingDependencyError
            If PyVista is not installed.
        """
        return exports.to_pyvista(self.vertices, self.faces, {})
