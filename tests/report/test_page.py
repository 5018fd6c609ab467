from __future__ import annotations

import base64
import dataclasses
import json
import re

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.inspection import Inspection
from dqreg.inspection.plan.file import plan_of
from dqreg.report.page import to_html
from dqreg.trust.records import Alternative, Verdict
from tests.report.scenes import T_START, bumpy, data_of, failed

SCENE = re.compile(r'<script type="application/json" id="scene">(.*?)</script>', re.S)


@pytest.fixture(autouse=True, scope="module")
def small_pictures():
    # What is tested here is the text; the pictures have their own tests.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dqreg.report.page.PANEL_WIDTH", 120)
        patch.setattr("dqreg.report.page.PANEL_HEIGHT", 90)
        yield


@pytest.fixture(scope="module")
def page(small_pictures) -> str:
    return to_html(bumpy(), data_of(bumpy(), 0.2))


def test_says_verdict_reasons_and_numbers_of_the_result(page):
    result = bumpy()
    assert "✓ Alignment: trusted" in page
    assert all(reason in page for reason in result.verdict.reasons)
    assert f"{result.rms:.3g} mm" in page
    assert all(repr(float(x)) in page for x in result.T_target_source[:3].ravel())


def test_loads_nothing(page):
    # Namespaces and the page's own fragments are no addresses that are fetched.
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", page)
    assert "://" not in page
    assert "@import" not in page
    assert "url(" not in page


def test_is_written_whole_and_small(tmp_path):
    path = bumpy().report(tmp_path / "report.html", 0.2, start=T_START)
    text = path.read_text(encoding="utf-8")
    assert text.rstrip().endswith("</html>")
    assert path.stat().st_size < 2e6


def test_tolerance_table_counts_the_same_points_as_the_record(page):
    bands = bumpy().deviations(0.2).bands()
    for row in bands.rows:
        assert f'<td class="n">{row.count:,}</td>' in page


def test_a_bump_fails_the_part_though_nearly_all_points_are_within():
    # The bump of 0.8 mm covers 2 % of the points; 0.2 mm are four sigma of the noise.
    data = data_of(bumpy(), 0.2)
    assert data.decision is not None
    assert data.decision.share_within > 0.95
    page = to_html(bumpy(), data)
    assert "✗ Part against ±0.2 mm: fail" in page
    assert "✓ Alignment: trusted" in page
    # What the page says over all is the worst of what it says of the regions.
    assert data.decision.outcome == "fail" in {region.outcome for region in data.regions}


def test_a_plan_chooses_the_parts_of_the_page_but_not_what_is_signed():
    result = bumpy()
    data = data_of(result, 0.2)
    plan = plan_of({"tolerance": 0.2, "report": {"parts": ["deviations", "pose"]}})
    inspection = Inspection("fail", (), None, plan, decision=data.decision)
    page = to_html(result, data, inspection, {"serial": "0007"})
    heads = re.findall(r'<h2 id="([a-z0-9-]+)"', page)
    assert heads == ["plan-head", "dev-head", "pose-head", "conv-head"]
    for words in ("✗ Part against ±0.2 mm: fail", "Alignment: trusted", "0007", "Scan and target"):
        assert words in page
    # Without the view there is nothing to show a place in.
    assert 'data-goto="' not in page
    assert '<script type="application/json" id="scene">' not in page


def test_no_tolerance_passes_nothing():
    page = to_html(bumpy(), data_of(bumpy()))
    assert "No tolerance was given" in page
    assert "Part against" not in page
    assert "✓ pass" not in page


def test_a_failure_is_explained():
    page = to_html(failed(), data_of(failed()))
    assert "✗ Alignment: failed" in page
    assert all(reason in page for reason in failed().verdict.reasons)
    assert "What to try" in page
    # The scan stands 1e4 sqrt(3) from the target.
    assert "17320" in page
    assert "T_target_source, 4x4" not in page


def test_without_its_sides_the_page_says_how_to_get_them():
    page = to_html(dataclasses.replace(bumpy(), inputs=None), None)
    assert "attached(scan, target)" in page
    assert not SCENE.search(page)
    assert "T_target_source, 4x4" in page


def test_a_length_of_no_known_unit_leaves_no_gap_behind_it():
    result = bumpy()
    nameless = dataclasses.replace(result, settings={**result.settings, "target_units": None, "units": None})
    page = to_html(nameless, dataclasses.replace(data_of(bumpy(), 0.2), unit=""))
    assert "lengths are in the unit of the target" in page
    text = re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]*>", "", page, flags=re.S)
    assert not re.findall(r"[0-9] +[,:;.]", text)


def test_escapes_every_string_from_outside():
    evil = "<script>alert('x')</script>&\"'</script>"
    result = bumpy()
    settings = result.settings | {"source": f"a/{evil}", "target": evil, "target_units": evil, evil: evil}
    history = tuple(dataclasses.replace(record, stage=evil) for record in result.history)
    other = Alternative(result.T_target_source, 1.0)
    spoilt = dataclasses.replace(
        result,
        settings=settings,
        history=history,
        status=evil,
        verdict=Verdict("suspect", (evil,)),
        alternatives=(other,),
        timings=result.timings | {evil: 1.0},
        observability=tuple(dataclasses.replace(d, words=evil) for d in result.observability),
    )
    page = to_html(spoilt, data_of(spoilt))
    assert "alert(" in page
    assert "<script>alert" not in page
    # The file's own three scripts and nothing else.
    assert page.count("</script") == 3
    assert json.loads(SCENE.search(page).group(1))["unit"] == evil


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf, "0.1", True])
def test_refuses_tolerances_that_are_no_lengths(tmp_path, tolerance):
    with pytest.raises(InputError, match="tolerance must be a length"):
        bumpy().report(tmp_path / "r.html", tolerance)


def test_unwritable_is_told_before_the_work(tmp_path, monkeypatch):
    def work(*_, **__):
        raise AssertionError("began to work")

    monkeypatch.setattr("dqreg.report.page.collect", work)
    with pytest.raises(InputError, match="does not exist"):
        bumpy().report(tmp_path / "nowhere" / "report.html")


def test_scene_is_thinned_but_keeps_the_numbers():
    scene = json.loads(SCENE.search(to_html(bumpy(), data_of(bumpy()))).group(1))
    assert [pose["kind"] for pose in scene["poses"][:2]] == ["before", "after"]
    np.testing.assert_allclose(scene["poses"][1]["T"], np.eye(4)[:3].ravel(), atol=1e-12)
    # The bump of 0.8 mm is the worst place; about half a mm is what noise and strays can change.
    value = float(scene["labels"][0]["title"].split(": ")[1].split()[0].replace("−", "-"))
    assert abs(abs(value) - 0.8) < 0.2
    assert scene["on"]["count"] + scene["off"]["count"] <= 12_240


def test_before_pose_moves_the_drawn_points_to_where_they_were():
    data = data_of(bumpy())
    scene = json.loads(SCENE.search(to_html(bumpy(), data)).group(1))
    steps = np.frombuffer(base64.b64decode(scene["on"]["points"]), dtype="<u2").reshape(-1, 3)
    drawn = np.array(scene["on"]["low"]) + steps / 65535.0 * np.array(scene["on"]["extent"])
    T = np.array(scene["poses"][0]["T"]).reshape(3, 4)
    before = drawn @ T[:, :3].T + T[:, 3]
    assert data.deviations is not None
    expected = data.inputs.placed(T_START)[data.deviations.counted] / data.size
    # Steps of 16 bits along at most 1.2 sizes.
    np.testing.assert_allclose(before, expected, atol=2e-5)
