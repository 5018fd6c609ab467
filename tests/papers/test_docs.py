from __future__ import annotations

import ast
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
