"""numpydoc sections stand on what users call, complete and in order; everything else says what it is in a few lines."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate

import dqreg
from tests.test_api import PROMISED, ROOMS

ROOT = Path(__file__).parents[1]
NAMES = [line.partition("(")[0].strip() for line in PROMISED.read_text(encoding="utf-8").splitlines()]
CHECKS = set(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["numpydoc_validation"]["checks"])
for room in ROOMS:
    importlib.import_module(room)
SECTION = re.compile(
    r"^ *(Parameters|Other Parameters|Attributes|Returns|Yields|Raises|Warns|Examples|Notes|See Also)\n *-{3,}$", re.M
)


def found(name: str) -> tuple[Any, type | None]:
    """What a name stands for, and the class that it belongs to, if any."""
    value: Any = dqreg
    owner = None
    for part in name.split(".")[1:]:
        owner = value if inspect.isclass(value) else None
        value = inspect.getattr_static(value, part) if owner else getattr(value, part)
    return value, owner


def is_described_by_itself(value: Any) -> bool:
    return inspect.isroutine(value) or isinstance(value, (property, type)) or hasattr(value, "func")


def described_in(owner: type) -> set[str]:
    """Names under the parameters and attributes of a class and of those that it derives from."""
    docs = [get_doc_object(each) for each in inspect.getmro(owner)[:-1] if each.__module__.startswith("dqreg")]
    entries = [entry for doc in docs for entry in (*doc["Parameters"], *doc["Attributes"])]
    return {part.strip(" *") for entry in entries for part in entry.name.split(",")}


def faults_of(name: str) -> list[str]:
    value, owner = found(name)
    if owner is not None and not is_described_by_itself(value):
        short = name.rpartition(".")[2]
        return [] if short in described_in(owner) else [f"{short} is not among the attributes of its class"]
    if owner is None and not callable(value):
        return []  # a table, such as READERS
    errors = [(code, words) for code, words in validate(name)["errors"] if code in CHECKS]
    if inspect.isclass(value) and not issubclass(value, Exception):
        # The fields of a record are its attributes.
        missing = set(inspect.signature(value).parameters) - described_in(value) - {"args", "kwargs"}
        errors = [error for error in errors if error[0] != "PR01"]
        errors += [("PR01", f"not documented: {sorted(missing)}")] if missing else []
    return [f"{code} {words}" for code, words in errors]


@pytest.mark.filterwarnings("ignore:dqreg.trust:DeprecationWarning")
def test_public_names_are_documented_in_full() -> None:
    faults = {name: faults for name in NAMES if (faults := faults_of(name))}
    assert faults == {}


def definitions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Qualified name and docstring of every definition."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield prefix + node.name, ast.get_docstring(node) or ""
            yield from definitions(node, f"{prefix}{node.name}.")


def public_definitions() -> set[tuple[str, str]]:
    """Module and qualified name of what the public names stand for."""
    places = set()
    for name in NAMES:
        value, owner = found(name)
        if owner is not None:
            places.add((owner.__module__, f"{owner.__qualname__}.{name.rpartition('.')[2]}"))
        value = inspect.unwrap(getattr(value, "__func__", value)) if callable(value) else value
        places.add((getattr(value, "__module__", ""), getattr(value, "__qualname__", "")))
        if inspect.isclass(value):
            bases = [base for base in inspect.getmro(value) if base.__module__.startswith("dqreg.")]
            places |= {(b.__module__, f"{b.__qualname__}.{key}") for b in bases for key in vars(b) if key[0] != "_"}
    return places


@pytest.mark.filterwarnings("ignore:dqreg.trust:DeprecationWarning")
def test_everything_else_says_what_it_is_without_tables() -> None:
    public = public_definitions()
    tabled = []
    for path in sorted((ROOT / "dqreg").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for name, text in definitions(ast.parse(path.read_text("utf-8"))):
            if SECTION.search(text) and (module, name) not in public:
                tabled.append(f"{module}.{name}")
    assert tabled == []


@pytest.mark.parametrize(
    ("text", "tabled"),
    [("Mean.\n\nReturns\n-------\nfloat\n", True), ("Mean.\n\n>>> mean([1])\n1", False), ("Returns the mean.", False)],
)
def test_a_table_is_told_from_a_sentence(text: str, tabled: bool) -> None:
    assert bool(SECTION.search(text)) is tabled
