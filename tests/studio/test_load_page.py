"""The first two steps in a browser: what two files get wrong is told before it costs anything; the reach is seen."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")

from dqreg.files import write_cloud
from dqreg.geometry.opening import as_geometry
from dqreg.rigid import pose
from tests.studio.studio_page import BRACKET, browsing, busy_over, drop, keep_picture, opened, running

pytestmark = pytest.mark.soak
TRUTH = np.array(json.loads((BRACKET / "truth.json").read_text())["T_target_source"])


@pytest.fixture(scope="module")
def browser():
    with browsing() as started:
        yield started


def test_a_mirrored_scan_is_told_before_it_is_aligned(browser, tmp_path):
    scan = as_geometry(BRACKET / "scan.ply", "scan")
    write_cloud(tmp_path / "left.ply", scan.points * [1.0, 1.0, -1.0])
    with running() as address, opened(browser, address) as page:
        drop(page, BRACKET / "part.stl", tmp_path / "left.ply")
        page.wait_for_selector("#unnamed")
        busy_over(page)
        # Not before the one question about units is answered.
        assert page.query_selector("#mirrored") is None
        page.click("#unit-mm")
        page.wait_for_selector("#mirrored")
        keep_picture(page, "studio_mirrored")
        page.click("#mirror")
        page.wait_for_selector("#is-mirrored")
        busy_over(page)
        page.click("#step-align")
        page.click("#align")
        page.wait_for_selector("#verdict")
        busy_over(page)
        T = np.array(page.evaluate("studio.results.align.T"))
        assert page.evaluate("studio.results.align.level") == "accepted"
        # The mirror that was taken is the x axis; the scan was made with the z axis.
        flipped = np.diag([-1.0, 1.0, -1.0, 1.0])
        ends = pose.apply(pose.inverse(TRUTH), np.array([[0.0, 0.0, 0.0], [120.0, 80.0, 60.0]]))
        # The noise of the scan is 0.05 mm; a fifth of it is asked.
        np.testing.assert_allclose(pose.apply(T @ flipped, ends), pose.apply(TRUTH, ends), atol=0.01)
        assert "left_cleaned.ply" in page.evaluate("studio.words.align.command")
        page.click("#step-load")
        page.click("#unmirror")
        page.wait_for_selector("#mirrored")
        assert page.evaluate("studio.visit.mirrored") is False


def test_a_right_scan_is_asked_nothing(browser):
    with running(BRACKET / "scan.ply", BRACKET / "part.stl") as address, opened(browser, address) as page:
        page.click("#unit-mm")
        page.wait_for_function("() => studio.results.mirror !== undefined")
        assert page.evaluate("studio.results.mirror") == {"mirrored": False}
        assert page.query_selector("#panel .ask") is None


@pytest.mark.real
def test_the_files_of_the_tee_the_wrong_way_round(browser, real_data):
    tee = real_data / "weld_tee_scan_cad"
    with running() as address, opened(browser, address) as page:
        # Each on the field of the other one.
        drop(page, tee / "tee_nominal.stl", on=".zone[data-side=scan]")
        busy_over(page)
        drop(page, tee / "table_8in10in_tee_x4y24_45.pcd", on=".zone[data-side=part]")
        page.wait_for_selector("#swapped")
        busy_over(page)
        words = page.inner_text("#panel")
        assert "The scan is a surface and the part is a cloud of points." in words
        assert "cloud without normals" in words
        page.click("#swap")
        page.wait_for_selector("#swapped", state="detached")
        busy_over(page)
        assert page.evaluate("studio.visit.scan.name") == "table_8in10in_tee_x4y24_45.pcd"
        assert "none in the file; estimated where needed" in page.inner_text("#panel")
        # A part of 0.26 is rather in metres than in millimetres.
        page.wait_for_selector("#unit-m.main")


@pytest.mark.real
def test_two_surfaces_the_wrong_way_round(browser, real_data):
    # A merged scan with holes as the part, and the closed CAD surface as the scan.
    with running() as address, opened(browser, address) as page:
        drop(page, real_data / "trimesh_cad" / "featuretype.STL", on=".zone[data-side=scan]")
        busy_over(page)
        drop(page, real_data / "stanford_bunny_range" / "bun_zipper.ply", on=".zone[data-side=part]")
        page.wait_for_selector("#swapped")
        busy_over(page)
        assert "The scan is a closed surface, as CAD is, and the part an open one" in page.inner_text("#panel")
        assert "not watertight" in page.inner_text("#panel")


def test_the_reach_is_seen_on_the_part(browser):
    with running(BRACKET / "scan.ply", BRACKET / "part.stl") as address, opened(browser, address) as page:
        page.click("#step-clean")
        page.wait_for_selector("#reach-later")
        page.click("#step-align")
        page.click("#align")
        page.wait_for_selector("#verdict")
        busy_over(page)
        page.click("#step-clean")
        page.click("#reach-shown")
        page.wait_for_selector("#reach-panel")
        busy_over(page)
        found = page.evaluate("studio.results.reach")
        assert sum(found["counts"][key] for key in ("on_part", "beyond_reach", "other_surfaces", "outliers")) == 60_194
        assert found["from"] in ("noise", "spacing", "deviations")
        assert "Another length can be written here" in page.inner_text("#reach-said")
        keep_picture(page, "studio_reach")
        # The colours that are drawn are those of the counts.
        drawn = page.evaluate("[1, 2, 3, 4, 5].map(k => studio.stage.scene.on.codeBytes.filter(c => c === k).length)")
        assert drawn == [found["counts"][key] for key in
                         ("on_part", "beyond_reach", "other_surfaces", "outliers", "excluded")]  # fmt: skip
        page.fill("#reach-of", "0.03")
        page.keyboard.press("Enter")
        page.wait_for_function("() => studio.results.reach?.reach === 0.03")
        busy_over(page)
        assert "as you wrote" in page.inner_text("#reach-said")
        less = page.evaluate("studio.results.reach.counts")
        assert less["on_part"] < found["counts"]["on_part"]
        # It is the reach that deviations are measured with.
        page.click("#step-judge")
        page.wait_for_selector("#worst-0")
        busy_over(page)
        assert page.evaluate("studio.results.judge.counts") == less
        page.click("#kinds")
        page.wait_for_selector("#reach-panel")
        page.click("#kinds")
        page.wait_for_selector("#reach-panel", state="detached")
