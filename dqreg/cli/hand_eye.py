"""`dqreg hand-eye FILE`: the pose of a sensor on a robot's hand, or beside the robot, with its uncertainty."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dqreg.cli.outputs import as_json_option, consoles, print_json, quiet_option, say
from dqreg.cli.overwriting import require_apart
from dqreg.cli.values import FILE
from dqreg.errors import DegenerateGeometryError, InputError

if TYPE_CHECKING:
    from rich.console import Console

    from dqreg._arrays import FloatArray
    from dqreg.solvers import RobotWorldFit

PAIR = (float, float)
# Rotation that the sensor's noise does not explain, degrees: then the other conventions are looked at.
DOUBTFUL_DEG = 2.0
# A convention that fits this much better is named.
BETTER_RATIO = 5.0
# Conventions that fit within this factor of the best fit alike.
ALIKE_RATIO, ROUNDING_RAD = 1.5, 1e-7
# The choices of each option.
OTHER = {
    "eye_poses": {"target": "sensor", "sensor": "target"},
    "hand_poses": {"hand": "base", "base": "hand"},
    "sensor": {"hand": "world", "world": "hand"},
}
# What X and Y of ``A X = Y B`` are, by where the sensor is.
NAMES = {"hand": ("T_base_target", "T_hand_eye"), "world": ("T_hand_target", "T_base_eye")}


@click.command("hand-eye")
@click.argument("file", type=FILE)
@click.argument("eye", type=FILE, required=False)
@click.option("--sensor", type=click.Choice(["hand", "world"]), default="hand", show_default=True,
              help="Where the sensor is: on the hand, the target fixed; or fixed, the target on the hand.")  # fmt: skip
@click.option("--eye-poses", type=click.Choice(["target", "sensor"]), default="target", show_default=True,
              help="Poses of the eye: the target in the sensor's frame (T_eye_target), or the sensor in the target's "
              "or a map's (T_target_eye), as odometry gives them.")  # fmt: skip
@click.option("--hand-poses", type=click.Choice(["hand", "base"]), default="hand", show_default=True,
              help="Poses of the hand: T_base_hand, or its inverse T_hand_base.")  # fmt: skip
@click.option("--robot-noise", type=PAIR, metavar="DEG LENGTH", help="Standard deviations of the robot's rotation and "
              "position, a component  [default: exact].")  # fmt: skip
@click.option("--sensor-noise", type=PAIR, metavar="DEG LENGTH", help="The same of the sensor's poses  [default: from "
              "the residuals].")  # fmt: skip
@click.option("--out", type=FILE, help="Write the result as JSON.")
@as_json_option
@quiet_option
def hand_eye_command(file: Path, eye: Path | None, **options: Any) -> int:
    """Calibrate a sensor on a robot: its pose on the hand (or beside the robot), how sure it is, and the residuals.

    FILE holds the poses of the hand and of the eye at three stations or more, better ten, turned about two axes by 30
    degrees and more: JSON {"hand": [4x4, ...], "eye": [4x4, ...]}, or a table (CSV, text) with both poses in each row,
    14 numbers (x y z qx qy qz qw, twice), 24 or 32 (matrices row by row). Or FILE is the trajectory of the hand and EYE
    that of the sensor, in TUM's format (matched by time) or KITTI's (row by row).

    \b
    dqreg hand-eye stations.json
    dqreg hand-eye stations.csv --sensor world --out calibration.json
    dqreg hand-eye hand.tum lidar.tum --eye-poses sensor
    dqreg hand-eye stations.csv --robot-noise 0.01 0.05 --sensor-noise 0.05 0.2 --json | jq .T_hand_eye

    Exit codes: 0 calibrated, 2 bad input, such as one motion only or parallel axes.
    """
    from dqreg.files.atomic import require_writable, write_atomically
    from dqreg.files.strict_json import plain

    require_apart((file, eye), {"--out": options["out"]})
    if options["out"] is not None:
        require_writable(options["out"])
    hand, sensor = _read(file, eye, options["eye_poses"], options["hand_poses"])
    noise = {"sigma_A": _radians(options["robot_noise"]), "sigma_B": _radians(options["sensor_noise"])}
    try:
        fit = _fit(hand, sensor, options["sensor"], noise)
    except DegenerateGeometryError as error:
        hint = _other_convention(hand, sensor, options, math.inf)
        if hint is None:
            raise
        raise InputError(f"{error} They agree with {hint}") from error
    hint = _other_convention(hand, sensor, options, _rms(fit.rotation_residuals))
    values = _values(fit, options["sensor"], hint)
    console, _ = consoles(quiet=options["quiet"], as_json=options["as_json"])
    _show(console, values, options["sensor"])
    if options["out"] is not None:
        write_atomically(options["out"], json.dumps(plain(values), indent=1, allow_nan=False) + "\n")
        say(console, f"wrote {options['out']}")
    if options["as_json"]:
        print_json(values)
    return 0


def _read(file: Path, eye: Path | None, eye_poses: str, hand_poses: str) -> tuple[FloatArray, FloatArray]:
    """T_base_hand and T_eye_target of each station."""
    from dqreg.rigid import pose
    from dqreg.rigid._operands import as_rigid_poses

    if eye is None:
        from dqreg.cli.pose_pairs import read_pose_pairs

        hand, sensor = read_pose_pairs(file)
    else:
        hand, sensor = _matched(file, eye)
    hand, sensor = as_rigid_poses(hand, "the poses of the hand"), as_rigid_poses(sensor, "the poses of the eye")
    return (
        pose.inverse(hand) if hand_poses == "base" else hand,
        pose.inverse(sensor) if eye_poses == "sensor" else sensor,
    )


def _matched(file: Path, eye: Path) -> tuple[FloatArray, FloatArray]:
    """Poses of two trajectories at the same times, or row by row."""
    import numpy as np

    from dqreg.files.trajectories import read_poses

    (hand, hand_times), (sensor, eye_times) = read_poses(file), read_poses(eye)
    if hand_times is None or eye_times is None:
        if len(hand) != len(sensor):
            raise InputError(
                f"{file} holds {len(hand)} poses and {eye} {len(sensor)}; without times the rows must match"
            )
        return hand, sensor
    order = np.argsort(hand_times)
    hand, hand_times = hand[order], hand_times[order]
    right = np.clip(np.searchsorted(hand_times, eye_times), 1, max(len(hand_times) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(hand_times) - 1)
    nearest = np.where(eye_times - hand_times[left] <= hand_times[right] - eye_times, left, right)
    # Half the finer of the two intervals: no other pose may be nearer.
    step = min(float(np.median(np.diff(np.sort(times)))) for times in (hand_times, eye_times) if len(times) > 1)
    close = np.abs(hand_times[nearest] - eye_times) <= 0.5 * step
    if np.count_nonzero(close) < 3:
        raise InputError(
            f"{np.count_nonzero(close)} poses of {eye} lie within {0.5 * step:.3g} of a time of {file} (times from "
            f"{hand_times[0]:.6g} to {hand_times[-1]:.6g} and {eye_times.min():.6g} to {eye_times.max():.6g}); "
            "are both on one clock?"
        )
    return hand[nearest[close]], sensor[close]


def _radians(noise: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if noise is None else (math.radians(noise[0]), noise[1])


def _fit(hand: FloatArray, sensor: FloatArray, place: str, noise: dict[str, Any]) -> RobotWorldFit:
    from dqreg.rigid import pose
    from dqreg.solvers import robot_world_hand_eye

    return robot_world_hand_eye(pose.inverse(hand) if place == "hand" else hand, sensor, **noise)


def _other_convention(hand: FloatArray, sensor: FloatArray, options: dict[str, Any], now: float) -> str | None:
    """The options under each of which the rotations agree far better than to ``now``, where that is bad."""
    from dqreg.rigid import pose

    if math.degrees(now) < DOUBTFUL_DEG:
        return None
    place = options["sensor"]
    eye, arm, other = (OTHER[name][options[name]] for name in ("eye_poses", "hand_poses", "sensor"))
    ways = {
        f"--eye-poses {eye}": (hand, pose.inverse(sensor), place),
        f"--hand-poses {arm}": (pose.inverse(hand), sensor, place),
        f"--sensor {other}": (hand, sensor, other),
    }
    found = {}
    for words, (h, s, where) in ways.items():
        try:
            found[words] = _rms(_fit(h, s, where, {}).rotation_residuals)
        except DegenerateGeometryError:
            continue
    best = min(found.values(), default=math.inf)
    if not (BETTER_RATIO * best < now and math.degrees(best) < DOUBTFUL_DEG):
        return None
    # A sensor on the hand that tells its own pose is, in numbers, one beside the robot that sees the hand.
    return " or ".join(words for words, residual in found.items() if residual < max(ALIKE_RATIO * best, ROUNDING_RAD))


def _rms(values: FloatArray) -> float:
    import numpy as np

    return float(np.sqrt(np.mean(np.square(values))))


def _values(fit: RobotWorldFit, place: str, hint: str | None) -> dict[str, Any]:
    import numpy as np

    (x, y), sigma = NAMES[place], np.sqrt(np.diagonal(fit.covariance))
    return {
        y: fit.Y.tolist(),
        x: fit.X.tolist(),
        "covariance": fit.covariance[6:, 6:].tolist(),
        "sigma_rotation_deg": np.rad2deg(sigma[6:9]).tolist(),
        "sigma_translation": sigma[9:].tolist(),
        "noise_rotation_deg": math.degrees(fit.sigma_rotation),
        "noise_translation": fit.sigma_translation,
        "rotation_residuals_deg": np.rad2deg(fit.rotation_residuals).tolist(),
        "translation_residuals": fit.translation_residuals.tolist(),
        "stations": len(fit.rotation_residuals),
        "other_convention": hint,
    }


def _show(console: Console, values: dict[str, Any], place: str) -> None:
    import numpy as np

    name = NAMES[place][1]
    say(console, f"{name} from {values['stations']} stations, the sensor's pose {_where(place)}:")
    for row in values[name]:
        say(console, "  " + " ".join(f"{number:14.9g}" for number in row))
    turn, shift = (np.array(values[key]) for key in ("sigma_rotation_deg", "sigma_translation"))
    say(console, f"standard deviation    {_list(turn)} deg, {_list(shift)} (about x, y, z; along x, y, z)")
    noise = f"{values['noise_rotation_deg']:.3g} deg, {values['noise_translation']:.3g}"
    say(console, f"noise of a component  {noise}")
    for key, words, unit in (
        ("rotation_residuals_deg", "rotation residual", " deg"),
        ("translation_residuals", "translation residual", ""),
    ):
        residuals = np.array(values[key])
        worst = int(residuals.argmax())
        say(console, f"{words:21} {_rms(residuals):.3g}{unit} rms, {residuals[worst]:.3g}{unit} at station {worst + 1}")
    if values["other_convention"] is not None:
        say(console, f"the poses agree badly; they agree far better with {values['other_convention']}")


def _where(place: str) -> str:
    return "on the hand" if place == "hand" else "in the robot's base"


def _list(numbers: FloatArray) -> str:
    return " ".join(f"{number:.2g}" for number in numbers)
