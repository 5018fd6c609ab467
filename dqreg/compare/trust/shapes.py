"""Random parts: every dimension is drawn, so that no limit of the verdict can be fitted to a part."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.synth import parts
from dqreg.synth.parts.blocks import cells
from dqreg.synth.parts.patches import weld

# Draws of dimensions that do not fit each other before a part is given up.
MAX_DRAWS = 100

Family = Callable[[np.random.Generator], Mesh]


def bracket(rng: np.random.Generator) -> Mesh:
    """L-bracket with holes and a boss."""
    length, width, height = rng.uniform(60, 180), rng.uniform(40, 120), rng.uniform(40, 120)
    hole, boss = rng.uniform(0.08, 0.2) * width, rng.uniform(0.3, 0.45) * min(width, height)
    return Mesh(
        *parts.bracket(
            length=length,
            width=width,
            height=height,
            base_thickness=rng.uniform(4, 14),
            wall_thickness=rng.uniform(4, 16),
            fillet_radius=rng.uniform(3, 12),
            large_hole=1.6 * hole,
            small_hole=hole,
            boss_diameter=boss,
            boss_height=rng.uniform(4, 20),
            bore_diameter=0.5 * boss,
            boss_position=rng.uniform(0.35, 0.65),
            segments=24,
        )
    )


def blade(rng: np.random.Generator) -> Mesh:
    """Twisted blade on a platform."""
    chord = rng.uniform(25, 60)
    return Mesh(
        *parts.blade(
            chord=chord,
            height=rng.uniform(50, 140),
            thickness=rng.uniform(0.1, 0.25),
            camber=rng.uniform(0.03, 0.15),
            taper=rng.uniform(0.4, 0.9),
            twist_rad=rng.uniform(0.2, 0.9),
            platform_length=chord * rng.uniform(1.2, 1.7),
            platform_width=chord * rng.uniform(0.8, 1.1),
            platform_height=rng.uniform(6, 20),
        )
    )


def angle(rng: np.random.Generator) -> Mesh:
    """Sheet-metal angle."""
    # In 64ths: sums of them are exact, and the patches of the mesh meet to the last bit.
    length, height, width = np.round(rng.uniform([60, 30, 40], [130, 90, 100]) * 64) / 64
    thickness, bend = np.round(rng.uniform([1.0, 2.0], [4.0, 8.0]) * 64) / 64
    return Mesh(
        *parts.angle(
            length=length,
            height=height,
            width=width,
            thickness=thickness,
            bend_radius=bend,
            large_hole=0.22 * width,
            small_hole=0.12 * width,
        )
    )


def feeder(rng: np.random.Generator) -> Mesh:
    """Two stacked prisms, stretched at random along each axis."""
    vertices, faces = parts.feeder()
    return Mesh(vertices * rng.uniform(0.4, 1.3, 3), faces)


def steps(rng: np.random.Generator) -> Mesh:
    """Blocks of random heights side by side, like a town."""
    columns, rows = (int(n) for n in rng.integers(2, 5, 2))
    return relief(
        np.cumsum(rng.uniform(8, 40, columns + 1)),
        np.cumsum(rng.uniform(8, 40, rows + 1)),
        rng.uniform(6, 60, (columns, rows)),
    )


def lump(rng: np.random.Generator) -> Mesh:
    """Free-form body: a stretched sphere with waves."""
    rows, columns = 40, 80
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, rows + 1)[1:-1], np.arange(columns) * 2 * np.pi / columns)
    ring = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    directions = np.concatenate([ring.transpose(1, 0, 2).reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    radius = np.ones(len(directions))
    for _ in range(8):
        wave = rng.normal(size=3)
        radius += rng.uniform(0.05, 0.16) * np.sin(rng.uniform(1.5, 4.0) * directions @ wave + rng.uniform(0, 6.28))
    top, bottom = len(directions) - 2, len(directions) - 1
    index = np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    along = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], index[1:], along[1:], along[:-1]
    faces = [
        np.stack([a, b, c], axis=-1).reshape(-1, 3),
        np.stack([a, c, d], axis=-1).reshape(-1, 3),
        np.stack([np.full(columns, top), index[0], along[0]], axis=-1),
        np.stack([index[-1], np.full(columns, bottom), along[-1]], axis=-1),
    ]
    scale = rng.uniform(15, 60) * rng.uniform(0.6, 1.4, 3)
    return Mesh(directions * np.maximum(radius, 0.3)[:, None] * scale, np.concatenate(faces))


def relief(x: FloatArray, y: FloatArray, heights: FloatArray) -> Mesh:
    """Closed mesh of blocks over the cells of a grid. Shapes: x (i + 1,), y (j + 1,), heights (i, j)."""
    levels = np.concatenate([[0.0], np.unique(heights)])
    filled = 0.5 * (levels[1:] + levels[:-1]) < heights[..., None]
    return Mesh(*weld(cells([np.asarray(x), np.asarray(y), levels], filled)))


def plate(rng: np.random.Generator) -> Mesh:
    """Flat plate with one larger hole."""
    size = np.array([rng.uniform(60, 160), rng.uniform(40, 100), rng.uniform(2, 8)])
    hole = rng.uniform(0.1, 0.2) * size[1]
    return Mesh(*parts.plate(tuple(size), large_hole=rng.uniform(1.3, 1.9) * hole, small_hole=hole, segments=24))


def flange(rng: np.random.Generator) -> Mesh:
    """Flange with a ring of equal bolt holes."""
    diameter = rng.uniform(80, 200)
    return Mesh(
        *parts.flange(
            diameter=diameter,
            thickness=rng.uniform(6, 20),
            hub_diameter=0.45 * diameter,
            hub_height=rng.uniform(8, 40),
            bore_diameter=0.3 * diameter,
            bolt_circle=0.76 * diameter,
            bolt_diameter=rng.uniform(0.06, 0.1) * diameter,
            bolts=int(rng.integers(4, 10)),
        )
    )


def box(rng: np.random.Generator) -> Mesh:
    """Rectangular block with three different edges."""
    return Mesh(*parts.box(tuple(np.cumsum(rng.uniform(15, 50, 3)))))


ASYMMETRIC: tuple[Family, ...] = (bracket, blade, angle, feeder, steps, lump)


def any_part(rng: np.random.Generator) -> Mesh:
    """A part of a random family without a symmetry."""
    return draw(ASYMMETRIC[rng.integers(len(ASYMMETRIC))], rng)


def draw(family: Family, rng: np.random.Generator) -> Mesh:
    """A part of a family: dimensions that do not fit each other are drawn again."""
    for _ in range(MAX_DRAWS):
        try:
            return family(rng)
        except InputError as error:
            refused = error
    raise refused


def joined(*meshes: Mesh) -> Mesh:
    """Meshes in one, each closed by itself."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]),
    )


def finer(mesh: Mesh) -> Mesh:
    """Faces cut into small ones, so that a bent body is bent everywhere."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) < 3000:
        corners = vertices[faces]
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        a, b, c = np.moveaxis(corners, 1, 0)
        d, e, f = np.moveaxis(middles, 1, 0)
        soup = np.concatenate([np.stack(rows, axis=1) for rows in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))])
        vertices, faces = soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3)
    return Mesh(vertices, faces)
