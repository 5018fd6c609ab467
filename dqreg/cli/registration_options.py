"""Options that several commands give to a registration, each spelled once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dqreg.cli.lazy_group import Choice
from dqreg.cli.values import UNITS, PlaceType

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

# The same words as in the library, which a test compares: importing them would load the solvers for `--help`.
METHODS = ("auto", "dq", "dq-points", "svd", "plane", "generalised")
EFFORTS = ("fast", "normal", "best")
SEARCHES = ("never", "doubt", "always")

start_option = click.option(
    "--start", default="none", show_default=True, metavar="none|identity|FILE", help="Initial pose: none: global "
    "registration; FILE: 4x4 T_target_source as text, a result.json, or result.json#2, its second alternative."
)  # fmt: skip
search_option = click.option(
    "--search", type=Choice(SEARCHES), default="doubt", show_default=True, help="Global search beside an initial pose: "
    "never, where the pose is in doubt, or always; the better pose is kept."
)  # fmt: skip
dof_option = click.option(
    "--dof", metavar="MOTIONS", help="Degrees of freedom in which the pose may differ from the initial pose, such as "
    "'rz tx ty'; all others are locked."
)  # fmt: skip
viewpoint_option = click.option(
    "--viewpoint", type=PlaceType(), multiple=True, metavar="none|origin|X Y Z", help="Where the scanner stood, in "
    "SCAN's coordinates; may be given again. Faces hidden from the scanner are ignored; what it looked through speaks "
    "against a pose. none: nor is the place in SCAN's file used."
)  # fmt: skip
exclude_option = click.option(
    "--exclude", type=float, nargs=6, multiple=True, metavar="X Y Z X Y Z", help="Leave the points in this box out: "
    "two opposite corners, in the coordinates of the part; may be given again."
)  # fmt: skip
keep_option = click.option(
    "--keep", is_flag=True, help="Count surfaces that leave the part (a table, a clamp) and outliers too."
)
max_distance_option = click.option(
    "--max-distance", type=float, metavar="LENGTH", help="Maximum correspondence distance, target units  [default: 0.2 "
    "of the smaller diagonal of the two]."
)  # fmt: skip
time_limit_option = click.option(
    "--time-limit", type=float, metavar="SECONDS", help="Time limit of the registration; returns the best pose so far, "
    "and a verdict that says so."
)  # fmt: skip


def method_option(*, of_rows: bool = False) -> Callable[[Any], Any]:
    """Option for the estimator."""
    return _shared(
        "--method", default="auto", of_rows=of_rows, type=Choice(METHODS), words="Estimator: the dual-quaternion "
        "closed form with normals (dq) or without (dq-points), Arun's SVD, point-to-plane, or plane-to-plane "
        "(generalised); auto starts with dq and refines with plane."
    )  # fmt: skip


def effort_option(*, of_rows: bool = False) -> Callable[[Any], Any]:
    """Option for how much the last level looks at."""
    return _shared(
        "--effort", default="normal", of_rows=of_rows, type=Choice(EFFORTS), words="Size of the last level: on a mesh "
        "about 8,000 or 25,000 closest-point queries, or as many as all points need; between large clouds about 6,000 "
        "or 10,000 cells, or all points."
    )  # fmt: skip


def max_angle_option(*, of_rows: bool = False) -> Callable[[Any], Any]:
    """Option for the angle between the normals of a correspondence."""
    return _shared(
        "--max-angle", "max_angle_deg", default=60.0, of_rows=of_rows, type=float, metavar="DEGREES", words="Maximum "
        "angle between the normals of a correspondence."
    )  # fmt: skip


def seed_option(*, of_rows: bool = False) -> Callable[[Any], Any]:
    """Option for the seed of all random draws."""
    return _shared(
        "--seed", default=0, of_rows=of_rows, type=int, metavar="N", words="Seed of all random draws: the same seed "
        "gives the same pose."
    )  # fmt: skip


def units_option(side: str, of: str, default: str = "") -> Callable[[Any], Any]:
    """Option for the length unit of a side, "source" or "target", by the words for what that is."""
    said = f"  [default: {default}]" if default else ""
    return click.option(f"--{side}-units", type=UNITS, help=f"Length unit of {of}{said}.")


def _shared(name: str, *names: str, default: Any, of_rows: bool, words: str, **more: Any) -> Callable[[Any], Any]:
    """Option of a registration, or of all rows of a batch, each of which may say its own: the default is theirs."""
    if not of_rows:
        return click.option(name, *names, default=default, show_default=True, help=words, **more)
    return click.option(name, *names, help=f"{words}  [default: {default}]", **more)
