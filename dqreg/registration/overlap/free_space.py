"""The scanner's lines of sight at the pose of a fit."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.morton import morton_order
from dqreg.geometry.rays import Rays
from dqreg.geometry.visibility import blocked
from dqreg.registration.fit.fit import Fit
from dqreg.registration.problem.derived_values import Key
from dqreg.registration.problem.problem import Problem
from dqreg.registration.problem.target_index import TargetIndex
from dqreg.rigid import pose
from dqreg.trust.free_space import Seen, can_look_through, hidden_share, looked_through
from dqreg.trust.rays import BothRays, Met

# Points of each side that are compared, and rays that are cast at a part.
COMPARED, RAYS = 6_000, 3_000
# Points of a cloud that make up its rays: of all of a spinning LiDAR's the next ring is as near as of these.
OF_RAYS = 15_000
# Ranges below this share of the largest are none.
NOTHING = 1e-6
# Distances between clouds below this many spacings of these are the gaps between their points.
GAPS = 4.0
# Rays begin so many standard deviations and that share of the size before their point, which lies on a surface.
SIGMAS, SHARE = 10.0, 0.005

MET: Key[Met] = Key()
# Of a problem.
SEEN: Key[tuple[Seen, Seen]] = Key()
BOTH_RAYS: Key[BothRays | None] = Key()
VIEWPOINT_BEHIND: Key[float] = Key()
# Of a target.
RAYS_OF_TARGET: Key[Rays | None] = Key()
SEEN_OF_TARGET: Key[Seen] = Key()


def looked_through_at(fit: Fit, *, by_rays: bool = False) -> tuple[float, float]:
    """Share of what was compared that the scanner looked through at the pose; NaN where its place is not known.

    And the share of all points that the rays of the other of two clouds met as far, where these are asked, as is known
    or as of few points; NaN else. Of many points they take a tenth of the time of a registration.
    """
    if not fit.found or fit.is_late:
        return np.nan, np.nan
    geometry = fit.target.geometry
    if isinstance(geometry, Mesh):
        return _through_mesh(fit, geometry), np.nan
    is_asked = by_rays or _asks_rays(fit)
    met = met_at(fit) if is_asked else None
    return (_between_clouds(fit, geometry), np.nan) if met is None else (float(met.through[0]), float(met.alike[0]))


def _between_clouds(fit: Fit, target: PointCloud) -> float:
    source, seen = fit.problem.derived.once(SEEN, lambda: _seen_both(fit.problem, target))
    return looked_through(source, seen, fit.T_target_source, GAPS)


def both_rays(problem: Problem) -> BothRays | None:
    """What the rays of two clouds met; None where their scanners' places are not known, or not amid what they show."""
    return problem.derived.once(BOTH_RAYS, lambda: _both_rays(problem))


def met_at(fit: Fit) -> Met | None:
    """What the rays of two clouds say at the pose of a fit; None likewise."""
    rays = both_rays(fit.problem) if fit.found and not fit.is_late else None
    return None if rays is None else fit.derived.once(MET, lambda: met_by(fit, rays, fit.T_target_source[None]))


def met_by(fit: Fit, rays: BothRays, poses: FloatArray) -> Met:
    """The same at some poses, (k, 4, 4)."""
    return rays.met(poses, fit.prepared.scan.noise, COMPARED)


def _both_rays(problem: Problem) -> BothRays | None:
    target = rays_of_target(problem.target)
    if target is None:
        return None
    source, viewpoint = problem.source, _viewpoint(problem)
    if problem.options.without_viewpoint:
        return None
    eye = source.centred(np.zeros((1, 3)))[0] if viewpoint is None else viewpoint
    found = Rays.of(_some(source.cloud.points, OF_RAYS), eye, is_known=viewpoint is not None)
    return None if found is None else BothRays(found, target)


def rays_of_target(index: TargetIndex) -> Rays | None:
    """The target's: the same for every scan that is registered to it."""
    geometry = index.geometry
    if not isinstance(geometry, PointCloud):
        return None

    def rays() -> Rays | None:
        place = geometry.viewpoint
        is_one = place is not None or _seen_target(index, geometry).one_place
        eye = -index.origin if place is None else place
        return Rays.of(_some(geometry.points, OF_RAYS), eye, is_known=place is not None) if is_one else None

    return index.derived.once(RAYS_OF_TARGET, rays)


