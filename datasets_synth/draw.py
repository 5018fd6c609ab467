"""Draw cases: the part in grey, the scan on it, at the start pose (orange) and at the true pose (blue).

    python datasets_synth/draw.py                                      one sheet of all cases: datasets_synth/cases.png
    python datasets_synth/draw.py datasets_synth/bracket docs/images   start and end of one case, large

Needs matplotlib. The part is ray cast, so that the points behind it are hidden as they would be to the eye.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dqreg._open3d import load_open3d
from dqreg.files import read_cloud, read_mesh
from dqreg.rigid import pose
from dqreg.synth.cases import Case, load_case, write_case
from dqreg.synth.raycast import centre_and_diagonal, face_normals, first_hits, joined
from dqreg.synth.recipe import read_recipe

GREY, ORANGE, BLUE, EDGE = (np.array(c) / 255 for c in ((196, 199, 204), (240, 130, 20), (35, 120, 205), (90, 94, 100)))
LIGHT = np.array([0.45, -0.25, 0.85]) / np.linalg.norm([0.45, -0.25, 0.85])
VIEW = np.array([0.95, -0.85, 0.75])
HEIGHT, WIDTH, FINER = 720, 940, 3  # pixels of one panel, and how many times finer it is cast
SMALL = 264, 320  # of one panel on the sheet
COLUMNS = 4
HERE = Path(__file__).parent


class Camera:
    """Parallel projection that takes in the part and some air."""

    def __init__(
        self, centre: np.ndarray, diagonal: float, view=VIEW, up=(0.0, 0.0, 1.0), size=(HEIGHT, WIDTH)
    ) -> None:
        forward = -np.asarray(view) / np.linalg.norm(view)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, -np.cross(right, forward), forward])  # right, down, forward
        self.light = np.roll(LIGHT, int(np.argmax(np.abs(up))) - 2)  # the lamp hangs above
        self.centre, self.far = centre, 3.0 * diagonal
        self.shape = FINER * size[0], FINER * size[1]
        self.step = 0.92 * diagonal / self.shape[0]

    def rays(self) -> tuple[np.ndarray, np.ndarray]:
        """Origins and directions of all pixels, row by row from the top."""
        rows, columns = np.indices(self.shape).reshape(2, -1)
        right = (columns + 0.5 - self.shape[1] / 2) * self.step
        down = (rows + 0.5 - self.shape[0] / 2) * self.step
        origins = self.centre + np.column_stack([right, down, np.full(rows.size, -self.far)]) @ self.axes
        return origins, np.broadcast_to(self.axes[2], origins.shape)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and depths of points."""
        right, down, depth = self.axes @ (points - self.centre).T
        return down / self.step + self.shape[0] / 2, right / self.step + self.shape[1] / 2, depth + self.far


