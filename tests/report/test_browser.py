"""The report in a headless Chromium: what a customer sees, checked by pixels and by clicks."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.rigid import twist
from dqreg.trust.records import Alternative
from tests.report.browser import CHROMIUM, Browser
from tests.report.scenes import T_START, bumpy, failed

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to open the report with")
DESK, PHONE = (1280, 900), (390, 844)
# Of the same layout, for what no size changes: Chromium draws without a graphics card, pixel by pixel, on every core.
SMALL = (660, 440)


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    result = bumpy()
    turned = twist.exp(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])) @ result.T_target_source
    with pytest.MonkeyPatch.context() as patch:
        # The picture for print has its own tests.
        patch.setattr("dqreg.report.page.PANEL_WIDTH", 200)
        patch.setattr("dqreg.report.page.PANEL_HEIGHT", 150)
        return _written(result, turned, tmp_path_factory)


def _written(result, turned, tmp_path_factory) -> Path:
    with_other = dataclasses.replace(result, alternatives=(Alternative(turned, 1.0),))
    return with_other.report(tmp_path_factory.mktemp("report") / "report.html", 0.2, start=T_START)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    opened = Browser(tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


def colours_in(image: np.ndarray) -> int:
    # Each colour as one number: rows take seconds to sort.
    return len(np.unique(image // 16 @ [1, 256, 256**2]))


def changed(a: np.ndarray, b: np.ndarray) -> float:
    """Share of the pixels that differ clearly."""
    return float((np.abs(a.astype(int) - b.astype(int)).max(axis=2) > 24).mean())


@pytest.mark.parametrize(("size", "dark", "phone"), [(DESK, False, False), (PHONE, True, True)])
def test_opens_without_complaint_and_draws(browser, report, size, dark, phone):
    browser.open(report, *size, dark=dark, phone=phone)
    assert browser.complaints() == []
    assert browser.fetched() == []
    text = browser.run("document.body.innerText")
    assert "Alignment: trusted" in text
    assert bumpy().verdict.reasons[0] in text
    # Nothing is wider than the window: no sideways scrolling on a phone.
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    for canvas in ("#view3d canvas", "#sure3d canvas"):
        assert colours_in(browser.image(canvas)) > 20
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") is not dark


def test_controls_work_by_clicks(browser, report):
    browser.open(report, *SMALL)
    view = "#view3d canvas"
    first = browser.image(view)
    # Each of these must change what is drawn, and its counterpart must bring it back.
    toggles = {
        "input[data-layer=part]": "input[data-layer=part]",
        "input[data-layer=scan]": "input[data-layer=scan]",
        "input[data-layer=off]": "input[data-layer=off]",
        "input[data-layer=labels]": "input[data-layer=labels]",
        "input[name=colour][value=plain]": "input[name=colour][value=deviation]",
        "input[name=pose][value='0']": "input[name=pose][value='1']",
        "input[name=pose][value='2']": "input[name=pose][value='1']",
    }
    for there, back in toggles.items():
        browser.click(there)
        assert changed(first, browser.image(view)) > 0.0005, there
        browser.click(back)
        assert changed(first, browser.image(view)) < 1e-4, back
    assert browser.run("document.querySelector('#pose-said').textContent") == "After registration"
    browser.drag(view, 120.0, 40.0)
    assert changed(first, browser.image(view)) > 0.05
    assert browser.complaints() == []


def test_a_table_row_leads_to_its_place(browser, report):
    browser.open(report, *SMALL)
    first = browser.image("#view3d canvas")
    browser.click("[data-goto]")
    assert changed(first, browser.image("#view3d canvas")) > 0.1
    assert browser.run("document.querySelectorAll('.badge.pin').length") == 1


@pytest.mark.parametrize(("width", "height"), [DESK, (1000, 700), PHONE])
def test_buttons_of_rows_are_seen_without_scrolling_sideways(browser, report, width, height):
    browser.open(report, width, height)
    edges = browser.run("[...document.querySelectorAll('.goto button')].map(b => b.getBoundingClientRect().right)")
    assert len(edges) > 6
    assert max(edges) <= width


def test_copy_hands_over_the_matrix(browser, report):
    browser.open(report, *SMALL)
    browser.click("[data-copy=form1]")
    said = browser.run(
        "new Promise(done => setTimeout(() => done(document.querySelector('[data-copy=form1]').textContent), 50))"
    )
    assert said == "Copied"
    text = browser.run("document.querySelector('#form1').textContent")
    np.testing.assert_array_equal(
        np.array([row.split() for row in text.splitlines()], dtype=float), bumpy().T_target_source
    )


def test_prints_on_few_pages(browser, report):
    browser.open(report, *SMALL, dark=True)
    pdf = browser.pdf()
    assert pdf.startswith(b"%PDF")
    assert 2 <= pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") <= 8


def test_a_failure_opens_too(browser, tmp_path):
    browser.open(failed().report(tmp_path / "failed.html"), *PHONE, phone=True)
    assert browser.complaints() == []
    assert "Alignment: failed" in browser.run("document.body.innerText")


def test_a_cell_of_a_notebook_shows_the_live_view(browser, tmp_path):
    """In a frame of its own, as a notebook shows it: it draws, turns when dragged, and asks for nothing."""
    cell = bumpy().view(0.2, height=620, start=T_START)
    page = tmp_path / "notebook.html"
    page.write_text(f"<!DOCTYPE html><body>{cell._repr_html_()}</body>", encoding="utf-8")
    browser.open(page, *SMALL)
    first = browser.image_once(lambda image: colours_in(image[250:550]) > 20, "iframe")
    assert colours_in(first[250:550]) > 20
    assert browser.complaints() == []
    assert browser.fetched() == []
    browser.drag("iframe", 120, 40)
    dragged = browser.image_once(lambda image: changed(first, image) > 0.02, "iframe")
    assert changed(first, dragged) > 0.02


def test_a_cell_is_refused_without_its_sides_and_is_no_report():
    cell = bumpy().view(height=300)
    assert repr(cell) == "Cell(300 pixels high)"
    assert "data:image/jpeg" not in cell.html
    with pytest.raises(InputError, match="does not hold the scan"):
        dataclasses.replace(bumpy(), inputs=None).view()
    for height in (0, True, 1e3, "tall"):
        with pytest.raises(InputError, match="whole number of pixels"):
            bumpy().view(height=height)
