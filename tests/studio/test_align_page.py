"""The third step in a browser, with the mouse: datums and reference points clicked, the scan dragged, the slider."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")

from tests.studio.studio_page import BRACKET, browsing, busy_over, click_at, keep_picture, opened, running

pytestmark = pytest.mark.soak
# Places of the bracket (mm) on its three datums: the base from above, the upright's front, the side.
TOP, FRONT, SIDE = (60.0, 20.0, 10.0), (90.0, 0.0, 5.0), (120.0, 20.0, 5.0)


@pytest.fixture(scope="module")
def aligned():
    """The bracket on its part, in a page that goes through all tests of this file."""
    files = BRACKET / "scan.ply", BRACKET / "part.stl"
    with running(*files) as address, browsing() as browser, opened(browser, address) as page:
        page.click("#step-align")
        page.click("#align")
        page.wait_for_selector("#verdict")
        busy_over(page)
        yield page


def visit(page) -> dict:
    return page.evaluate("studio.visit")


def look(page, yaw: float, pitch: float) -> None:
    page.evaluate("([yaw, pitch]) => { Object.assign(studio.stage, {yaw, pitch}); studio.stage.fit(); }", [yaw, pitch])
    page.wait_for_timeout(400)


def choose(page, way: str) -> None:
    if not page.locator("#datums[open]").count():
        page.click("#datums summary")
    page.click(f"#by-{way}")
    page.wait_for_function("way => studio.visit.alignment === way", arg=way)
    busy_over(page)
    page.wait_for_timeout(300)


def face_at(page, point) -> int:
    """Number of the face whose plane holds a place, of those that have it in their box."""
    faces = page.evaluate("studio.results.part.faces")
    flat = [f for f in faces if f["kind"] == "plane"]
    off = [abs(np.dot(np.subtract(point, f["centre"]), f["axis"])) for f in flat]
    return int(min(zip(off, (f["number"] for f in flat), strict=True))[1])


def test_the_traffic_light_says_why(aligned):
    words = aligned.inner_text("#verdict")
    assert "Alignment: trusted" in words
    assert "The pose can be used." in words
    found = aligned.evaluate("studio.results.align")
    assert found["reasons"][0] in words
    assert f"{100 * found['inliers']:.0f}\u00a0% of the scan lies on the part" in words
    assert aligned.evaluate("getComputedStyle(document.querySelector('#verdict .word')).color") == "rgb(0, 121, 90)"


def test_the_slider_goes_from_before_to_after(aligned):
    found = aligned.evaluate("studio.results.align")
    last, box = len(found["history"]), aligned.locator("#before-after").bounding_box()
    x, y = box["x"] + box["width"] - 8, box["y"] + box["height"] / 2
    aligned.mouse.move(x, y)
    aligned.mouse.down()
    seen = []
    for share in (0.75, 0.5, 0.25, 0.0):
        aligned.mouse.move(box["x"] + 8 + share * (box["width"] - 16), y, steps=3)
        seen.append(aligned.evaluate("[studio.step_state.at, studio.stage.T, studio.stage.layers.before]"))
    aligned.mouse.up()
    assert [at for at, _, _ in seen] == sorted((at for at, _, _ in seen), reverse=True)
    assert seen[-1][0] == 0
    assert seen[-1][2]
    np.testing.assert_allclose(seen[-1][1], aligned.evaluate("studio.results.compare.poses.beside"))
    middle = seen[1][0]
    np.testing.assert_allclose(seen[1][1], found["history"][middle]["drawn"])
    aligned.focus("#before-after")
    aligned.keyboard.press("End")
    assert aligned.evaluate("studio.step_state.at") == last
    np.testing.assert_allclose(aligned.evaluate("studio.stage.T"), found["drawn"])


def test_datums_are_clicked(aligned):
    page = aligned
    choose(page, "datums")
    # Three planes that were scanned are suggested; now others are clicked, in their order.
    assert len(visit(page)["datums"]) == 3
    look(page, 40.0, 35.0)
    clicked = []
    for k, place in enumerate((TOP, FRONT, SIDE)):
        page.click(f"#aim-{k}")
        click_at(page, "main", place, "part")
        clicked.append(face_at(page, place))
        page.wait_for_function("([k, face]) => studio.visit.datums[k] === face", arg=[k, clicked[-1]])
    assert visit(page)["datums"] == clicked
    assert page.locator("#main3d .badge.pair").all_inner_texts() == ["A", "B", "C"]
    keep_picture(page, "studio_datums")
    # The judgement rests on them: the plane of A has no mean deviation left.
    page.click("#step-judge")
    page.wait_for_selector("#worst-0")
    busy_over(page)
    rows = {row["number"]: row for row in page.evaluate("studio.results.judge.faces")}
    assert abs(rows[clicked[0]]["median"]) < 0.01
    page.click("#step-align")
    page.wait_for_timeout(500)


def test_reference_points_are_clicked(aligned):
    page = aligned
    choose(page, "points")
    look(page, 40.0, 35.0)
    places = [(40.0, 10.0, 10.0), (105.0, 10.0, 10.0), (105.0, 70.0, 10.0), (40.0, 0.0, 5.0), (100.0, 0.0, 5.0), SIDE]
    for k, place in enumerate(places):
        click_at(page, "main", place, "part")
        page.wait_for_function("count => studio.visit.references.length === count", arg=k + 1)
    held = visit(page)["references"]
    # A click hits the place to a few pixels, of a third of a millimetre each; on its face exactly.
    np.testing.assert_allclose([each["point"] for each in held], places, atol=1.5)
    np.testing.assert_allclose([each["point"][2] for each in held[:3]], 10.0, atol=1e-3)
    np.testing.assert_allclose([each["normal"] for each in held[:3]], [[0, 0, 1]] * 3, atol=1e-6)
    # Drawn with the next frame.
    page.wait_for_function("() => document.querySelectorAll('#main3d .badge.pair').length === 6")
    keep_picture(page, "studio_points")
    page.click("#no-points")
    page.wait_for_function("() => studio.visit.references.length === 5")
    page.click("#step-judge")
    page.locator("#said p", has_text="six reference points hold the part; there are 5").wait_for()
    page.click("#step-align")
    page.wait_for_timeout(500)
    look(page, 40.0, 35.0)
    click_at(page, "main", SIDE, "part")
    page.wait_for_function("() => studio.visit.references.length === 6")
    page.click("#step-judge")
    page.wait_for_selector("#worst-0")
    busy_over(page)
    page.click("#step-align")
    choose(page, "best-fit")


def test_the_scan_is_dragged_with_a_locked_height(aligned):
    page = aligned
    page.click("label:has(#way-hand)")
    page.wait_for_timeout(400)
    page.evaluate("() => { Object.assign(studio.stage, {yaw: 0, pitch: 90}); studio.stage.fit(); }")
    page.click("label:has(#hand-shift)")
    page.wait_for_timeout(300)
    before = np.array(page.evaluate("studio.stage.T")).reshape(3, 4)
    box = page.locator("#main3d canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 20, y - 10, steps=5)
    page.mouse.up()
    after, size = np.array(page.evaluate("studio.stage.T")).reshape(3, 4), page.evaluate("studio.stage.perSize")
    # Seen from above the drawing follows the pointer, and turns by nothing.
    np.testing.assert_allclose(after[:, 3] - before[:, 3], [20.0 / size, 10.0 / size, 0.0], atol=1e-9)
    np.testing.assert_array_equal(after[:, :3], before[:, :3])
    page.click("label:has(#hand-turn)")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 5, y, steps=3)
    page.mouse.up()
    turned = np.array(page.evaluate("studio.stage.T")).reshape(3, 4)
    assert np.abs(turned[:, :3] - after[:, :3]).max() > 0.01
    page.click("#locks summary")
    for motion in ("tz", "rx", "ry", "rz"):
        page.uncheck(f"#dof-{motion}")
        page.wait_for_function("motion => !studio.visit.dof.split(' ').includes(motion)", arg=motion)
    page.click("#align-hand")
    page.wait_for_selector("#busy")
    busy_over(page)
    found = page.evaluate("({visit: studio.visit, T: studio.results.align.T})")
    start, T = np.array(found["visit"]["T_start"]), np.array(found["T"])
    assert found["visit"]["dof"] == "tx ty"
    np.testing.assert_allclose(T[:3, :3], start[:3, :3], atol=1e-9)
    # The height is that of the place about which motions are locked, to rounding.
    assert abs((T - start)[2, 3]) < 1e-6
    assert np.linalg.norm((T - start)[:2, 3]) > 0.1