def draw_part(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Shaded image of the part on white, (rows, columns, 3), and its depth."""
    origins, directions = camera.rays()
    index, points = first_hits(vertices, faces, origins, directions)
    hit = (index >= 0).reshape(camera.shape)
    depth = np.where(hit, np.linalg.norm(points - origins, axis=1).reshape(camera.shape), np.inf)
    normals = face_normals(vertices, faces)[index].reshape(*camera.shape, 3)
    image = np.where(hit[..., None], GREY * shading(normals, camera.light)[..., None], 1.0)
    normals[~hit] = 0.0
    return np.where(_edges(normals, np.where(hit, depth, 9 * camera.far), camera)[..., None], EDGE, image), depth


def shading(normals: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Brightness of faces under a lamp."""
    return 0.62 + 0.42 * np.clip(normals @ light, 0.0, 1.0)


def estimate_normals(points: np.ndarray) -> np.ndarray:
    """Unit normals of a cloud, of either sign."""
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
    return np.asarray(cloud.normals).copy()


def _edges(normals: np.ndarray, depth: np.ndarray, camera: Camera) -> np.ndarray:
    """Whether a pixel lies at a sharp edge or a step of depth, with the pixels next to it."""
    edge = np.zeros(camera.shape, dtype=bool)
    for axis in (0, 1):
        for shift in (1, -1):
            step = np.roll(depth, shift, axis) - depth
            turn = (normals * np.roll(normals, shift, axis)).sum(axis=2) < 0.9
            on_part = (depth < 9 * camera.far) & (np.abs(step) < 12 * camera.step)
            edge |= (turn & on_part) | (step > 12 * camera.step)
    return edge


def draw_points(
    image: np.ndarray, depth: np.ndarray, points: np.ndarray, colour: np.ndarray, camera: Camera, dot: int = 4
) -> np.ndarray:
    """The image with the points that are not hidden, as dots."""
    rows, columns, distance = camera.project(points)
    i, j = rows.astype(int), columns.astype(int)
    inside = (i >= dot) & (j >= dot) & (i < camera.shape[0] - dot) & (j < camera.shape[1] - dot)
    i, j, distance = i[inside], j[inside], distance[inside]
    seen = distance < depth[i, j] + 4 * camera.step
    image = image.copy()
    order = np.argsort(-distance[seen])  # far points first
    i, j = i[seen][order], j[seen][order]
    normals = estimate_normals(points)[inside][seen][order]
    normals *= -np.sign(normals @ camera.axes[2])[:, None]
    tint = colour * shading(normals, camera.light)[:, None]
    for di, dj in np.ndindex(dot, dot):
        image[i + di - dot // 4, j + dj - dot // 4] = tint
    return image


def draw_case(case: Case, folder: Path) -> None:
    """Save three pictures: start, aligned, and both side by side."""
    mesh, points = read_mesh(case.part), read_cloud(case.scan).points
    vertices, faces = mesh.vertices, mesh.faces
    camera = Camera(*centre_and_diagonal(vertices))
    image, depth = draw_part(vertices, faces, camera)
    panels = {
        "start": draw_points(image, depth, pose.apply(case.T_start, points), ORANGE, camera),
        "aligned": draw_points(image, depth, pose.apply(case.T_target_source, points), BLUE, camera),
    }
    panels = {n: p.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean(axis=(1, 3)) for n, p in panels.items()}
    for name, titles in (("", ("start", "aligned")), ("_start", ("start",)), ("_aligned", ("aligned",))):
        save(folder / f"{case.folder.name}{name}.png", [(panels[t], t) for t in titles], case)


def save(path: Path, panels: list[tuple[np.ndarray, str]], case: Case) -> None:
    """Save panels side by side, with a caption and a scale bar."""
    truth, units = case.truth, case.units
    captions = {
        "start": f"scan at the start: {truth['start_angle_deg']:g}° and {truth['start_offset']:.1f} {units} off",
        "aligned": f"scan at its true pose: {truth['points']:,} points, noise {case.range_sigma:g} {units}",
    }
    figure = Figure(figsize=(len(panels) * WIDTH / 150, HEIGHT / 150 + 0.4), dpi=150)
    for k, (panel, name) in enumerate(panels):
        axes = figure.add_axes((k / len(panels), 0.0, 1 / len(panels), HEIGHT / (HEIGHT + 60)))
        axes.imshow(panel, interpolation="nearest")
        axes.set_axis_off()
        colour = ORANGE if name == "start" else BLUE
        axes.set_title(captions[name], color=0.85 * colour, fontsize=13, pad=6)
        length = 50.0 / (0.92 * case.part_diagonal / HEIGHT)
        axes.plot([30, 30 + length], [HEIGHT - 28] * 2, color=EDGE, linewidth=2, solid_capstyle="butt")
        axes.text(30 + length / 2, HEIGHT - 36, f"50 {case.units}", color=EDGE, ha="center", va="bottom", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def draw_small(case: Case) -> np.ndarray:
    """One panel of the sheet: part and surroundings, and the scan as it was read, at its true pose."""
    recipe = read_recipe(case.recipe)
    vertices, faces = recipe.mesh()
    surroundings = recipe.scene.surroundings(vertices, recipe.streams()[2])
    centre, diagonal = centre_and_diagonal(vertices)
    up = np.array(recipe.scene.up)
    view = np.array(case.truth["scanner"]["views"][0]) if recipe.scanner_kind != "tactile" else VIEW
    # A little off the scanner's own view, from where the scan's shadows are seen.
    view = view / np.linalg.norm(view) + 0.25 * np.cross(up, view) / np.linalg.norm(np.cross(up, view))
    wide = 1.0 if surroundings is None else 0.95 * recipe.scene.size
    camera = Camera(centre, 1.12 * wide * diagonal, view, up, SMALL)
    image, depth = draw_part(*joined((vertices, faces), surroundings), camera)
    points = pose.apply(case.T_target_source, read_cloud(case.scan).points)
    dot = int(np.clip(FINER * np.sqrt(25_000 / len(points)), 2, 7)) if len(points) > 99 else 12
    panel = draw_points(image, depth, points, BLUE, camera, dot)
    return panel.reshape(SMALL[0], FINER, SMALL[1], FINER, 3).mean(axis=(1, 3))


def draw_sheet(out: Path) -> None:
    """Make every case of this folder anew and draw all of them on one sheet."""
    recipes = [HERE / "bracket" / "recipe.toml", *sorted((HERE / "recipes").glob("*.toml"))]
    recipes += [r for r in sorted(HERE.glob("*/recipe.toml")) if r not in recipes]
    figure = Figure(figsize=(COLUMNS * SMALL[1] / 100, -(-len(recipes) // COLUMNS) * (SMALL[0] + 34) / 100), dpi=100)
    grid = figure.subplots(-(-len(recipes) // COLUMNS), COLUMNS).ravel()
    with tempfile.TemporaryDirectory() as folder:
        for axes, recipe in zip(grid, recipes, strict=False):
            case = write_case(Path(folder) / "case", recipe)
            axes.imshow(draw_small(case), interpolation="nearest")
            kind = case.truth["scanner"]["kind"].replace("_", " ")
            title = f"{case.truth['name']}\n{kind}, {case.truth['points']:,} points"
            axes.set_title(title, fontsize=9, color=EDGE, pad=3)
    for axes in grid:
        axes.set_axis_off()
    figure.subplots_adjust(0.0, 0.0, 1.0, 0.97, wspace=0.0, hspace=0.11)
    save_small(figure, out)


def save_small(figure: Figure, path: Path) -> None:
    """Save a PNG with a palette of 64 colours: a quarter of the size."""
    from PIL import Image

    raw = io.BytesIO()
    figure.savefig(raw)
    Image.open(raw).convert("RGB").quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        draw_case(load_case(sys.argv[1]), Path(sys.argv[2]))
    else:
        draw_sheet(HERE / "cases.png")
