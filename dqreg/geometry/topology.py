"""Which triangles meet: sides and their neighbours, open seams, winding, connected bodies, smooth corners."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray, bounds
from dqreg.files.mesh_data import merge_identical, spacing_of_nodes

# Faces that meet at less than this are facets of one smooth surface; a chamfer of 30 degrees is an edge.
SMOOTH_DEG = 25.0
# Corner normals that differ from their face's by less are equal to it but for rounding.
NORMAL_ROUNDING = 1e-12
# Vertices and faces that one thread takes in one go, and faces around which it looks.
CHUNK_ROWS, CHUNK_FANS = 16_384, 1_024


class Soundness(NamedTuple):
    """What is known of a mesh without its edges."""

    closed: bool  # No edge has an odd number of triangles: `Topology.open_sides` is 0
    wound: bool  # As many triangles run along each edge in either sense
    two_sided: bool  # Each triangle is there in both senses


@dataclasses.dataclass(frozen=True)
class SameNodes:
    """Which vertices are one, by random numbers of the nodes that they round to, see `merge_identical`.

    Others are taken for one with a chance of one in 2^64. The little that most users of a mesh ask of its topology is
    found from them in a fraction of the time.
    """

    numbers: NDArray[np.uint64]  # (v,)

    @staticmethod
    def of(vertices: FloatArray, faces: IntArray, flat: IntArray) -> SameNodes:
        """Numbers of the vertices of triangles with an area and without."""
        from dqreg.kernels.meshes.side_parity import number_nodes
        from dqreg.kernels.threads import as_plain, over_chunks

        is_used = np.zeros(len(vertices), dtype=bool)
        is_used[faces] = is_used[flat] = True
        spacing = spacing_of_nodes(*bounds(vertices if is_used.all() else vertices[is_used]))
        numbers = np.zeros(len(vertices), dtype=np.uint64)
        over_chunks(number_nodes, len(vertices), as_plain(vertices), spacing, numbers, chunk=CHUNK_ROWS)
        return SameNodes(numbers)

    def soundness(self, faces: IntArray, flat: IntArray) -> Soundness:
        """What `Topology` says of all sides together."""
        from dqreg.kernels.meshes.side_parity import sums_of_sides
        from dqreg.kernels.threads import over_chunks

        every = np.concatenate([faces, flat]) if len(flat) else faces
        sums = np.zeros(((len(every) - 1) // CHUNK_ROWS + 1, 3), dtype=np.uint64)
        over_chunks(sums_of_sides, len(every), every, self.numbers, CHUNK_ROWS, sums, chunk=CHUNK_ROWS)
        odd, (_, uneven, single) = np.bitwise_xor.reduce(sums[:, 0]), sums.sum(axis=0)
        return Soundness(not odd, not uneven, not single)

    def corner_lists(self, faces: IntArray) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """First vertex at the place of each, (v,), and the corners there: see `list_corners`."""
        from dqreg.kernels.meshes.corner_lists import list_corners, weld

        count = len(self.numbers)
        welded, table = np.zeros(count, dtype=np.int32), np.zeros(1 << (2 * count).bit_length(), dtype=np.int32)
        weld(self.numbers, table, welded)
        heads, following = np.zeros((count, 2), dtype=np.int32), np.zeros(3 * len(faces), dtype=np.int32)
        heads[:, 0] = -1
        list_corners(faces, welded, heads, following)
        return welded, heads, following


@dataclasses.dataclass(frozen=True)
class Topology:
    """Faces over welded vertices.

    A side is numbered ``3 * face + k`` and runs from corner k to corner k + 1 of its face.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> both = Topology.of(square, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> both.open_sides, both.uneven_sides, (both.across // 3).tolist()
    (4, 0, [[0, 0, 1], [0, 1, 1]])
    """

    corners: IntArray  # (f, 3): Welded vertex of each corner; the faces with an area first, then those without
    edges: IntArray  # (f, 3): Edge of each side, whichever way the side runs
    forward: BoolArray  # (f, 3): Whether the side runs from the lower to the higher vertex
    real: BoolArray  # (f,): False for a face two of whose corners are one vertex: it joins nothing
    across: (
        IntArray  # (f, 3): Side met across each side; itself where there is none. Where more than two meet: some other
    )
    neighbours: (
        IntArray  # (n, 3): Face met across each side of a face with an area; itself where there is none of these
    )

    @staticmethod
    def of(vertices: FloatArray, faces: IntArray, flat: IntArray | None = None) -> Topology:
        """Topology of some triangles, those with an area, and those without."""
        from dqreg.kernels.meshes.mesh_sides import number_sides
        from dqreg.kernels.threads import aside

        every = faces if flat is None else np.concatenate([faces, flat])
        is_used = np.zeros(len(vertices), dtype=bool)
        is_used[every] = True
        _, welded = merge_identical(vertices[is_used])
        corners = welded[(np.cumsum(is_used) - 1)[every]]
        following = np.roll(corners, -1, axis=1)
        real = (corners != following).all(axis=1)
        edges, across, neighbours = np.zeros_like(corners), np.zeros_like(corners), np.zeros_like(faces)
        aside(number_sides, corners, int(welded.max()) + 1, real, edges, across, neighbours)
        return Topology(corners, edges, corners < following, real, across, neighbours)

    @cached_property
    def open_sides(self) -> int:
        """Edges at which an odd number of faces meet: one face is a rim, three are a wall on a surface."""
        return int(np.count_nonzero(self._uses(np.ones_like(self.forward)) % 2))

    @cached_property
    def free_sides(self) -> IntArray:
        """Numbers of the sides that one face alone has, ascending: where the surface ends."""
        alone = self._uses(np.ones_like(self.forward)) == 1
        return np.flatnonzero(alone[self.edges].ravel() & np.repeat(self.real, 3))

    @cached_property
    def uneven_sides(self) -> int:
        """Edges at which an even number of faces meet, but not half of them in each sense."""
        uses, ahead = self._uses(np.ones_like(self.forward)), self._uses(self.forward)
        return int(np.count_nonzero((uses % 2 == 0) & (2 * ahead != uses)))

    def _uses(self, chosen: BoolArray) -> IntArray:
        sides = self.edges[self.real][chosen[self.real]]
        return np.bincount(sides, minlength=int(self.edges.max()) + 1)

    @cached_property
    def bodies(self) -> IntArray:
        """Number of the connected body of each face, (f,): faces that share an edge belong together."""
        from dqreg.kernels.clouds.components import components

        count = len(self.corners)
        rows = np.repeat(np.arange(count), 3)
        size = count + int(self.edges.max()) + 1
        bodies: IntArray = components(size, rows, count + self.edges.ravel().astype(np.int64))[:count]
        return bodies


class FaceFans:
    """Neighbours of those faces of a mesh that are asked for, and smooth normals of their corners; they are kept."""

    # What is found depends on the mesh alone, so that threads that meet here write the same.
    neighbours: IntArray  # (f, 3): Face across each side, see `Mesh.face_neighbours`; of faces that were asked for
    turns: FloatArray  # (f, 3): Cosine between the normals of a face and of the one across each side; 2 for none
    # (f, 3, 3): In each corner the mean of the normals of the faces that a chain of smooth sides at that corner joins,
    # weighted by the corner's angle (Thuermer and Wuethrich 1998); of round faces
    corner_normals: FloatArray
    is_round: BoolArray  # (f,): Whether one of them differs from the face's own normal

    def __init__(self, faces: IntArray, same: SameNodes, corners: FloatArray, face_normals: FloatArray) -> None:
        self._given = faces, *same.corner_lists(faces), corners, face_normals
        count = len(faces)
        self._known = np.zeros(count, dtype=bool)
        # Memory that nobody writes to is not taken.
        self.neighbours = np.zeros((count, 3), dtype=np.int64)
        self.turns = np.zeros((count, 3))
        self.corner_normals, self.is_round = np.zeros((count, 3, 3)), np.zeros(count, dtype=bool)

    def find(self, faces: IntArray) -> FaceFans:
        """Itself, with what is around some faces, (n,); a negative number is none."""
        if not np.take(self._known, faces).all():
            asked = np.zeros(len(self._known) + 1, dtype=bool)
            # The last is none.
            asked[faces] = True
            self._find(np.flatnonzero(asked[:-1] & ~self._known))
        return self

    def _find(self, faces: IntArray) -> None:
        from dqreg.kernels.meshes.face_fans import neighbours_of_faces, normals_of_corners
        from dqreg.kernels.threads import over_chunks

        every, welded, heads, following, corners, face_normals = self._given
        # What lies at a vertex is the same for all faces there.
        met = np.zeros(len(welded), dtype=bool)
        met[welded[every[faces]]] = True
        lists, vertices, least = (every, welded, heads, following), np.flatnonzero(met), np.cos(np.deg2rad(SMOOTH_DEG))
        limits = float(least), NORMAL_ROUNDING
        over_chunks(
            normals_of_corners, len(vertices), vertices, *lists, corners, face_normals, *limits, self.corner_normals,
            chunk=CHUNK_FANS,
        )  # fmt: skip
        known = NORMAL_ROUNDING, self.neighbours, self.corner_normals, self.is_round
        over_chunks(neighbours_of_faces, len(faces), faces, *lists, face_normals, *known, chunk=CHUNK_FANS)
        across = self.neighbours[faces]
        x, y, z = (column[faces][:, None] * column[across] for column in face_normals.T)
        self.turns[faces] = np.where(across == faces[:, None], 2.0, x + y + z)
        self._known[faces] = True
