"""Draw a case: the part in grey, the scan on it, at the start pose (orange) and at the true pose (blue).

    python datasets_synth/draw.py datasets_synth/bracket docs/images

Needs matplotlib. The part is ray cast, so that the points behind it are hidden as they would be to the eye.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.figure import Figure

from dqreg.open3d_gate import load_open3d
from dqreg.rigid import pose
from dqreg.synth.cases import Case, load_case
from dqreg.synth.raycast import centre_and_diagonal, face_normals, first_hits

GREY, ORANGE, BLUE, EDGE = (np.array(c) / 255 for c in ((196, 199, 204), (240, 130, 20), (35, 120, 205), (90, 94, 100)))
LIGHT = np.array([0.45, -0.25, 0.85]) / np.linalg.norm([0.45, -0.25, 0.85])
VIEW = np.array([0.95, -0.85, 0.75])
HEIGHT, WIDTH, FINER = 720, 940, 3  # pixels of one panel, and how many times finer it is cast


class Camera:
    """Parallel projection that takes in the part and some air."""

    def __init__(self, centre: np.ndarray, diagonal: float) -> None:
        forward = -VIEW / np.linalg.norm(VIEW)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, -np.cross(right, forward), forward])  # right, down, forward
        self.centre, self.far = centre, 3.0 * diagonal
        self.shape = FINER * HEIGHT, FINER * WIDTH
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
    image = np.where(hit[..., None], GREY * shading(normals)[..., None], 1.0)
    normals[~hit] = 0.0
    return np.where(_edges(normals, np.where(hit, depth, 9 * camera.far), camera)[..., None], EDGE, image), depth


def shading(normals: np.ndarray) -> np.ndarray:
    """Brightness of faces under a lamp."""
    return 0.62 + 0.42 * np.clip(normals @ LIGHT, 0.0, 1.0)


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
    image: np.ndarray, depth: np.ndarray, points: np.ndarray, colour: np.ndarray, camera: Camera
) -> np.ndarray:
    """The image with the points that are not hidden, as dots."""
    rows, columns, distance = camera.project(points)
    i, j = rows.astype(int), columns.astype(int)
    inside = (i > 1) & (j > 1) & (i < camera.shape[0] - 3) & (j < camera.shape[1] - 3)
    i, j, distance = i[inside], j[inside], distance[inside]
    seen = distance < depth[i, j] + 4 * camera.step
    image = image.copy()
    order = np.argsort(-distance[seen])  # far points first
    i, j = i[seen][order], j[seen][order]
    normals = estimate_normals(points)[inside][seen][order]
    normals *= -np.sign(normals @ camera.axes[2])[:, None]
    tint = colour * shading(normals)[:, None]
    for di, dj in np.ndindex(4, 4):
        image[i + di - 1, j + dj - 1] = tint
    return image


def draw_case(case: Case, folder: Path) -> None:
    """Save three pictures: start, aligned, and both side by side."""
    mesh = trimesh.load_mesh(case.part)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    points = np.asarray(trimesh.load(case.scan).vertices)
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


if __name__ == "__main__":
    draw_case(load_case(sys.argv[1]), Path(sys.argv[2]))