def _asks_rays(fit: Fit) -> bool:
    """Whether rays are asked in any case: a search takes its pick, and of few points they cost little."""
    return fit.problem.start is None or not fit.prepared.cell_size


def begin_free_space(problem: Problem, target: PointCloud) -> None:
    """Make what `looked_through_at` asks of two clouds of many points, beside the caller."""
    problem.begin(SEEN, lambda: _seen_both(problem, target))


def _seen_both(problem: Problem, target: PointCloud) -> tuple[Seen, Seen]:
    origin = problem.source.centred(np.zeros((1, 3)))[0]
    source = _seen(problem.source.cloud.points, _viewpoint(problem), origin)
    if problem.options.without_viewpoint:
        source = dataclasses.replace(source, one_place=False)
    found = source, _seen_target(problem.target, target)
    _ = can_look_through(*found)
    return found


def _seen_target(index: TargetIndex, target: PointCloud) -> Seen:
    """What the target's scanner saw: the same for every scan that is registered to it."""
    return index.derived.once(SEEN_OF_TARGET, lambda: _seen(target.points, target.viewpoint, -index.origin))


def take_as_merged(index: TargetIndex) -> None:
    """Take a cloud for scans from several places: nobody looked through anything from its origin."""
    geometry = index.geometry
    if isinstance(geometry, PointCloud):
        seen = _seen(geometry.points, None, -index.origin)
        index.derived.put(SEEN_OF_TARGET, dataclasses.replace(seen, one_place=False))


def viewpoint_behind(problem: Problem) -> float:
    """Share of the scan's own points that stand behind others, seen from the one viewpoint that was given; else NaN."""
    places = problem.viewpoints
    if places is None or len(places) != 1:
        return np.nan
    source = problem.source
    return problem.derived.once(VIEWPOINT_BEHIND, lambda: hidden_share(source.cloud.points, source.centred(places)[0]))


def _through_mesh(fit: Fit, part: Mesh) -> float:
    """Share of the lines of sight that meet the part, and pass through it: of a scene, most meet what is around it."""
    eyes = _viewpoints(fit.problem)
    if eyes is None:
        return np.nan
    points = pose.apply(fit.T_target_source, _some(fit.prepared.scan.points, RAYS))
    margin = SIGMAS * fit.agreement.expected + SHARE * part.diagonal
    through = blocked(part, points, pose.apply(fit.T_target_source, eyes), margin)
    if not fit.is_scene:
        return float(np.mean(through))
    meet = through | (fit.prepared.surface.closest(points, within=margin).distances <= margin)
    return float(np.mean(through[meet])) if meet.any() else 0.0


def _viewpoints(problem: Problem) -> FloatArray | None:
    """Where the scanner stood, (k, 3), as the caller or the file says."""
    if problem.viewpoints is not None:
        return problem.source.centred(problem.viewpoints)
    place = problem.source.cloud.viewpoint
    return None if place is None else place[None]


def _viewpoint(problem: Problem) -> FloatArray | None:
    places = _viewpoints(problem)
    return None if places is None or len(places) > 1 else places[0]


def _seen(points: FloatArray, viewpoint: FloatArray | None, origin: FloatArray) -> Seen:
    # Rays that met nothing come as points at the origin.
    some = _some(points, COMPARED)
    # Neighbours asked for one after the other are soon found.
    some = np.take(some, morton_order(some), axis=0)
    arms = some - origin
    ranges = np.sqrt(np.einsum("ij,ij->i", arms, arms))
    is_any = ranges > NOTHING * ranges.max()
    # Where nothing is left out, as a rule, nothing is copied.
    return Seen(some if is_any.all() else some[is_any], viewpoint, origin)


def _some(points: FloatArray, count: int) -> FloatArray:
    if len(points) <= count:
        return points
    # One at random of each stretch: every tenth point of a scanner's own order may be on one of its lines.
    places = ((np.arange(count) + np.random.default_rng(0).random(count)) * (len(points) / count)).astype(np.int64)
    # They ascend; `np.unique` sorts them all the same, and takes ten times as long.
    return np.take(points, places[np.diff(places, prepend=-1) > 0], axis=0)
