"""The public names and their signatures, beside the ones that were promised last: a change here is a new version."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import pytest

PROMISED = Path(__file__).with_name("api.txt")
ROOMS = [
    "dqreg",
    "dqreg.files",
    "dqreg.geometry",
    "dqreg.inspection",
    "dqreg.multiway",
    "dqreg.odometry",
    "dqreg.rigid",
    "dqreg.solvers",
    "dqreg.synth",
    "dqreg.trust",
]
# How to write the file anew, once the change is meant and the changelog says so.
REMEDY = "a public name or signature changed; if that is meant, run: python -m tests.test_api"


def signature_of(value: object) -> str:
    """Parameters with their defaults, without types: those are for mypy."""
    try:
        found = inspect.signature(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return ""
    plain = [p.replace(annotation=inspect.Parameter.empty) for p in found.parameters.values()]
    return str(found.replace(parameters=plain, return_annotation=inspect.Signature.empty))


def lines_of(name: str, value: object) -> list[str]:
    """A name with its signature, and the public methods where it is a class."""
    if inspect.ismodule(value):
        inner = [key for key in getattr(value, "__all__", None) or vars(value) if not key.startswith("_")]
        own = [
            key
            for key in inner
            if getattr(getattr(value, key), "__module__", "").startswith(("dqreg.rigid", "dqreg.solvers"))
        ]
        return [f"{name}.{key}{signature_of(getattr(value, key))}" for key in own]
    lines = [f"{name}{signature_of(value) if callable(value) else ''}"]
    if inspect.isclass(value) and not issubclass(value, Exception):
        # A class's own members and those that it has from a base of this package, however the code is split.
        bases = [base for base in inspect.getmro(value)[::-1] if base.__module__.startswith("dqreg.")]
        for key, member in {key: member for base in bases for key, member in vars(base).items()}.items():
            if not key.startswith("_"):
                raw = member.__func__ if isinstance(member, (classmethod, staticmethod)) else member
                lines.append(f"{name}.{key}{signature_of(raw) if inspect.isfunction(raw) else ''}")
    return lines


def public_api() -> str:
    """All of it, sorted."""
    lines: set[str] = set()
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            # A room of its own.
            if name != "solvers":
                lines.update(lines_of(f"{room}.{name}", getattr(module, name)))
    return "".join(f"{line}\n" for line in sorted(lines))


@pytest.mark.filterwarnings("ignore:dqreg.trust:DeprecationWarning")
def test_the_public_names_and_signatures_are_the_promised_ones() -> None:
    now, promised = set(public_api().splitlines()), set(PROMISED.read_text(encoding="utf-8").splitlines())
    gone, new = sorted(promised - now), sorted(now - promised)
    assert (gone, new) == ([], []), REMEDY


if __name__ == "__main__":
    PROMISED.write_text(public_api(), encoding="utf-8")
