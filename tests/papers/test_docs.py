from __future__ import annotations

import ast
import importlib
import inspect
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = ("equations_jia2020.md", "equations_walker1991_quaternions.md", "equations_walker1991_solution.md")
LAST = {"jia": 46, "walker": 75}


def paper_of(page: str, heading: str) -> str:
    if page != "equations_walker1991_solution.md":
        return "jia" if "jia" in page else "walker"
    return "jia" if heading.startswith("Jia") else "walker"


def equations(page: str) -> list[tuple[str, int]]:
    """Numbers in the first column of the equation tables of a page, with the paper whose section it is."""
    found, heading, header = [], "", ""
    for line in (DOCS / page).read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line[3:]
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            header = ""
        elif not header:
            header = cells[0]
        elif header == "equation" and re.match(r"\d", cells[0]):
            numbers = re.match(r"\d+(?:, \d+)*", cells[0])[0]
            found += [(paper_of(page, heading), int(number)) for number in numbers.split(", ")]
            assert all(cells), f"{page}: the row of equation {cells[0]} has an empty cell"
    return found


def ranges(paper: str) -> set[int]:
    """Numbers that the index page promises for a paper."""
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    part = next(p for p in text.split("\n## ") if p.lower().startswith(paper))
    spans = re.findall(r"^\| (\d+)(?: to (\d+))?[ ,]", part, re.MULTILINE)
    return {n for first, last in spans for n in range(int(first), int(last or first) + 1)}


@pytest.mark.parametrize("paper", LAST)
def test_every_equation_is_covered(paper):
    covered = {number for page in PAGES for whose, number in equations(page) if whose == paper}
    everything = set(range(1, LAST[paper] + 1))
    assert covered == everything
    assert ranges(paper) == everything


def test_every_table_and_figure_is_covered():
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    walker, jia = text.split("\n## Jia")
    assert set(re.findall(r"^\| (Table \d|Figure \d) \|", walker, re.MULTILINE)) == {
        *(f"Table {n}" for n in (1, 2, 3)),
        *(f"Figure {n}" for n in (1, 2, 3, 4, 5)),
    }
    assert set(re.findall(r"^\| (Figure \d) \|", jia, re.MULTILINE)) == {f"Figure {n}" for n in (1, 2, 3)}


