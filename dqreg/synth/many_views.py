"""Many virtual scans with known poses: a part on a turntable, the stops of a LiDAR in a room, a drive in a street."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.rigid import pose
from dqreg.synth.cameras import Scanner
from dqreg.synth.noise import Noise
from dqreg.synth.parts import box
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.scanner import scan_mesh
from dqreg.synth.street import HALF_LENGTH_M, street, swept, together, with_range_noise

# Elevations of the rings of the LiDAR of a room and of that of a car, rad; its columns, for each ring and at all.
ROOM_ELEVATIONS_RAD, CAR_ELEVATIONS_RAD = (-0.9, 0.7), (np.deg2rad(-24.8), np.deg2rad(2.0))
COLUMNS_PER_RING, CAR_COLUMNS = 12, 1_200
# A car's LiDAR stands so high, and sees no farther, m.
CAR_HEIGHT_M, CAR_REACH_M = 1.75, 80.0
# Longest way along a street, m: houses stand before and behind the car all the way.
MAX_DRIVE_M = 2.0 * HALF_LENGTH_M - CAR_REACH_M


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
    room = together(parts)
    scans, poses = [], []
    for k in range(stops):
        angle = 2.0 * np.pi * k / stops
        T = pose.exp(np.r_[0.05 * rng.normal(size=2), angle + 0.5 * rng.normal(), 0.0, 0.0, 0.0])
        T[:3, 3] = [1.8 * np.cos(angle), 1.2 * np.sin(angle), 0.4 + 0.1 * rng.normal()]
        azimuths = np.linspace(-np.pi, np.pi, COLUMNS_PER_RING * rings, endpoint=False)
        scans.append(with_range_noise(swept(room, T, np.linspace(*ROOM_ELEVATIONS_RAD, rings), azimuths), noise, rng))
        poses.append(T)
    return ManyViews(tuple(scans), np.stack(poses), np.zeros((stops, 3)))


def street_drive(
    frames: int = 40, *, step: float = 0.8, noise: float = 0.02, rings: int = 64, rng: np.random.Generator
) -> ManyViews:
    """The frames of a car's LiDAR that turns, on its way along a street, each in the sensor's frame; lengths in m.

    The car goes about a step a frame, sways and follows bends of its own; each frame is seen from one place. With 64
    rings a frame has about 70,000 points.
    """
    scene, azimuths = street(rng), np.linspace(0.0, 2.0 * np.pi, CAR_COLUMNS, endpoint=False)
    place, heading, bend, tilt = np.array([-0.5 * step * frames, rng.uniform(-2.0, 2.0)]), 0.0, 0.0, np.zeros(2)
    scans, poses = [], []
    for _ in range(frames):
        T = pose.exp(np.r_[0.0, 0.0, heading, 0.0, 0.0, 0.0]) @ pose.exp(np.r_[tilt, 0.0, 0.0, 0.0, 0.0])
        T[:3, 3] = [*place, CAR_HEIGHT_M + 0.02 * rng.normal()]
        turned = azimuths + rng.uniform(0.0, azimuths[1])
        seen = with_range_noise(swept(scene, T, np.linspace(*CAR_ELEVATIONS_RAD, rings), turned), noise, rng)
        scans.append(seen[np.linalg.norm(seen, axis=1) < CAR_REACH_M])
        poses.append(T)
        # Along the street and to its middle, as a driver keeps to a lane; springs bring roll and pitch back.
        bend = 0.8 * bend - 0.1 * heading - 0.01 * place[1] + np.deg2rad(0.5) * rng.normal()
        heading, tilt = heading + bend, 0.5 * tilt + np.deg2rad(0.15) * rng.normal(size=2)
        place = place + step * rng.uniform(0.9, 1.1) * np.array([np.cos(heading), np.sin(heading)])
    return ManyViews(tuple(scans), np.stack(poses), np.zeros((frames, 3)))
