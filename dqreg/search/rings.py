"""Rings: parts with equal moments across an axis, their steps by a tooth, and the half-turns that fit them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Mesh, Surface
from dqreg.geometry.sampling import places_on
from dqreg.rigid.rotations import about_axis
from dqreg.search.axes import moments, principal_axes
from dqreg.search.poses import Poses
from dqreg.search.scoring import distances_at, gains_of
from dqreg.search.symmetry import NEAR_SYMMETRY_DIAGONALS

# Smaller moment in the larger one of the two across the axis of a ring, at least.
EQUAL_MOMENTS = 0.9
# Half-turns across a ring that are tried, and those around each that fits.
HALF_TURNS, FINER_HALF_TURNS = 72, 7
# Teeth of a ring that are tried, and points that score a rotation by one.
TEETH, RING_POINTS = range(5, 41), 500
# Every so-manieth of these is asked first. Where they bring back less than half of what a step has to, no step fits: of
# 118 rings whose steps fit none brought back less than four times that. A half-turn that gains less by them is
# hopeless: of twelve rings with half-turns that stayed, none gained less than 0.69 at the best.
RING_SCREEN_STRIDE, MIN_HALF_TURN_GAIN = 5, 0.25
# A step of a ring fits where so much of what half a step moves out of place comes back into it: else it is the whole of
# a disc that fits, at any angle, and ICP itself rotates it. What breaks the ring stays out of place: of five bolts
# beside a block in the flange 0.28 to 0.4 come back, of orders that are none 0.13 at most. Orders that bring back less
# than so much of what the best one does are none beside it: three teeth and a tenth are no step.
MIN_RETURNED_SHARE, MIN_SHARE_OF_BEST = 0.2, 0.5
# Numbers of teeth that are kept, the best ones.
ORDERS_KEPT = 4


@dataclasses.dataclass(frozen=True)
class Ring:
    """A part with equal moments across one of its axes, in the frame of the principal axes."""

    axis: FloatArray  # (3,): Of the frame
    centre: FloatArray
    axes: FloatArray
    arms: FloatArray  # (m, 3): Points of it, seen from the centre
    surface: Surface

    @staticmethod
    def of(mesh: Mesh, surface: Surface) -> Ring | None:
        """The ring; None where no two moments, or all, are equal."""
        mean, covariance = moments(mesh)
        values = np.linalg.eigvalsh(covariance)
        low, high = (bool(values[k] > EQUAL_MOMENTS * values[k + 1]) for k in (0, 1))
        if low == high:
            return None
        centre, axes = principal_axes(mean, covariance)
        arms = (places_on(mesh, RING_POINTS, np.random.default_rng(0))[0] - centre) @ axes
        return Ring(np.eye(3)[0 if high else 2], centre, axes, arms, surface)

    def in_place(self, rotations: FloatArray, hopeful: Callable[[FloatArray], BoolArray]) -> FloatArray:
        """Mean gain of the points after each of some rotations, (k, 3, 3); by few where these leave no hope.

        Rotations near each other follow each other.
        """
        gains, first = np.zeros((len(rotations), len(self.arms))), np.arange(len(self.arms)) % RING_SCREEN_STRIDE == 0
        gains[:, first] = self._gains(rotations, first)
        means: FloatArray = gains[:, first].mean(axis=1)
        rows = np.flatnonzero(hopeful(means))
        if len(rows) and not first.all():
            gains[np.ix_(rows, ~first)] = self._gains(rotations[rows], ~first)
        means[rows] = gains[rows].mean(axis=1)
        return means

    def _gains(self, rotations: FloatArray, some: BoolArray) -> FloatArray:
        turns = Poses(np.asarray(self.axes @ rotations), np.tile(self.centre, (len(rotations), 1)))
        limit = NEAR_SYMMETRY_DIAGONALS * self.surface.diagonal
        # Each point is asked about under all of them in turn.
        apart = distances_at(turns, self.arms[some], self.surface, limit, by_point=True)
        return gains_of(apart, self.surface, NEAR_SYMMETRY_DIAGONALS)

    def brings_back(self) -> tuple[FloatArray, FloatArray]:
        """For each number of teeth, the gain after a step, and the share that comes back of what half a step lost.

        By few points where by these no step fits.
        """
        steps = 2.0 * np.pi / np.array(TEETH)
        # Half a step is one of twice as many teeth.
        angles, back = np.unique(np.concatenate([steps, 0.5 * steps]), return_inverse=True)

        def shares(gains: FloatArray) -> tuple[FloatArray, FloatArray]:
            whole, half = gains[back[: len(steps)]], gains[back[len(steps) :]]
            return whole, (whole - half) / np.maximum(1.0 - half, np.finfo(float).eps)

        def hopeful(gains: FloatArray) -> BoolArray:
            return np.full(len(gains), shares(gains)[1].max() >= 0.5 * MIN_RETURNED_SHARE)

        return shares(self.in_place(about_axis(self.axis, angles), hopeful))

    def flip_gains(self, flips: FloatArray) -> FloatArray:
        """Mean gain of the points after each of some rotations, (k, 3, 3), that are near each other in their order."""
        return self.in_place(flips, lambda gains: gains >= MIN_HALF_TURN_GAIN)


def ring_steps(ring: Ring | None) -> list[FloatArray]:
    """Rotations by one tooth of a ring whose teeth fit each other, either way, in the frame of the principal axes.

    About an axis with equal moments across it the rotations of the cube miss them: a ring of 24 teeth fits itself at
    every 15 degrees.
    """
    if ring is None:
        return []
    whole, back = ring.brings_back()
    # An order beside the right one fits as well, a little worse.
    beside = np.maximum(np.r_[0.0, whole[:-1]], np.r_[whole[1:], 0.0])
    back = np.where(whole > beside, back, 0.0)
    fits = np.flatnonzero(back > max(MIN_RETURNED_SHARE, MIN_SHARE_OF_BEST * float(back.max())))
    fits = fits[np.argsort(-whole[fits], kind="stable")][:ORDERS_KEPT]
    return [about_axis(ring.axis, sign * 2.0 * np.pi / TEETH[k]) for k in fits for sign in (1.0, -1.0)]


def ring_flips(ring: Ring | None) -> list[FloatArray]:
    """Half-turns of a ring about axes across its own that leave most of it in place: its moments name none of them."""
    if ring is None:
        return []
    across = np.roll(ring.axis, 1)

    def flips(angles: FloatArray) -> FloatArray:
        return about_axis(about_axis(ring.axis, angles) @ across, np.full(len(angles), np.pi))

    angles = np.arange(HALF_TURNS) * np.pi / HALF_TURNS
    gains = ring.flip_gains(flips(angles))
    tops = np.flatnonzero((gains >= np.roll(gains, 1)) & (gains > np.roll(gains, -1)) & (gains > gains.mean()))
    tops = tops[np.argsort(-gains[tops], kind="stable")][:ORDERS_KEPT]
    fine = flips((angles[tops, None] + np.linspace(-0.5, 0.5, FINER_HALF_TURNS) * np.pi / HALF_TURNS).ravel())
    best = ring.flip_gains(fine).reshape(-1, FINER_HALF_TURNS).argmax(axis=1)
    return list(fine.reshape(-1, FINER_HALF_TURNS, 3, 3)[np.arange(len(tops)), best])
