"""The layout of the package: what lies at the root, which way imports go, and how large a file may be."""

from __future__ import annotations

import ast
import io
import tokenize
import tomllib
from collections.abc import Iterable
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import dqreg

PACKAGE = Path(dqreg.__file__).parent
# A module that one other alone imports belongs to it, unless it is a concept of some size.
SMALL, FEW = 40, 15
LONGEST, FLOORS = 300, 9
BODY = 40
# Functions whose bodies are longer than that, in lines of code: they may only get shorter.
LONG = {
    "dqreg.cli.batch.batch": 44,
    "dqreg.cli.compare._run": 42,
    "dqreg.cli.inspect.inspect_command": 45,
    "dqreg.cli.many_compare.run_many": 45,
    "dqreg.cli.register.register_command": 45,
    "dqreg.inspection.deviations.measure.measure_deviations": 42,
    "dqreg.inspection.plan.suggested_plan.suggested_plan": 46,
    "dqreg.multiway.refinement.matches.Matching._on_scan": 42,
    "dqreg.multiway.register_many.register_many": 47,
    "dqreg.odometry.follow.follow": 42,
    "dqreg.registration.result.display_unit.in_unit": 44,
    "dqreg.registration.evidence.evidence.agreement_of": 45,
    "dqreg.report.report_data.collect": 44,
}
PLACEHOLDERS = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


@cache
def modules() -> dict[str, Path]:
    """Files of the package by their dotted names."""
    files = sorted(PACKAGE.rglob("*.py"))
    return {
        ".".join(("dqreg", *f.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): f for f in files
    }


@cache
def parsed(file: Path) -> ast.Module:
    """The tree of a file, which several laws look at."""
    return ast.parse(file.read_text(encoding="utf-8"))


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
    found = {name: imported(parsed(file)) & known.keys() for name, file in known.items()}
    return {
        name: {other for other in others if other != name and known[other].name != "__init__.py"}
        for name, others in found.items()
    }


def is_text(node: ast.AST) -> bool:
    """Whether a statement is a docstring."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


@cache
def lines_with_code(file: Path) -> frozenset[int]:
    """Numbers of the lines that hold more than a comment; those of docstrings among them."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(file.read_text(encoding="utf-8")).readline):
        if token.type not in PLACEHOLDERS:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return frozenset(lines)


def lines_of(nodes: Iterable[ast.AST]) -> set[int]:
    """Numbers of the lines that nodes stand on."""
    return {line for node in nodes for line in range(node.lineno, node.end_lineno + 1)}


def code_lines(file: Path) -> int:
    """Lines with code on them, without imports and docstrings."""
    nodes = ast.walk(parsed(file))
    without = lines_of(node for node in nodes if is_text(node) or isinstance(node, (ast.Import, ast.ImportFrom)))
    return len(lines_with_code(file) - without)


def body_lengths(name: str, file: Path, least: int = 0) -> dict[str, int]:
    """Lines of code in the body of each function of a module, what is defined in it included, by its full name.

    Of functions that have no more lines than ``least`` in all, 0: finding those of code takes longest.
    """
    found: dict[str, int] = {}

    def look(node: ast.AST, name: str) -> None:
        for child in ast.iter_child_nodes(node):
            is_function = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef))
            inner = f"{name}.{child.name}" if is_function or isinstance(child, ast.ClassDef) else name
            if is_function and child.end_lineno - child.lineno < least:
                found.setdefault(inner, 0)
            elif is_function:
                lines = lines_with_code(file) & (lines_of(child.body) - lines_of(filter(is_text, ast.walk(child))))
                # Of two of one name, as a property and its setter, the longer one counts.
                found[inner] = max(len(lines), found.get(inner, 0))
            look(child, inner)

    look(parsed(file), name)
    return found


def test_few_modules_lie_at_the_root() -> None:
    # And the entry of ``python -m dqreg``, which Python wants there.
    names = {"__init__.py", "__main__.py", "errors.py"}
    names |= {"_arrays.py", "_numbers.py", "_open3d.py", "_records.py", "_rotations.py", "_statuses.py"}
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


def test_every_file_on_other_poses_is_in_the_table_of_them() -> None:
    guide = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = guide.partition("## Other poses that fit as well")[2].partition("\n## ")[0]
    rooms = (PACKAGE / "registration" / room for room in ("other_poses", "choice"))
    files = {path.stem for room in rooms for path in room.glob("[!_]*.py")}
    assert files
    assert {name for name in files if f"`{name}`" not in table and f"`{name}." not in table} == set()


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


