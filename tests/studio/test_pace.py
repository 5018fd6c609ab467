"""Two million points on half a million triangles turn smoothly without a graphics card."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")

from dqreg.files import write_cloud
from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose, twist
from tests.studio.studio_page import browsing, opened, running

pytestmark = pytest.mark.soak
# Half a turn in so many seconds, driven by the page's own frames as a drag is.
SECONDS, DEGREES = 3.0, 180.0
TURN = """async ([seconds, degrees]) => {
  const stage = studio.stage, began = performance.now(), yaw = stage.yaw, draw = stage.drawNow;
  let frames = 0;
  stage.drawNow = function () { draw.call(this); frames++; };
  await new Promise(done => {
    const step = () => {
      const t = (performance.now() - began) / 1000;
      if (t > seconds) { done(); return; }
      stage.hurry(); stage.yaw = yaw + degrees * t / seconds; stage.draw();
      requestAnimationFrame(step);
    };
    step();
  });
  const took = (performance.now() - began) / 1000;
  delete stage.drawNow;
  return frames / took;
}"""


def lumpy(rows: int) -> Mesh:
    """A bent ring with bumps: no plane that a simplified surface could be made of."""
    u, v = np.meshgrid(*[np.arange(rows) * 2 * np.pi / rows] * 2, indexing="ij")
    r = 12 + np.sin(5 * u) * np.cos(3 * v) + 0.3 * np.sin(23 * u + 7 * v)
    wide, long = 40 + 5 * np.cos(3 * u) + r * np.cos(v), 30 + r * np.cos(v)
    places = np.stack([wide * np.cos(u), long * np.sin(u), r * np.sin(v) + 3 * np.sin(2 * u)], -1).reshape(-1, 3)
    a = np.arange(rows * rows).reshape(rows, rows)
    b, d = np.roll(a, -1, 0), np.roll(a, -1, 1)
    c = np.roll(b, -1, 1)
    return Mesh(places, np.concatenate([np.stack(each, -1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))]))


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    import trimesh

    folder, part, rng = tmp_path_factory.mktemp("large"), lumpy(500), np.random.default_rng(0)
    trimesh.Trimesh(part.vertices, part.faces, process=False).export(folder / "part.stl")
    points = sample_mesh(part, 2_000_000, rng).points + rng.normal(0.0, 0.02, (2_000_000, 3))
    T = twist.exp(np.array([0.3, -0.2, 0.4, 20.0, 5.0, -7.0]))
    write_cloud(folder / "scan.ply", pose.apply(pose.inverse(T), points))
    return folder


def test_two_million_points_on_half_a_million_triangles_turn(large):
    files = large / "scan.ply", large / "part.stl"
    with running(*files) as address, browsing() as browser, opened(browser, address) as page:
        facts = page.evaluate("[studio.results.scan.points, studio.results.part.triangles]")
        assert facts == [2_000_000, 500_000]
        page.evaluate("Object.assign(studio.stage.layers, {part: false, scan: false})")
        bare = max(page.evaluate(TURN, [SECONDS, DEGREES]) for _ in range(2))
        page.evaluate("Object.assign(studio.stage.layers, {part: true, scan: true})")
        page.evaluate(TURN, [SECONDS, DEGREES])
        turned = max(page.evaluate(TURN, [SECONDS, DEGREES]) for _ in range(2))
        page.wait_for_timeout(1500)
        words = page.inner_text("#drawn")
    assert "of 2,000,000 points" in words
    assert "While the view moves:" in words
    if bare < 25.0:
        pytest.skip(
            f"this machine shows an empty view {bare:.0f} times a second: too busy to tell; {turned:.0f}: {words}"
        )
    assert turned >= 20.0, words
