"""Many virtual scans with known poses: a part on a turntable, and the stops of a scanner in a room."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from dqreg.synth.cameras import Scanner
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal, first_hits
from dqreg.synth.scanner import scan_mesh


@dataclasses.dataclass(frozen=True, eq=False)
class ManyViews:
    """Scans, each in a frame of its own, and where they belong."""

    scans: tuple[FloatArray, ...]  # (n, 3) each
    T_world_scan: FloatArray  # (k, 4, 4): Exact; the world is the part's, or the room's, frame
    viewpoints: FloatArray  # (k, 3): Where the scanner stood, each in its scan's frame


def turntable_views(
    part: Mesh,
    views: int = 24,
    *,
    pixels: int = 150,
    noise: float = 1e-4,
    elevation_deg: float = 35.0,
    rng: np.random.Generator,
) -> ManyViews:
    """A part on a turntable before one scanner that stands still, at equal steps all the way round.

    The part lies tilted and off the axis. The noise is in sizes of the part. All scans are in the scanner's frame, so
    that the motion from one to the next is one and the same rotation about one axis.
    """
    vertices, faces = np.asarray(part[0], dtype=np.float64), np.asarray(part[1])
    centre, diagonal = centre_and_diagonal(vertices)
    w = rng.normal(size=3)
    T_table_part = pose.exp(np.r_[w / np.linalg.norm(w) * rng.uniform(0.2, 1.0), 0.1 * diagonal * rng.normal(size=3)])
    T_table_part = T_table_part @ pose.from_parts(np.eye(3), -centre)
    T_scanner_table = pose.random(rng, reach=diagonal)
    scans, poses, stands = [], [], []
    for k in range(views):
        turn = pose.exp(np.r_[0.0, 0.0, 2.0 * np.pi * k / views, 0.0, 0.0, 0.0]) @ T_table_part
        elevation = np.deg2rad(elevation_deg)
        view = turn[:3, :3].T @ np.array([np.cos(elevation), 0.0, np.sin(elevation)])
        scanner = Scanner(views=(tuple(view.tolist()),), pixels=pixels)
        scan = scan_mesh(vertices, faces, scanner, Noise(range_sigma=noise * diagonal), rng=rng)
        scans.append(pose.apply(T_scanner_table @ turn, scan.points))
        poses.append(pose.inverse(T_scanner_table @ turn))
        stands.append(pose.apply(T_scanner_table @ turn, scan.sensor_positions)[0])
    return ManyViews(tuple(scans), np.stack(poses), np.stack(stands))


def room_stops(stops: int = 8, *, noise: float = 0.005, rings: int = 48, rng: np.random.Generator) -> ManyViews:
    """The stops of a LiDAR on its way round a furnished room of 8 by 6 by 3, each in the scanner's frame."""
    walls, inward = box((8.0, 6.0, 3.0))[0], box((8.0, 6.0, 3.0))[1][:, ::-1]
    parts = [(np.asarray(walls), np.asarray(inward))]
    for _ in range(10):
        size = rng.uniform(0.4, 1.5, 3)
        vertices, faces = box(tuple(size.tolist()))
        place = pose.exp(np.r_[0.0, 0.0, rng.uniform(0.0, np.pi), 0.0, 0.0, 0.0])
        place[:3, 3] = [*rng.uniform([-3.4, -2.4], [3.4, 2.4]), 0.5 * size[2] - 1.5]
        parts.append((pose.apply(place, vertices), np.asarray(faces)))
    room = _together(parts)
    scans, poses = [], []
    for k in range(stops):
        angle = 2.0 * np.pi * k / stops
        T = pose.exp(np.r_[0.05 * rng.normal(size=2), angle + 0.5 * rng.normal(), 0.0, 0.0, 0.0])
        T[:3, 3] = [1.8 * np.cos(angle), 1.2 * np.sin(angle), 0.4 + 0.1 * rng.normal()]
        scans.append(_swept(room, T, rings, noise, rng))
        poses.append(T)
    return ManyViews(tuple(scans), np.stack(poses), np.zeros((stops, 3)))


def _together(parts: list[Mesh]) -> Mesh:
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    faces = [np.asarray(each) + offset for (_, each), offset in zip(parts, offsets, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def _swept(room: Mesh, T: FloatArray, rings: int, noise: float, rng: np.random.Generator) -> FloatArray:
    """What one full turn of the scanner reads, in its own frame; the noise is along the rays, a length."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, 12 * rings, endpoint=False), np.linspace(-0.9, 0.7, rings)
    )
    flat = np.cos(elevation)
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    origins = np.tile(T[:3, 3], (len(rays), 1))
    face, points = first_hits(*room, origins, rays @ T[:3, :3].T)
    errors = noise * rng.normal(size=len(rays))
    seen: FloatArray = (pose.apply(pose.inverse(T), points) + errors[:, None] * rays)[face >= 0]
    return seen
