"""One view of part and scan as an image, by ray casting: no window, no graphics card, no display."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Mesh
from dqreg.geometry.raycasting import RayScene
from dqreg.report.cameras import camera
from dqreg.report.colours import ByteArray, rgb

# Rays along one side of a pixel; the image is averaged down, so that edges come out smooth.
RAYS_PER_SIDE = 2
# The part fills that share of the smaller side of the image.
FILL_SHARE = 0.90
# A point this much (in sizes) behind the surface is still shown: it lies on it to the noise.
SINK_DIAGONALS = 0.006
EDGE_COLOUR = np.array([58.0, 64.0, 74.0], dtype=np.float32)
# Two from the eye's upper left and right, as in the interactive view: directions (right, up, to the eye) and strength.
LIGHTS = ((np.array([-0.35, 0.55, 0.75]), 0.5), (np.array([0.6, -0.1, 0.8]), 0.2))
AMBIENT_LIGHT = 0.34

FloatImage = NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class ViewFrame:
    """What a view shows, in sizes of the target about its middle."""

    axes: FloatArray  # (3, 3): Rows: right, up, towards the eye
    middle: FloatArray  # (2,): Right and up of the centre of the image
    pixel: float  # Size of a pixel
    # width, height: Pixels
    width: int
    height: int

    def finer(self) -> ViewFrame:
        """The same view with `RAYS_PER_SIDE` times the pixels along each side."""
        width, height = self.width * RAYS_PER_SIDE, self.height * RAYS_PER_SIDE
        return dataclasses.replace(self, pixel=self.pixel / RAYS_PER_SIDE, width=width, height=height)

    def columns_rows(self, points: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
        """Pixel column, pixel row and height towards the eye of points, (n, 3)."""
        seen = points @ self.axes.T
        columns = np.floor((seen[:, 0] - self.middle[0]) / self.pixel + 0.5 * self.width).astype(np.int64)
        rows = np.floor(0.5 * self.height - (seen[:, 1] - self.middle[1]) / self.pixel).astype(np.int64)
        return columns, rows, seen[:, 2]


def frame_of(points: FloatArray, angles: tuple[float, float], width: int, height: int) -> ViewFrame:
    """The frame that just holds some points."""
    axes = camera(*angles)
    flat = points @ axes[:2].T
    low, high = flat.min(axis=0), flat.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    pixel = float(max(extent[0] / (FILL_SHARE * width), extent[1] / (FILL_SHARE * height)))
    return ViewFrame(axes, 0.5 * (low + high), pixel, width, height)


@dataclasses.dataclass(frozen=True)
class Dots:
    """Points to be drawn."""

    points: FloatArray  # (n, 3): In sizes of the target, about its middle
    colours: ByteArray  # (n, 3): Of each, or of all
    radius: float  # In sizes of the target; at least a pixel is drawn


class PartScene:
    """The target, ready to be rendered from any side."""

    def __init__(self, geometry: Mesh | None, size: float) -> None:
        self._normals: FloatArray | None = None
        self._scene: RayScene | None = None
        if geometry is not None:
            self._normals = geometry.face_normals
            self._scene = RayScene(geometry.vertices, geometry.faces, np.zeros(3), size)

    def render(self, frame: ViewFrame, part_colour: str, paper: str, layers: list[Dots]) -> ByteArray:
        """Image of the part with points on it. Shapes: returns (height, width, 3)."""
        fine = frame.finer()
        image, surface, edges = self._shaded(fine, part_colour, paper)
        height = np.full_like(surface, -np.inf)
        for layer in layers:
            _draw(image, surface, height, fine, layer)
        # Points that lie on an edge hide it: it shines through them, but not through points in front of it.
        through = edges & (height > -np.inf) & (height < surface + SINK_DIAGONALS)
        image[through] = 0.6 * image[through] + 0.4 * EDGE_COLOUR
        averaged = image.reshape(frame.height, RAYS_PER_SIDE, frame.width, RAYS_PER_SIDE, 3).mean(axis=(1, 3))
        rounded: ByteArray = np.rint(averaged).astype(np.uint8)
        return rounded

    def in_sight(self, frame: ViewFrame, points: FloatArray, depth: float) -> BoolArray:
        """Points that are seen in a view, or lie no deeper than ``depth`` behind what is seen there. Shapes: (n, 3)."""
        columns, rows, up = frame.columns_rows(points)
        seen = (columns >= 0) & (columns < frame.width) & (rows >= 0) & (rows < frame.height)
        if self._scene is not None:
            height = _cast(self._scene, frame)[1]
            seen[seen] = up[seen] > height[rows[seen], columns[seen]] - depth
        return seen

    def _shaded(self, frame: ViewFrame, part_colour: str, paper: str) -> tuple[FloatImage, FloatImage, BoolArray]:
        """Image, height of the surface towards the eye (minus infinity where there is none), and its edges."""
        image = np.tile(np.array(rgb(paper), dtype=np.float32), (frame.height, frame.width, 1))
        height = np.full((frame.height, frame.width), -np.inf, dtype=np.float32)
        if self._scene is None or self._normals is None:
            return image, height, np.zeros(height.shape, dtype=bool)
        faces, height = _cast(self._scene, frame)
        normals = self._normals @ frame.axes.T
        normals = np.where(normals[:, 2:] < 0.0, -normals, normals)
        # One colour a face, looked up by every pixel.
        light = np.full(len(normals), AMBIENT_LIGHT)
        for direction, strength in LIGHTS:
            light += strength * np.maximum(normals @ (direction / np.linalg.norm(direction)), 0.0)
        shades = np.minimum(light[:, None] * 1.06, 1.0) * np.array(rgb(part_colour))
        hit = faces >= 0
        image[hit] = shades.astype(np.float32)[faces[hit]]
        edges = _edges(faces, normals, height, frame.pixel)
        image[edges] = 0.25 * image[edges] + 0.75 * EDGE_COLOUR
        return image, height, edges


def _cast(scene: RayScene, frame: ViewFrame) -> tuple[IntArray, FloatImage]:
    """Face that each pixel shows, -1 for none, and its height towards the eye."""
    right = (np.arange(frame.width) + 0.5 - 0.5 * frame.width) * frame.pixel + frame.middle[0]
    up = (0.5 * frame.height - np.arange(frame.height) - 0.5) * frame.pixel + frame.middle[1]
    rays = np.zeros((frame.height, frame.width, 6), dtype=np.float32)
    rays[..., :3] = (right[:, None] * frame.axes[0]).astype(np.float32)
    # From beyond everything: half a size above the middle is the highest that the target reaches.
    rays[..., :3] += (up[:, None] * frame.axes[1] + 2.0 * frame.axes[2]).astype(np.float32)[:, None]
    rays[..., 3:] = -frame.axes[2]
    faces, distance = scene.first_faces(rays)
    return faces, np.float32(2.0) - distance


def _edges(faces: NDArray[np.int64], normals: FloatArray, height: FloatImage, pixel: float) -> BoolArray:
    """Pixels at which the surface turns sharply, steps back or ends."""
    edges = np.zeros(faces.shape, dtype=bool)
    for here, beside in (
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
    ):
        # Only where another face begins can there be an edge.
        rows, columns = np.nonzero(faces[here] != faces[beside])
        a, b = faces[here][rows, columns], faces[beside][rows, columns]
        both = (a >= 0) & (b >= 0)
        turn = np.einsum("ij,ij->i", normals[a], normals[b]) < np.cos(np.deg2rad(25.0))
        # A steep face steps from pixel to pixel as well: only more than its own slope is an edge.
        slope = pixel / np.maximum(np.minimum(normals[a, 2], normals[b, 2]), 0.05)
        with np.errstate(invalid="ignore"):
            step = np.abs(height[here][rows, columns] - height[beside][rows, columns]) > 2.0 * slope + 0.004
        marked = ~both | turn | step
        # The pixel that is on the part, or the upper left one of two.
        edges[here][rows[marked & (a >= 0)], columns[marked & (a >= 0)]] = True
        edges[beside][rows[marked & (a < 0)], columns[marked & (a < 0)]] = True
    return edges


def _draw(image: FloatImage, surface: FloatImage, height: FloatImage, frame: ViewFrame, dots: Dots) -> None:
    """Draw discs into image and height, nearer ones over farther ones; those behind the surface are left out."""
    if not len(dots.points):
        return
    columns, rows, up = frame.columns_rows(dots.points)
    radius = max(dots.radius / frame.pixel, 0.75 * RAYS_PER_SIDE)
    reach = int(np.ceil(radius))
    inside = (columns >= -reach) & (columns < frame.width + reach) & (rows >= -reach) & (rows < frame.height + reach)
    order = np.flatnonzero(inside)
    order = order[np.argsort(up[order], kind="stable")]
    columns, rows, up = columns[order], rows[order], up[order].astype(np.float32)
    colours = np.broadcast_to(dots.colours, (len(dots.points), 3))[order]
    offsets = np.arange(-reach, reach + 1)
    for dx, dy in np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2):
        if dx * dx + dy * dy > radius * radius:
            continue
        x, y = columns + dx, rows + dy
        kept = (x >= 0) & (x < frame.width) & (y >= 0) & (y < frame.height)
        at = (y[kept], x[kept])
        kept[kept] = (up[kept] > surface[at] - SINK_DIAGONALS) & (up[kept] >= height[at])
        # Of several assignments to one pixel NumPy keeps the last: the highest.
        image[y[kept], x[kept]] = colours[kept]
        height[y[kept], x[kept]] = up[kept]
