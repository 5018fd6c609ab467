"""The table of a batch in a browser: it fills while the batch runs, and a row opens its part."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")

from tests.studio.studio_page import BRACKET, ROOT, browsing, busy_over, keep_picture, opened, running

pytestmark = pytest.mark.soak
# The file of the last row is not there.
ROWS = (
    "name,scan,target\none,one.ply,part.stl\ntwo,two.ply,part.stl\nthree,three.ply,part.stl\ngone,gone.ply,part.stl\n"
)

PLAN = """units = "mm"
alignment = "best-fit"
tolerance = 0.15
[head]
part = "bracket"
[[datum]]
name = "A"
near = [60, 40, 10]
[[face]]
face = 2
tolerance = 0.3
[[characteristic]]
name = "flatness of A"
kind = "form"
near = [60, 40, 10]
tolerance = 0.3
"""


def test_the_table_fills_while_the_batch_runs_and_a_row_opens_its_part(tmp_path):
    for name in ("one", "two", "three"):
        shutil.copy(BRACKET / "scan.ply", tmp_path / f"{name}.ply")
    shutil.copy(BRACKET / "part.stl", tmp_path)
    (tmp_path / "rows.csv").write_text(ROWS)
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "out").mkdir()
    with running("--batch", tmp_path / "out") as address, browsing() as browser, opened(browser, address) as page:
        page.locator("#many-said", has_text="0 done so far").wait_for()
        line = [sys.executable, "-m", "dqreg", "batch", "rows.csv", "--out", "out", "--workers", "1", "--quiet",
                "--source-units", "mm", "--target-units", "mm", "--plan", "plan.toml"]  # fmt: skip
        batch = subprocess.Popen(line, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
        try:
            page.locator("#row-one").wait_for()
            # Rows are there while others are still to come.
            assert "so far" in page.inner_text("#many-said")
            page.locator("#many-said", has_text="4 done:").wait_for()
        finally:
            batch.wait(timeout=300)
        assert page.locator("#many tbody tr").count() == 4
        assert "3 trusted" in page.inner_text("#many-said")
        assert page.locator("#row-gone").count() == 0
        keep_picture(page, "studio_many")
        page.click("#row-two")
        page.wait_for_selector("body[data-ready]")
        page.locator("#step-align[aria-current]").wait_for()
        busy_over(page)
        assert page.evaluate("studio.visit.scan.name") == "two.ply"
        # Under the pose that the batch found, without a click.
        page.wait_for_selector("#verdict")
        record = json.loads((tmp_path / "out" / "results" / "two.json").read_text())
        found = page.evaluate("studio.results.align")
        assert found["level"] == "accepted"
        np.testing.assert_allclose(found["T"], record["T_target_source"], atol=1e-3)
        # And under its plan: the figures of the page are those of the batch, without a click more than the step.
        page.click("#step-judge")
        page.wait_for_selector("#decision")
        busy_over(page)
        page.wait_for_selector("#characteristics")
        asked, judged = record["batch"]["inspection"], page.evaluate("studio.results.judge")
        assert judged["outcome"] == asked["outcome"]
        values = {row["name"]: row["value"] for row in asked["values"]}
        assert judged["characteristics"][0]["name"] == "flatness of A"
        # The pose is refined once more from where the batch left it.
        assert judged["characteristics"][0]["value"] == pytest.approx(values["flatness of A"], rel=1e-2)
        share = values["points within the tolerance"]
        assert 100.0 * judged["decision"]["share_within"] == pytest.approx(share, abs=0.05)
        assert page.input_value("#tolerance") == "0.15"
        assert page.evaluate("studio.visit.head") == [["part", "bracket"]]
        assert "characteristic" in page.evaluate("studio.visit.plan")
        keep_picture(page, "studio_row")
