"""The layout of the package: what lies at the root, which way imports go, and how large a file may be."""

from __future__ import annotations

import ast
import io
import tokenize
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import dqreg

PACKAGE = Path(dqreg.__file__).parent
# A module that one other alone imports belongs to it, unless it is a concept of some size.
SMALL, FEW = 40, 15
LONGEST, FLOORS = 300, 9
PLACEHOLDERS = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


@cache
def modules() -> dict[str, Path]:
    """Files of the package by their dotted names."""
    files = sorted(PACKAGE.rglob("*.py"))
    return {
        ".".join(("dqreg", *f.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): f for f in files
    }


def imported(tree: ast.Module) -> set[str]:
    """Names that a file imports, wherever in the file it does."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@cache
def graph() -> dict[str, set[str]]:
    """Each module with the modules that it imports; an index that only hands names on is none."""
    known = modules()
    found = {name: imported(ast.parse(file.read_text(encoding="utf-8"))) & known.keys() for name, file in known.items()}
    return {
        name: {other for other in others if other != name and known[other].name != "__init__.py"}
        for name, others in found.items()
    }


def code_lines(file: Path) -> int:
    """Lines with code on them, without imports and docstrings."""
    source = file.read_text(encoding="utf-8")
    without: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        is_text = (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        )
        if is_text or isinstance(node, (ast.Import, ast.ImportFrom)):
            without |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in PLACEHOLDERS:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - without)


def test_four_modules_lie_at_the_root() -> None:
    # And the entry of ``python -m dqreg``, which Python wants there.
    names = {"__init__.py", "__main__.py", "_arrays.py", "_open3d.py", "_records.py", "errors.py"}
    assert {file.name for file in PACKAGE.glob("*.py")} == names


def test_no_file_is_longer_than_its_limit() -> None:
    lengths = {name: len(file.read_text(encoding="utf-8").splitlines()) for name, file in modules().items()}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}


def test_no_circle_of_files() -> None:
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def test_rooms_stand_on_nine_floors_at_most() -> None:
    def room(name: str) -> str:
        return ".".join(name.split(".")[:2])

    rooms: dict[str, set[str]] = {}
    for name, others in graph().items():
        if name not in ("dqreg", "dqreg.__main__"):
            rooms.setdefault(room(name), set()).update(room(other) for other in others if room(other) != room(name))
    floor: dict[str, int] = {}
    for name in TopologicalSorter(rooms).static_order():
        floor[name] = 1 + max((floor[other] for other in rooms.get(name, ())), default=0)
    assert max(floor.values()) <= FLOORS, sorted(floor.items(), key=lambda item: item[1])


def test_a_small_module_has_more_than_one_importer() -> None:
    importers: dict[str, list[str]] = {}
    for name, others in graph().items():
        for other in others:
            importers.setdefault(other, []).append(name)
    lonely = {name: by[0] for name, by in importers.items() if len(by) == 1 and code_lines(modules()[name]) < SMALL}
    assert len(lonely) <= FEW, lonely


def test_the_list_of_warnings_of_the_process_is_left_alone() -> None:
    # `catch_warnings` swaps it for all threads. Where other programs are run and compared, nothing else runs.
    swapping = {name for name, file in modules().items() if "catch_warnings" in file.read_text(encoding="utf-8")}
    assert swapping <= {"dqreg.compare.engines.harness", "dqreg.files.trajectories"}


def test_only_kernels_may_import_numba_whatever_other_rooms_there_are() -> None:
    # The contract names those that may not.
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = {each["name"]: each for each in project["tool"]["importlinter"]["contracts"]}
    parts = {name for name in modules() if name.count(".") == 1} - {"dqreg.__main__", "dqreg.kernels"}
    assert set(contracts["Only kernels import Numba"]["source_modules"]) == parts
