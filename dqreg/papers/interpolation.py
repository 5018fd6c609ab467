"""Appendix C of Jia's notes: constant rates of axis and angle (eq. 33) against slerp (eq. 34)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.papers.document import Curve, Figure, Panel, Section, floats
from dqreg.report.table import Column, Table
from dqreg.rigid import quaternion

FIRST_TURN = ((1.0, 0.0, 0.2), 40.0)
LAST_TURN = ((0.0, 1.0, 1.0), 160.0)
# Speeds that differ by less than this are one: what the differences leave.
EVEN_SHARE = 0.01
NAMES = ("eq. 33, constant rates", "eq. 34, slerp")


@dataclass(frozen=True, slots=True, eq=False)
class Between:
    """One way from the first rotation to the last."""

    name: str  # Which way
    fraction: FloatArray  # (n,): tau, 0 to 1
    angle_deg: FloatArray  # (n,): Angle of the rotation at tau
    axis: FloatArray  # (n, 3): Its axis
    speed_deg: FloatArray  # (n,): Angular speed, degrees per unit of tau

    @property
    def swept_deg(self) -> float:
        """Angle swept from first to last."""
        middle = 0.5 * (self.speed_deg[1:] + self.speed_deg[:-1])
        return float(middle @ np.diff(self.fraction))


def measure_interpolation(steps: int = 400) -> tuple[Between, Between]:
    """Follow both formulas from 40 degrees about one axis to 160 degrees about another."""
    r1, r2 = (quaternion.from_axis_angle(axis, np.deg2rad(angle)) for axis, angle in (FIRST_TURN, LAST_TURN))
    tau = np.linspace(0.0, 1.0, steps + 1)
    paths = (quaternion.interpolate_axis_angle(r1, r2, tau), quaternion.slerp(r1, r2, tau, shorter_turn=False))
    return _between(NAMES[0], tau, paths[0]), _between(NAMES[1], tau, paths[1])


def _between(name: str, tau: FloatArray, path: FloatArray) -> Between:
    axis, angle = quaternion.to_axis_angle(path)
    slope = np.gradient(path, tau, axis=0, edge_order=2)
    rate = quaternion.angular_velocity(path, slope)  # eq. 27
    return Between(name, tau, np.rad2deg(angle), axis, np.rad2deg(np.linalg.norm(rate, axis=1)))


def interpolation_section(paths: tuple[Between, Between]) -> Section:
    """Words, table and figures of both ways."""
    rates, slerp = paths
    table = Table(
        "interpolation",
        "The two ways from the first rotation to the last",
        (
            Column("formula"),
            Column("angle swept", "deg", ".2f"),
            Column("least speed", "deg", ".2f"),
            Column("greatest speed", "deg", ".2f"),
            Column("angle halfway", "deg", ".2f"),
        ),
        tuple(
            (
                path.name,
                path.swept_deg,
                float(path.speed_deg.min()),
                float(path.speed_deg.max()),
                float(np.interp(0.5, path.fraction, path.angle_deg)),
            )
            for path in paths
        ),
        "Speed: of the body, per unit of tau.",
    )
    return Section(
        "interpolation",
        "Appendix C: interpolation",
        _finding(rates, slerp),
        (
            f"From {FIRST_TURN[1]:g} degrees about {FIRST_TURN[0]} to {LAST_TURN[1]:g} degrees about {LAST_TURN[0]}; "
            "tau runs from 0 to 1.",
        ),
        (table,),
        (_figure(paths),),
    )


def _finding(rates: Between, slerp: Between) -> str:
    words = []
    for name, path in (("Equation 33", rates), ("Slerp", slerp)):
        low, high = path.speed_deg.min(), path.speed_deg.max()
        how = "turns the body evenly" if high - low <= EVEN_SHARE * high else "does not turn the body evenly"
        words.append(
            f"{name} {how}: its speed runs from {low:.0f} to {high:.0f} degrees per unit of tau, and it sweeps "
            f"{path.swept_deg:.1f} degrees"
        )
    least = "the less of the two" if slerp.swept_deg < rates.swept_deg else "no less than equation 33"
    return f"{words[0]}. {words[1]}, {least}."


def _figure(paths: tuple[Between, Between]) -> Figure:
    angle, speed, axis = [], [], []
    for colour, (path, line) in enumerate(zip(paths, ("--", "-"), strict=True)):
        x = floats(path.fraction)
        angle.append(Curve(path.name, x, floats(path.angle_deg), colour=colour, line=line))
        speed.append(Curve(path.name, x, floats(path.speed_deg), colour=colour, line=line))
        for column, (letter, shade) in enumerate(zip("xyz", (2, 3, 4), strict=True)):
            label = f"{letter}, {path.name}"
            axis.append(Curve(label, x, floats(path.axis[:, column]), colour=shade, line=line))
    top = 1.15 * max(float(path.speed_deg.max()) for path in paths)
    panels = (
        Panel("tau", "angle of the rotation [deg]", tuple(angle), "Angle"),
        Panel("tau", "component of the axis", tuple(axis), "Axis", y_limits=(-0.15, 1.3)),
        Panel("tau", "angular speed [deg per unit of tau]", tuple(speed), "Speed of the body", y_limits=(0.0, top)),
    )
    return Figure("interpolation", "Angle, axis and speed between two rotations", panels)
