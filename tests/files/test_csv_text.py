"""Tables as CSV: a spreadsheet runs nothing of them, and they come back as they were."""

from __future__ import annotations

import csv
import io

from hypothesis import given
from hypothesis import strategies as st

from dqreg.files.csv_text import csv_rows, csv_text

BEGINNINGS = "=+-@\t\r\n\uff1d\uff0b\uff0d\uff20"


@given(st.lists(st.text(alphabet=BEGINNINGS + "',;\" ab1", max_size=6), min_size=1, max_size=4))
def test_no_word_is_a_formula_and_each_comes_back(words):
    head = [f"c{k}" for k in range(len(words))]
    text = csv_text(head, [words])
    rows = list(csv.reader(io.StringIO(text, newline="")))
    for cell in rows[1]:
        if cell.startswith(tuple(BEGINNINGS)):
            float(cell)
    assert list(csv_rows(text)) == [dict(zip(head, words, strict=True))]


def test_numbers_stay_numbers_and_formulas_are_words():
    words = ["=cmd|' /C calc'!A0", "@SUM(1)", "+0.1/-0.05", "-0.5", "+3e-2", "a=b", "'=x"]
    text = csv_text(["=head"], [[each] for each in [*words, -0.25, 7]])
    cells = [cell for (cell,) in csv.reader(io.StringIO(text))]
    assert cells == ["'=head", *(f"'{each}" for each in words[:3]), "-0.5", "+3e-2", "a=b", "''=x", "-0.25", "7"]
