"""Section 5 of Jia's notes, last paragraph: registration by closest points (ICP), iteration by iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import CloudSurface, PointCloud, Scan, Surface, prepare_scan
from dqreg.icp import Correspondences, Icp, Stopping, points_and_normals, points_only
from dqreg.icp.estimators import Estimator
from dqreg.papers.document import Curve, Figure, Panel, Section, floats
from dqreg.report.table import Column, Table, short_number
from dqreg.rigid import pose, quaternion
from dqreg.solvers import Fit, horn

NOISE_SHARE = 1e-3
# An error of this is the noise's, far below the start's.
ARRIVED_SHARE = 5.0 * NOISE_SHARE
START_DEG, START_SHARE = 10.0, 0.05
SHOWN_ITERATIONS = (1, 2, 3, 5, 10, 20, 30, 50, 100)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """One run of ICP."""

    name: str  # What was solved in each iteration
    status: str  # How the run ended
    # errors, rms: After each iteration: root mean square distance of the points from where the truth puts them, and of
    # the pairs; both over the size
    errors: tuple[float, ...]
    rms: tuple[float, ...]


def measure_convergence(
    rng: np.random.Generator, source_points: int = 2_000, target_points: int = 20_000
) -> tuple[Path, ...]:
    """Run ICP on two clouds of one surface in three ways."""
    target = surface_cloud(rng, target_points)
    chosen = target[rng.choice(target_points, source_points, replace=False)]
    size = float(np.linalg.norm(np.ptp(target, axis=0)))
    T_truth = pose.random(rng, reach=1.0)
    noisy = chosen + rng.normal(scale=NOISE_SHARE * size, size=chosen.shape)
    scan = prepare_scan(PointCloud(pose.apply(pose.inverse(T_truth), noisy)))
    turn = quaternion.to_matrix(quaternion.from_axis_angle([1.0, 2.0, 2.0], np.deg2rad(START_DEG)))
    away = pose.from_parts(turn, START_SHARE * size * np.array([2.0, -1.0, 2.0]) / 3.0)
    start = pose.about(away, target.mean(axis=0)) @ T_truth
    surface = CloudSurface(PointCloud(target))
    return (
        _follow("plain (the notes)", _notes_estimator, False, scan, surface, (start, T_truth)),
        _follow("extrapolated", points_only, True, scan, surface, (start, T_truth)),
        _follow("with normals", points_and_normals, True, scan, surface, (start, T_truth)),
    )


def surface_cloud(rng: np.random.Generator, count: int) -> FloatArray:
    """Points on a bumpy sheet without symmetry, of size 1.

    Shapes: returns (count, 3).

    >>> surface_cloud(np.random.default_rng(0), 5).shape
    (5, 3)
    """
    x, y = rng.uniform(0.0, 0.7, size=(2, count))
    z = 0.08 * np.sin(9.0 * x) + 0.06 * np.cos(11.0 * y + 2.0 * x) + 0.1 * x * y
    return np.column_stack([x, y, z])


def _notes_estimator(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
    kept = weights > 0.0
    return horn(pairs.scan.points[kept], pairs.closest.points[kept])


def _follow(
    name: str,
    estimator: Estimator,
    accelerate: bool,
    scan: Scan,
    surface: Surface,
    poses: tuple[FloatArray, FloatArray],
) -> Path:
    start, T_truth = poses
    exact = pose.apply(T_truth, scan.points)
    errors: list[float] = []

    def solve_and_compare(pairs: Correspondences, weights: FloatArray, noise: float) -> Fit:
        fit = estimator(pairs, weights, noise)
        away = pose.apply(fit.T_target_source, scan.points) - exact
        errors.append(float(np.sqrt(np.mean(np.sum(away**2, axis=1)))) / surface.diagonal)
        return fit

    icp = Icp(estimator=solve_and_compare, accelerate=accelerate, stopping=Stopping(convergence=1e-6, iterations=150))
    run = icp.run(scan, surface, start)
    rms = floats(record.rms / surface.diagonal for record in run.history)
    return Path(name, run.status, tuple(errors), rms)


def convergence_section(paths: tuple[Path, ...]) -> Section:
    """Words, table and figure of the measurement."""
    plain, points, normals = paths
    return Section(
        "icp",
        "Section 5: ICP, where the correspondences are unknown",
        _finding(plain, (points, normals)),
        (
            f"The target is a bumpy sheet of size 1; the source holds some of its points with noise {NOISE_SHARE:g} of "
            f"the size on each coordinate, and starts {START_DEG:g} degrees and {100 * START_SHARE:g} % of the size "
            "off. A run stops where a plain step moves the points by less than 1e-6 of the size. Plain: Horn on the "
            "correspondences, as in the notes. Extrapolated: "
            "the same cost with Anderson acceleration. With normals: the closed form of "
            "1991 on points and on normals fitted to the same clouds, extrapolated as well.",
        ),
        (_table(paths),),
        (_figure(paths),),
    )


def _finding(plain: Path, others: tuple[Path, Path]) -> str:
    words = [f"The notes' ICP {_ended(plain)}"]
    for name, path in zip(("with extrapolated steps it", "with normals it"), others, strict=True):
        more = len(path.errors) - len(plain.errors)
        words.append(f"{name} {_ended(path)}, {'fewer' if more < 0 else 'more' if more else 'as many'}")
    return "; ".join(words) + "."


def _ended(path: Path) -> str:
    arrived = path.errors[-1] <= ARRIVED_SHARE
    near = f"{short_number(path.errors[-1], '.1e')} of the size"
    how = f"ends within {near} of the truth" if arrived else f"stops {near} away from the truth"
    return f"{how} after {len(path.errors)} iterations ({path.status})"


def _table(paths: tuple[Path, ...]) -> Table:
    longest = max(len(path.errors) for path in paths)
    numbers = sorted({n for n in SHOWN_ITERATIONS if n < longest} | {len(path.errors) for path in paths})
    columns = [Column("iteration"), *(Column(f"error: {path.name}") for path in paths)]
    return Table(
        "icp",
        "ICP: distance of the points from their true places, root mean square over the size",
        (*columns, *(Column(f"rms of correspondences: {path.name}") for path in paths)),
        tuple((n, *(_at(path.errors, n) for path in paths), *(_at(path.rms, n) for path in paths)) for n in numbers),
        "Empty: the run had ended. The rms of the correspondences is that of the pose before the step.",
    )


def _at(values: tuple[float, ...], number: int) -> float | None:
    return values[number - 1] if number <= len(values) else None


def _figure(paths: tuple[Path, ...]) -> Figure:
    curves = tuple(
        Curve(
            path.name,
            floats(range(1, len(path.errors) + 1)),
            path.errors,
            (),
            colour,
            ("--", "-", "-")[colour],
            "osD"[colour],
        )
        for colour, path in enumerate(paths)
    )
    panel = Panel("iteration", "rms distance from the truth / size", curves, log_y=True)
    return Figure("icp", "Convergence of ICP", (panel,), "Each curve ends where its run stopped.")
