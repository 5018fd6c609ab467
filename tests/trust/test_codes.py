"""The codes of reasons: the same in the code that makes them, in the type that lists them and in the documents."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import get_args

import dqreg
from dqreg.inspection.decision.decision import SOLVED_SCALE, WALL_SIDE
from dqreg.trust.records import Code
from dqreg.trust.verdict import QUESTIONS

PACKAGE = Path(dqreg.__file__).parent
CODES = set(get_args(Code))


def test_the_documented_table_is_the_list_of_codes() -> None:
    text = (PACKAGE.parent / "docs" / "failures.md").read_text(encoding="utf-8")
    # A code of many scans may mean something of its own: each table names it once.
    tables = [re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE) for part in text.split("\n|---")]
    # A decision has codes of its own.
    assert {code for table in tables for code in table} == CODES | {WALL_SIDE, SOLVED_SCALE}
    assert all(len(table) == len(set(table)) for table in tables)


def test_every_code_is_made_somewhere() -> None:
    source = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if path.name != "records.py")
    assert {code for code in CODES if f'"{code}"' not in source} == set()
    assert {question.code for question in QUESTIONS} <= CODES


def test_sets_of_codes_stand_in_one_place() -> None:
    # Who adds a code decides there in which it belongs.
    found = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.name != "code_sets.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Set) and CODES.issuperset(getattr(each, "value", None) for each in node.elts)
    ]
    assert found == []


def test_no_file_reads_a_sentence_back() -> None:
    reading = re.compile(
        r"\b(words|reason|reasons\[\d+\]|sentence|remark|doubt|status)\.(startswith|endswith|r?partition|r?split|find|index"
        r"|removeprefix|removesuffix)\(|\"[^\"]+\" in (\w+\.)*(words|reason|reasons|sentence|remark|doubt|status)\b"
    )
    found = [
        f"{path.relative_to(PACKAGE)}: {line.strip()}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if reading.search(line)
    ]
    assert found == []