def test_functions_have_short_bodies() -> None:
    # Kernels are loops that a compiler wants in one piece.
    others = [(name, file) for name, file in modules().items() if not name.startswith("dqreg.kernels.")]
    lengths = {function: length for name, file in others for function, length in body_lengths(name, file, BODY).items()}
    assert len(lengths) > 1000
    assert {name: n for name, n in lengths.items() if n > LONG.get(name, BODY)} == {}
    # What is no longer too long leaves the list.
    assert {name for name in LONG if lengths.get(name, 0) <= BODY} == set()


def test_a_body_is_counted_by_its_lines_of_code(tmp_path: Path) -> None:
    file = tmp_path / "a.py"
    text = [
        *("class A:", "    @deco", "    def f(", "        self,", "    ):"),
        *('        """One.', "", '        Two."""', "        # No code.", ""),
        *("        x = [", "            1,", "        ]"),
        *("        def g():", '            """Text."""', "            return x  # code", "        return g", ""),
    ]
    file.write_text("\n".join(text))
    assert body_lengths("a", file) == {"a.A.f": 6, "a.A.f.g": 1}


# Where points are given to a record by hand: it is no cloud, or a cloud whose rows all stay.
POINTS_BY_HAND = {
    "dqreg.geometry.cloud": "the home of it",
    "dqreg.geometry.cells": "cells",
    "dqreg.geometry.scan": "a scan",
    "dqreg.icp.full_resolution": "correspondences",
    "dqreg.inspection.sheet.aligned_part": "deviations",
    "dqreg.inspection.deviations.measure": "deviations",
    "dqreg.inspection.plan.in_unit": "a step of a plan",
    "dqreg.inspection.drawing.zone_features": "a feature, which counts them",
    "dqreg.multiway.refinement.matches": "correspondences",
    "dqreg.odometry.follow": "a scan",
    "dqreg.registration.scale_search": "a scan",
    "dqreg.studio.worker_cache": "the mirror image of a cloud",
    "dqreg.synth.faults": "a virtual scan",
    "dqreg.synth.scan": "a virtual scan",
}


def points_by_hand(tree: ast.Module) -> bool:
    """Whether a module replaces the points of some record, and leaves its other columns as they are."""
    return any(
        isinstance(node, ast.Call)
        and ast.unparse(node.func) in ("dataclasses.replace", "replace", "replaced")
        and any(keyword.arg == "points" for keyword in node.keywords)
        for node in ast.walk(tree)
    )


def test_rows_of_a_cloud_are_taken_in_one_place() -> None:
    # Times and normals go with their points: `PointCloud._taken`, `_standing_for` and `_moved` know all columns.
    assert {name for name, file in modules().items() if points_by_hand(parsed(file))} == POINTS_BY_HAND.keys()


def writes_vars(tree: ast.Module) -> list[str]:
    """Statements of a module that write into `vars` of something, by name or by `update` and the like."""

    def is_vars(node: ast.AST) -> bool:
        called = isinstance(node, ast.Call) and ast.unparse(node.func) == "vars"
        return called or (isinstance(node, ast.Attribute) and node.attr == "__dict__")

    changing = ("update", "setdefault", "pop")
    return [
        ast.unparse(node)
        for node in ast.walk(tree)
        if (isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load) and is_vars(node.value))
        or (isinstance(node, ast.Attribute) and node.attr in changing and is_vars(node.value))
    ]


def test_what_a_record_remembers_beside_its_fields_is_written_in_one_place() -> None:
    found = {name: writes_vars(parsed(file)) for name, file in modules().items()}
    assert {name: lines for name, lines in found.items() if lines} == {
        "dqreg._records": ["vars(record).update", "vars(record).pop"]
    }


def test_no_module_reads_what_the_surface_of_a_cloud_holds() -> None:
    # `CloudSurface._distinct` has the points that others ask for, with their tree and planes.
    held = {"_points", "_tree", "_planes_at", "_rows"}
    reading = {
        name: ast.unparse(node)
        for name, file in modules().items()
        for node in ast.walk(parsed(file))
        if isinstance(node, ast.Attribute) and node.attr in held and ast.unparse(node.value) != "self"
    }
    assert reading == {}


def packed_numbers(tree: ast.Module) -> list[str]:
    """Assignments of a module that give three names and more to numbers, each by what it assigns."""
    packed = []
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and len(node.targets[0].elts) > 2:
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            if not any(isinstance(value, ast.Constant) and isinstance(value.value, str) for value in values):
                packed.append(ast.unparse(node.targets[0]))
    return packed


def test_a_line_names_two_numbers_at_most() -> None:
    found = {name: packed_numbers(parsed(file)) for name, file in modules().items()}
    assert {name: lines for name, lines in found.items() if lines} == {}