@cache
def names_in(path: Path) -> frozenset[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def named_tests(page: str) -> list[tuple[Path, str]]:
    """Each `file.py::name`, `::name` (same file as before) and, under a header that names a file, each `test_name`."""
    found, beside, header = [], None, None
    for line in (DOCS / page).read_text(encoding="utf-8").splitlines():
        if line.startswith("|") and (said := re.search(r"test in `(test_\w+\.py)`", line)):
            header = said[1]
        elif not line.startswith("|"):
            header = None
        for path, name, alone in re.findall(r"`((?:[\w/]*test_\w+\.py)?)::(test_\w+)`|`(test_\w+)`", line):
            if alone and header is None:
                continue
            beside = locate(path or header) if path or alone else beside
            assert beside is not None, f"{page}: {line}"
            found.append((beside, name or alone))
    return found


def locate(path: str) -> Path:
    matches = [p for p in (ROOT / "tests").rglob(Path(path).name) if p.as_posix().endswith("/" + path)]
    assert len(matches) == 1, f"{path} is {len(matches)} files"
    return matches[0]


@pytest.mark.parametrize(("page", "least"), [*((page, 20) for page in PAGES), ("errata.md", 20), ("equations.md", 15)])
def test_every_named_test_exists(page, least):
    named = named_tests(page)
    assert len(named) >= least
    missing = [f"{path.name}::{name}" for path, name in named if name not in names_in(path)]
    assert missing == []


@pytest.mark.parametrize("page", ["errata.md", "equations.md"])
def test_links_and_paths_lead_somewhere(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (DOCS / link).is_file()
    for path in re.findall(r"`(dqreg/[\w/]+\.py)`", text):
        assert (ROOT / path).is_file()


# What stands for itself in the column of symbols, and where the others are found, by page.
WORDS = ("derivation only", "arrays (..., 4)")
HOMES = {
    "quaternion": "dqreg.quaternion",
    "pose": "dqreg.rigid.pose",
    "lines": "dqreg.rigid.lines",
    "walker": "dqreg.solvers.walker",
    "jia": "dqreg.solvers.jia",
    "DualQuaternion": "dqreg.DualQuaternion",
    "DualNumber": "dqreg.rigid.DualNumber",
    "Fit": "dqreg.solvers.Fit",
    "horn": "dqreg.solvers.horn",
}


def rows(page: str) -> list[dict[str, str]]:
    """Rows of the equation tables of a page: columns by the first word of their heads, and the paper."""
    found, heading, header, file = [], "", [], ""
    for line in (DOCS / page).read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line[3:]
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            header = []
        elif not header:
            header = [cell.split()[0] for cell in cells]
            file = (re.findall(r"test in `(test_\w+\.py)`", line) or [""])[0]
        elif header[0] == "equation" and not set(cells[0]) <= {"-"}:
            found.append(dict(zip(header, cells, strict=True)) | {"paper": paper_of(page, heading), "file": file})
    return found


def resolve(token: str, before: object) -> object:
    """The class or module that holds a symbol: `a.b`, `.b` of the holder before it, or one of dqreg.quaternion."""
    name = token.split("(")[0]
    if name.startswith("."):
        owner, path = before, name[1:].split(".")
    else:
        first, *path = name.split(".")
        if first in HOMES:
            home = HOMES[first]
        else:
            home, path = "dqreg.quaternion", [first, *path]
        module, _, last = home.rpartition(".")
        owner = getattr(importlib.import_module(module), last)
    for part in path:
        if inspect.isclass(owner) and part in getattr(owner, "__dataclass_fields__", {}):
            return owner
        assert not part.startswith("_"), f"{token} is private"
        holder, owner = owner, getattr(owner, part)
        if not inspect.isclass(owner) and not inspect.ismodule(owner):
            return holder
    return owner


@pytest.mark.parametrize("page", PAGES)
def test_every_symbol_can_be_called(page):
    checked = 0
    for row in rows(page):
        tokens, before = re.findall(r"`([^`]+)`", row["symbol"]), None
        if row["symbol"].startswith(WORDS):
            continue
        assert tokens, f"{page}: equation {row['equation']} has no symbol"
        for token in tokens:
            before = resolve(token, before)
            checked += 1
    assert checked > 10


@pytest.mark.parametrize(
    "token", ["angular_speedo", "_rotation.interpolate_axis", "walker.WalkerFit.C4", "DualNumber.tan"]
)
def test_a_symbol_that_is_not_there_is_found_out(token):
    with pytest.raises((AttributeError, AssertionError)):
        resolve(token, None)


def numbers_in(text: str) -> set[int]:
    """Numbers of a list such as "15, 16 and 61 to 66"."""
    spans = re.findall(r"(\d+)(?: to (\d+))?", text)
    return {n for first, last in spans for n in range(int(first), int(last or first) + 1)}


@cache
def sources_in(path: Path) -> dict[str, str]:
    text = path.read_text(encoding="utf-8")
    nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
    return {node.name: ast.get_source_segment(text, node) or "" for node in nodes}


def named_in(source: str, paper: str) -> set[int]:
    """Equations of a paper that a test names in its comments."""
    said = re.findall(rf"{paper.capitalize()} eqs?\. (\d+(?:(?:, | and | to )\d+)*)", source)
    return {n for text in said for n in numbers_in(text)}


def equations_of_tests(page: str) -> dict[tuple[Path, str], set[tuple[str, int]]]:
    """The numbers that the rows of a page ask of each test."""
    asked, before, beside = {}, [], None
    for row in rows(page):
        named = re.findall(r"`((?:[\w/]*test_\w+\.py)?)(?:::)?(test_\w+)`", row["test"])
        if named:
            before = []
        else:
            assert row["test"] == "the same", f"{page}: {row['test']}"
        for path, name in named:
            beside = locate(path or row["file"]) if path or row["file"] else beside
            before.append((beside, name))
        numbers = (re.findall(r"^\d+(?:, \d+)*", row["equation"]) or [""])[0]
        for key in before:
            asked.setdefault(key, set()).update((row["paper"], n) for n in numbers_in(numbers))
    return asked


@pytest.mark.parametrize("page", PAGES)
def test_every_test_names_the_equations_of_its_row(page):
    missing = {}
    for (path, name), asked in equations_of_tests(page).items():
        source = sources_in(path)[name]
        left = {(paper, n) for paper, n in asked if n not in named_in(source, paper)}
        if left:
            missing[f"{path.name}::{name}"] = sorted(left)
    assert missing == {}
