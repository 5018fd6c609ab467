"""Numbers in few digits with a true minus sign, and a pose in all the forms that people paste elsewhere."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.files.length_names import SETTING_LENGTHS
from dqreg.inspection import Decision
from dqreg.rigid import DualQuaternion, quaternion

# Rounding of a quaternion, with room to spare: two Euler axes that are no farther apart fall together.
AXES_ROUNDING = 1e-12
# Numbers below this are written without a power of ten.
MAX_PLAIN_NUMBER = 1e7


def text_of(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """A number in a few digits; no power of ten up to ten million.

    >>> text_of(24190.5, 4), text_of(-1234.5, sign=True), text_of(3e7), text_of(0.0000123)
    ('24190', '−1230', '3e+07', '1.23e-05')
    """
    if value is None or np.isnan(value):
        return "not known"
    if np.isinf(value):
        return "no limit" if value > 0 else "−∞"
    plus = "+" if sign and value else ""
    text = f"{value:{plus}.{digits}g}"
    if "e+" in text and abs(value) < MAX_PLAIN_NUMBER:
        text = f"{float(text):{plus}.0f}"
    return text.replace("-", "−") if not text.count("e") else text.replace("-", "−", 1) if value < 0 else text


def decimals_of(uncertainty: float) -> int:
    """Decimals that a value of that uncertainty has: down to its second digit.

    >>> decimals_of(0.0123), decimals_of(0.9), decimals_of(0.0)
    (3, 2, 6)
    """
    if not 0.0 < uncertainty < np.inf:
        return 6
    return max(0, 1 - int(np.floor(np.log10(uncertainty))))


def measured_text(value: float, uncertainty: float) -> tuple[str, str]:
    """A measured value and its uncertainty with the same decimals, as many as two digits of the uncertainty take.

    >>> measured_text(0.26224, 0.01), measured_text(5.4e-7, 0.0019), measured_text(-3.9e-5, 0.00033)
    (('0.262', '0.010'), ('0.0000', '0.0019'), ('−0.00004', '0.00033'))
    >>> measured_text(float("nan"), float("nan"))
    ('–', '–')
    """
    decimals = decimals_of(uncertainty)
    return fixed(value, decimals), fixed(uncertainty, decimals)


def fixed(value: float, decimals: int, *, sign: bool = False) -> str:
    """A number with so many decimals; what rounds to nothing has no sign.

    >>> fixed(-0.00123, 4), fixed(-1e-9, 3), fixed(0.5, 2, sign=True), fixed(float("nan"), 2)
    ('−0.0012', '0.000', '+0.50', '–')
    """
    if not np.isfinite(value):
        return "–"
    rounded = round(value, decimals) + 0.0
    plus = "+" if sign and rounded else ""
    return f"{rounded:{plus}.{decimals}f}".replace("-", "−")


def percent(share: float) -> str:
    """A share in percent, never rounded to all or nothing.

    >>> percent(0.5), percent(1.0), percent(0.99999), percent(1e-7)
    ('50.0', '100', '> 99.9', '< 0.1')
    """
    if np.isnan(share):
        return "not known"
    if share in (0.0, 1.0):
        return f"{100.0 * share:.0f}"
    if share < 0.001:
        return "< 0.1"
    return "> 99.9" if share > 0.999 else f"{100.0 * share:.1f}"


def percent_asked(share: float) -> str:
    """A share that somebody asked for, in percent with all of its digits.

    >>> percent_asked(0.95), percent_asked(0.9995), percent_asked(0.012345)
    ('95', '99.95', '1.2345')
    """
    return f"{100.0 * share:.10g}"


def unit_words(unit: str | None) -> str:
    """A unit behind a number; nothing where it is not known, which is said once, not at every number.

    >>> f"0.1{unit_words('mm')}, 0.1{unit_words(None)}"
    '0.1 mm, 0.1'
    """
    return f" {unit}" if unit else ""


def in_unit(name: str, unit: str | None) -> str:
    """The name of a length with its unit.

    >>> in_unit("deviation", "mm"), in_unit("deviation", "")
    ('deviation [mm]', 'deviation')
    """
    return f"{name} [{unit}]" if unit else name


def limits_text(low: float, high: float) -> str:
    """Deviations allowed.

    >>> limits_text(-0.1, 0.1), limits_text(-0.05, 0.2), limits_text(0.0, 0.2), limits_text(-np.inf, np.inf)
    ('±0.1', '+0.2/−0.05', '+0.2/0', 'none')
    """
    if np.isinf(high):
        return "none"
    if low == -high:
        return f"±{text_of(high, 6)}"
    return "/".join(text_of(x + 0.0, 6, sign=True) for x in (high, low))


def scale_end(limits: tuple[float, float] | None) -> str:
    """Where a scale of colours ends: at the limits of all faces, or where these have their own.

    >>> scale_end((-0.1, 0.1)), scale_end(None), scale_end((-0.02, 0.08))
    ('the tolerance', 'the largest tolerance', 'the larger side of the tolerance +0.08/−0.02')
    """
    if limits is None:
        return "the largest tolerance"
    low, high = limits
    return "the tolerance" if low == -high else f"the larger side of the tolerance {limits_text(low, high)}"


def tolerance_text(found: Decision, unit: str) -> str:
    """The tolerance that a decision is against."""
    single = "" if not found.own else "1 face" if found.own == 1 else f"{found.own} faces"
    if np.isinf(found.high):
        return f"the tolerance of {single}" if found.own == 1 else f"the tolerances of {single}"
    whole = limits_text(found.low, found.high) + unit_words(unit)
    return whole if not single else f"{whole} ({single}: own tolerance)"


def place_text(point: FloatArray) -> str:
    """Coordinates of a place.

    >>> place_text(np.array([1.0, -2.5, 1e6]))
    '(1, −2.5, 1000000)'
    """
    return "(" + ", ".join(f"{x:.7g}".replace("-", "−") for x in np.round(point, 12) + 0.0) + ")"


def setting_text(name: str, value: Any, unit: str) -> str:
    """A setting with its unit.

    >>> setting_text("width", 0.5, "mm"), setting_text("max_angle_deg", 60.0, "mm"), setting_text("seed", 0, "mm")
    ('0.5 mm', '60 degrees', '0')
    """
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    words = unit_words(unit) if name in SETTING_LENGTHS else " degrees" if name.endswith("_deg") else ""
    if isinstance(value, (list, tuple)):
        return f"({', '.join(setting_text('', item, unit) for item in value)}){words}"
    if isinstance(value, float):
        return f"{text_of(value, 6)}{words}"
    return str(value)


@dataclasses.dataclass(frozen=True)
class PoseForm:
    """A pose in one form."""

    name: str  # What it is called
    convention: str  # Order, units and sense, in words
    text: str  # The numbers, to be copied; all the digits that float64 has where it is a matrix or a quaternion


def pose_forms(T_target_source: FloatArray, unit: str) -> list[PoseForm]:
    """All forms of a pose."""
    as_pose(T_target_source, "T_target_source")
    # Written as it is, to the last bit: checking rounds it anew.
    T = np.asarray(T_target_source, dtype=np.float64)
    unit = unit or "the target's unit"
    dq = DualQuaternion.from_matrix(T).canonical()
    screw = dq.as_screw()
    q = quaternion.from_matrix(T[:3, :3])
    vector = screw.angle_rad * screw.axis
    return [
        PoseForm("Matrix", f"T_target_source, 4x4: p_target = R p_source + t, lengths in {unit}", _rows(T)),
        PoseForm("Inverse matrix", f"T_source_target, 4x4: p_source = Rᵀ (p_target − t), lengths in {unit}",
                 _rows(dq.inverse().as_matrix())),
        PoseForm("Quaternion and translation", f"w x y z (Hamilton, active), then x y z in {unit}",
                 f"{_row(q)}\n{_row(T[:3, 3])}"),
        PoseForm("Dual quaternion", f"real part w x y z, then dual part w x y z = ½ t · real, lengths in {unit}",
                 f"{_row(dq.real)}\n{_row(dq.dual)}"),
        PoseForm("Screw", f"axis direction; a point on the axis [{unit}]; rotation [degrees]; translation along it "
                 f"[{unit}]", f"axis {_row(screw.axis)}\npoint {_row(screw.point)}\n"
                 f"rotation {_short(np.rad2deg(screw.angle_rad))}\ntranslation {_short(screw.distance)}"),
        PoseForm("Rotation vector", f"axis times angle [radians], then translation x y z [{unit}]",
                 f"{_row(vector)}\n{_row(T[:3, 3])}"),
        _euler(T, _fixed_axes(q), "Euler angles, fixed axes", "rx ry rz in degrees: rotation by rx about the "
               "target's fixed x, then by ry about fixed y, then by rz about fixed z; R = Rz(rz) Ry(ry) Rx(rx) "
               "(roll, pitch, yaw)", unit),
        _euler(T, _moving_axes(q), "Euler angles, moving axes", "a b c in degrees: rotation by a about z, then "
               "by b about the new y, then by c about the new z; R = Rz(a) Ry(b) Rz(c)", unit),
    ]  # fmt: skip


def _fixed_axes(q: FloatArray) -> FloatArray:
    # As below, of the quaternion after a quarter-turn about y: rotations about x and z alone are left.
    w, x, y, z = q
    up, down = np.array([w - y, x + z]), np.array([w + y, z - x])
    half_sum, half_difference = np.arctan2(up[1], up[0]), np.arctan2(down[1], down[0])
    b = 2.0 * np.arctan2(np.hypot(*down), np.hypot(*up)) - 0.5 * np.pi
    # Two of the axes fall together: any split of the rotation between them is right, and all of it goes to the first.
    if np.hypot(*up) < AXES_ROUNDING:
        half_sum = -half_difference
    elif np.hypot(*down) < AXES_ROUNDING:
        half_difference = -half_sum
    a, c = half_sum - half_difference, half_sum + half_difference
    return np.rad2deg([_within_a_half_turn(a), b, _within_a_half_turn(c)])


def _moving_axes(q: FloatArray) -> FloatArray:
    # q = (cos b/2 cos s, -sin b/2 sin d, sin b/2 cos d, cos b/2 sin s); s, d half the sum and difference of a and c.
    # SciPy takes a b below 1e-7 for none, and loses as much.
    w, x, y, z = q
    half_sum, half_difference = np.arctan2(z, w), np.arctan2(-x, y)
    b = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    a, c = half_sum + half_difference, half_sum - half_difference
    return np.rad2deg([_within_a_half_turn(a), b, _within_a_half_turn(c)])


def _within_a_half_turn(angle: float) -> float:
    return angle - 2.0 * np.pi * round(angle / (2.0 * np.pi))


def _euler(T: FloatArray, angles: FloatArray, name: str, convention: str, unit: str) -> PoseForm:
    return PoseForm(name, f"{convention}; then x y z in {unit}", f"{_row(angles)}\n{_row(T[:3, 3])}")


def _rows(matrix: FloatArray) -> str:
    return "\n".join(_row(row) for row in matrix)


def _row(values: FloatArray) -> str:
    return " ".join(_short(value) for value in values)


def _short(value: float) -> str:
    # The shortest text that reads back as the same number; minus zero is zero.
    number = float(value) + 0.0
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
