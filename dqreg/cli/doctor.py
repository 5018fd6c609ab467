"""`dqreg doctor`: what is installed, what is missing, and the command that mends it."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import sys

import click
from packaging.requirements import Requirement

from dqreg._open3d import load_open3d
from dqreg.errors import MissingDependencyError, printable

LEAST_PYTHON = (3, 11)
# Extras of those who work on dqreg itself, and the one of all others: what is recommended is the least that brings it.
UNNAMED_EXTRAS = ("test", "fuzz", "docs", "lint", "dev", "all")
# Both unpack into the same folder; what loads is looked at, not what is installed.
OPEN3D = ("open3d", "open3d-cpu")
# Wheels of Open3D 0.20, as its own metadata names them.
WHEELS = "it needs Linux with glibc 2.35, macOS on Apple silicon, or Windows on x86-64, and Python 3.11 to 3.14"
LEAST_GLIBC = (2, 35)
NEWEST_PYTHON, NEWEST_PYTHON_OF_OLD = (3, 14), (3, 12)


@dataclasses.dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str  # What it is
    version: str | None  # What was found; None if nothing
    ok: bool  # Whether dqreg can do all its work with it; a missing optional part is fine
    remedy: str = ""  # The command that mends or adds it; empty if there is nothing to do
    needed: str = ""  # Versions that will do, such as ">=1.26"
    extra: str = ""  # Extra of dqreg that brings it; empty for what is always needed


def examine() -> list[Check]:
    """State of everything that dqreg stands on, in the order of the table."""
    wanted = requirements()
    return [
        _python(),
        _distribution("dqreg"),
        *(_required(each) for each, extra in wanted if not extra and each.name not in OPEN3D),
        _platform(),
        _open3d(),
        *_open3d_rivals(),
        *(_required(each, extra) for each, extra in wanted if extra),
        *_kernels(),
        Check("processor cores", str(os.cpu_count() or 1), ok=True),
    ]


def requirements() -> list[tuple[Requirement, str]]:
    """What the package's own metadata asks for on this machine, each with the first extra that brings it."""
    found: dict[str, tuple[Requirement, str]] = {}
    for each in map(Requirement, _metadata()):
        extras = [extra for extra in _extras(each) if extra not in UNNAMED_EXTRAS]
        if each.name == "dqreg" or (_extras(each) and not extras):
            continue
        if each.marker is None or each.marker.evaluate({"extra": extras[0] if extras else ""}):
            found.setdefault(each.name, (each, extras[0] if extras else ""))
    return list(found.values())


def _metadata() -> list[str]:
    try:
        return importlib.metadata.requires("dqreg") or []
    except importlib.metadata.PackageNotFoundError:
        return []  # run from its source folder: the first lines say so


def _extras(each: Requirement) -> list[str]:
    return re.findall(r"extra == ['\"]([\w.-]+)['\"]", str(each.marker or ""))


@click.command()
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on standard output.")
@click.option(
    "--compile", "compiles", is_flag=True, help="First compile all inner loops, for every user of the package."
)
@click.pass_context
def doctor(context: click.Context, as_json: bool, compiles: bool) -> None:
    """Show what is installed, what is missing or too old, and the command that installs it.

    Inner loops are compiled when they are first used, once a machine; with --compile now, where an image is built.

    \b
    dqreg doctor                                    a table; in a pipe one line a part, with tabs
    dqreg doctor --compile                          compile all inner loops now
    dqreg doctor --json | jq '.[] | select(.ok | not)'

    Exit code 0 if all that is required works, 1 if not.
    """
    if compiles and _version("numba") is not None:
        from dqreg.kernels.compiling.compile_all import compile_for_all_users

        compile_for_all_users()
    checks = examine()
    if as_json:
        click.echo(json.dumps([dataclasses.asdict(check) for check in checks], indent=1))
    elif sys.stdout.isatty():
        _show_table(checks)
    else:
        for check in checks:
            told = (_word(check), check.name, check.version or "missing", check.remedy, check.needed, check.extra)
            click.echo("\t".join(map(printable, told)).rstrip())
    context.exit(0 if all(check.ok for check in checks) else 1)


