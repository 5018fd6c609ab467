"""`dqreg doctor`: what is installed, what is missing, and the command that mends it."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import importlib.util
import json
import os
import platform
import sys

import click

from dqreg._open3d import load_open3d
from dqreg.errors import MissingDependencyError

LEAST_PYTHON = (3, 11)
REQUIRED = ("numpy", "scipy", "trimesh", "click", "rich", "matplotlib", "jinja2")
OPTIONAL = ("kiss-icp", "small-gicp")


@dataclasses.dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str  # What it is
    version: str | None  # What was found; None if nothing
    ok: bool  # Whether dqreg can do all its work with it; a missing optional part is fine
    remedy: str = ""  # The command that mends or adds it; empty if there is nothing to do


def examine() -> list[Check]:
    """State of everything that dqreg stands on, in the order of the table."""
    return [
        _python(),
        _distribution("dqreg"),
        *(_distribution(name) for name in REQUIRED),
        _open3d(),
        *_open3d_rivals(),
        *_libusb(),
        *(_distribution(name, optional=True) for name in OPTIONAL),
        Check("processor cores", str(os.cpu_count() or 1), ok=True),
    ]


@click.command()
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on standard output.")
@click.pass_context
def doctor(context: click.Context, as_json: bool) -> None:
    """Show what is installed, what is missing and the command that installs it.

    \b
    dqreg doctor                                    a table; in a pipe one line a part, with tabs
    dqreg doctor --json | jq '.[] | select(.ok | not)'

    Exit code 0 if all that is required works, 1 if not.
    """
    checks = examine()
    if as_json:
        click.echo(json.dumps([dataclasses.asdict(check) for check in checks], indent=1))
    elif sys.stdout.isatty():
        _show_table(checks)
    else:
        for check in checks:
            click.echo("\t".join((_word(check), check.name, check.version or "missing", check.remedy)).rstrip())
    context.exit(0 if all(check.ok for check in checks) else 1)


def _word(check: Check) -> str:
    if not check.ok:
        return "FAIL"
    return "ok" if check.version is not None else "optional"


def _show_table(checks: list[Check]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    colours = {"ok": "green", "FAIL": "bold red", "optional": "dim"}
    table = Table("", "part", "found", "what to do")
    for check in checks:
        word = _word(check)
        cells = (escape(check.name), escape(check.version or "missing"), escape(check.remedy))
        table.add_row(f"[{colours[word]}]{word}[/]", *cells)
    Console().print(table)


def _python() -> Check:
    good = sys.version_info[:2] >= LEAST_PYTHON
    wanted = ".".join(map(str, LEAST_PYTHON))
    return Check("Python", platform.python_version(), good, "" if good else f"install Python {wanted} or newer")


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _distribution(name: str, *, optional: bool = False) -> Check:
    version = _version(name)
    if version is None and name == "dqreg" and importlib.util.find_spec(name) is not None:
        version = "not installed, run from its source folder"
    return Check(name, version, version is not None or optional, "" if version else f"pip install {name}")


def _open3d() -> Check:
    # Only loading it shows whether the system libraries are there.
    try:
        return Check("open3d", str(load_open3d().__version__), ok=True)
    except MissingDependencyError as error:
        return Check("open3d", None, ok=False, remedy=str(error))


def _open3d_rivals() -> list[Check]:
    versions = {name: _version(name) for name in ("open3d", "open3d-cpu")}
    if None in versions.values():
        return []
    # Both unpack into the same folder, so removing one damages the other: both go, one comes back.
    remedy = "pip uninstall -y open3d open3d-cpu && pip install open3d-cpu"
    found = " and ".join(f"{name} {version}" for name, version in versions.items())
    return [Check("one Open3D only", found, ok=False, remedy=remedy)]


def _libusb() -> list[Check]:
    # Only Open3D's Linux wheels need it, and a system libusb does as well: Open3D's own check decides.
    if not sys.platform.startswith("linux"):
        return []
    return [_distribution("libusb-package", optional=True)]
