from __future__ import annotations

import re
from pathlib import Path

import pytest

from dqreg.errors import InputError, MissingDependencyError
from dqreg.report.html import render
from dqreg.report.page_file import VARIABLE, page_path, to_pdf, write_page
from tests.report.browser import CHROMIUM


def test_a_page_ends_in_html_or_pdf(tmp_path: Path) -> None:
    write_page(tmp_path / "a.html", "<p>")
    assert (tmp_path / "a.html").read_text() == "<p>"
    with pytest.raises(InputError, match=r"ends in \.html or \.pdf; got '\.docx'"):
        page_path(tmp_path / "a.docx")


def test_without_a_browser_a_pdf_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("dqreg.report.page_file.PLACES", ())
    with pytest.raises(MissingDependencyError, match="Chromium, Chrome or Edge"):
        page_path(tmp_path / "a.pdf")
    monkeypatch.setenv(VARIABLE, "no-such-browser")
    with pytest.raises(MissingDependencyError, match="no-such-browser"):
        page_path(tmp_path / "a.pdf")


def test_a_browser_that_prints_nothing_is_an_error_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "true")
    with pytest.raises(MissingDependencyError, match="printed no PDF"):
        write_page(tmp_path / "a.pdf", "<p>")
    assert not (tmp_path / "a.pdf").exists()


def test_each_printed_page_names_its_file() -> None:
    page = render("compare.html", title='a"b</style>', note="", command="", tables=[], plots=[])
    assert r'@bottom-left { content: "Comparison\3a  a\22 b\3c \2f style\3e "; }' in page
    assert "counter(pages)" in page


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to print with")
@pytest.mark.parametrize(("name", "width", "height"), [("letter", 612, 792), ("", 595, 842)])
def test_a_page_is_printed_on_as_many_sheets_of_a4_or_letter_as_it_needs(
    monkeypatch: pytest.MonkeyPatch, name: str, width: int, height: int
) -> None:
    """Sizes in points, 1/72 inch, as the file itself says them."""
    monkeypatch.setenv("DQREG_PAPER", name)
    page = "<!DOCTYPE html><html><head><style>@page { size: A4; }</style></head>"
    found = to_pdf(f"{page}<body><p>one</p><p style='break-before: page'>two</p></body></html>")
    assert found.startswith(b"%PDF")
    assert re.search(rb"/Count 2\b", found)
    box = re.search(rb"/MediaBox\s*\[\s*0\s+0\s+([\d.]+)\s+([\d.]+)", found)
    assert box is not None
    assert [float(number) for number in box.groups()] == pytest.approx([width, height], abs=1.0)


def test_another_paper_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DQREG_PAPER", "legal")
    monkeypatch.setattr("dqreg.report.page_file.browser", lambda: "browser")
    with pytest.raises(InputError, match="a4 or letter"):
        page_path(tmp_path / "report.pdf")