def _word(check: Check) -> str:
    if not check.ok:
        return "FAIL"
    if check.version is None:
        return "optional"
    return "old" if check.extra and check.remedy else "ok"


def _show_table(checks: list[Check]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from dqreg.cli.pipes import PatientConsole

    colours = {"ok": "green", "FAIL": "bold red", "optional": "dim", "old": "yellow"}
    table = Table("", "part", "found", "needed", "what to do")
    for check in checks:
        word = _word(check)
        name = f"{check.name} ({check.extra})" if check.extra else check.name
        texts = (name, check.version or "missing", check.needed, check.remedy)
        cells = (escape(printable(text)) for text in texts)
        table.add_row(f"[{colours[word]}]{word}[/]", *cells)
    PatientConsole().print(table)


def _python() -> Check:
    good = sys.version_info[:2] >= LEAST_PYTHON
    wanted = ".".join(map(str, LEAST_PYTHON))
    return Check("Python", platform.python_version(), good, "" if good else f"install Python {wanted} or newer")


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _distribution(name: str) -> Check:
    version = _version(name)
    if version is None and importlib.util.find_spec(name) is not None:
        version = "not installed, run from its source folder"
    return Check(name, version, version is not None, "" if version else f"pip install {name}")


def _required(each: Requirement, extra: str = "") -> Check:
    """A package, and whether its version is among those that will do."""
    version = _version(each.name)
    fits = version is not None and each.specifier.contains(version, prereleases=True)
    # Only Open3D's Linux wheels need it, and a system libusb does as well: Open3D's own check decides.
    optional = bool(extra) or each.name == "libusb-package"
    remedy = f"'dqreg[{extra}]'" if extra else f"'{each.name}{each.specifier}'" if each.specifier else each.name
    return Check(
        each.name, version, fits or optional, "" if fits else f"pip install {remedy}", str(each.specifier), extra
    )


def _platform() -> Check:
    """Whether Open3D 0.20 has a wheel for this system; 0.19 serves a few others."""
    system, machine, python = platform.system(), platform.machine().lower(), sys.version_info[:2]
    libc, glibc = platform.libc_ver()
    words = " ".join(filter(None, (system, machine, libc, glibc)))
    known = {
        "Linux": machine in ("x86_64", "aarch64") and libc == "glibc" and _numbers(glibc) >= LEAST_GLIBC,
        "Darwin": machine == "arm64",
        "Windows": machine in ("amd64", "x86_64"),
    }
    if known.get(system, False) and python <= NEWEST_PYTHON:
        return Check("platform", words, ok=True)
    older = "Open3D 0.19 serves older Linux and Intel Macs"
    if python > NEWEST_PYTHON_OF_OLD:
        older += f", but no Python after {'.'.join(map(str, NEWEST_PYTHON_OF_OLD))}"
    # Whether Open3D loads all the same is the next line's to say.
    return Check("platform", words, ok=True, remedy=f"Open3D 0.20 has no wheel for it: {WHEELS}. {older}")


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".") if part.isdecimal())


def _kernels() -> list[Check]:
    if _version("numba") is None:
        return []
    from dqreg.kernels.compiling.cache import folders, kept

    files, folder = kept(), folders()[1]
    found = f"{len(files)} in {files[-1].parent if files else folder}"
    remedy = "" if files else "dqreg doctor --compile"
    if folder is None and not files:
        found, remedy = "kept nowhere", "set NUMBA_CACHE_DIR to a folder that can be written"
    return [Check("compiled inner loops", found, ok=True, remedy=remedy)]


def _open3d() -> Check:
    # Only loading it shows whether the system libraries are there.
    try:
        return Check("open3d", str(load_open3d().__version__), ok=True)
    except MissingDependencyError as error:
        return Check("open3d", None, ok=False, remedy=str(error))


def _open3d_rivals() -> list[Check]:
    versions = {name: _version(name) for name in OPEN3D}
    if None in versions.values():
        return []
    # Both unpack into the same folder, so removing one damages the other: both go, one comes back.
    remedy = "pip uninstall -y open3d open3d-cpu && pip install open3d-cpu"
    found = " and ".join(f"{name} {version}" for name, version in versions.items())
    return [Check("one Open3D only", found, ok=False, remedy=remedy)]
