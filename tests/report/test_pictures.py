from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from dqreg.errors import InputError
from dqreg.geometry import Mesh
from dqreg.report.cameras import VIEWS, camera
from dqreg.report.colours import SOURCE, TARGET, rgb
from dqreg.report.figure import encode
from dqreg.report.page import notebook_html
from dqreg.report.pictures import PANEL_HEIGHT, PANEL_WIDTH, draw, parse_panels, save_picture
from dqreg.report.raster import FILL_SHARE, Dots, PartScene, frame_of
from dqreg.report.window import require_display, shapes_of
from dqreg.synth.parts import box
from tests.report.scenes import BUMP, bumpy, data_of, failed

RED = np.array([255, 0, 0], dtype=np.uint8)
# A box of 0.6 x 0.4 x 0.2 about zero, as large as a part is to the renderer.
PART = Mesh(*box((0.6, 0.4, 0.2)))


def is_red(image: np.ndarray) -> np.ndarray:
    return (image[..., 0] > 200) & (image[..., 1:] < 90).all(axis=-1)


def rendered(dots: np.ndarray, view: str = "top") -> np.ndarray:
    frame = frame_of(PART.vertices, VIEWS[view], 120, 90)
    return PartScene(PART, 1.0).render(frame, TARGET, "#ffffff", [Dots(dots, RED, 0.01)])


@pytest.mark.parametrize("view", sorted(VIEWS))
def test_cameras_are_right_handed(view):
    axes = camera(*VIEWS[view])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    # z points up, or away in a view along it.
    assert axes[1, 2] > -1e-12


def test_the_part_fills_its_share_of_the_picture():
    image = rendered(np.zeros((0, 3)))
    part = (image < 250).any(axis=2)
    # Seen from above it is 0.6 by 0.4; the width is what limits it in 120 x 90 pixels.
    columns, rows = part.any(axis=0).sum(), part.any(axis=1).sum()
    assert abs(columns - FILL_SHARE * 120) <= 2
    assert abs(rows - FILL_SHARE * 120 * 0.4 / 0.6) <= 2


def test_points_before_the_part_are_seen_and_those_behind_are_not():
    above, below = np.array([[0.1, 0.05, 0.3]]), np.array([[0.1, 0.05, -0.3]])
    assert is_red(rendered(above)).any()
    assert not is_red(rendered(below)).any()
    assert is_red(rendered(below, "bottom")).any()


def test_a_point_is_drawn_where_it_is():
    rows, columns = np.nonzero(is_red(rendered(np.array([[0.15, 0.1, 0.2]]))))
    # 0.9 of 120 pixels are 0.6 wide; x to the right, y up.
    scale = FILL_SHARE * 120 / 0.6
    assert columns.mean() == pytest.approx(60 - 0.5 + 0.15 * scale, abs=1.0)
    assert rows.mean() == pytest.approx(45 - 0.5 - 0.1 * scale, abs=1.0)


def test_nearer_points_hide_farther_ones():
    frame = frame_of(PART.vertices, VIEWS["top"], 120, 90)
    near, far = (Dots(np.array([[0.011, 0.013, z]]), c, 0.03) for z, c in ((0.4, RED), (0.3, RED[::-1].copy())))
    for layers in ([near, far], [far, near]):
        image = PartScene(PART, 1.0).render(frame, TARGET, "#ffffff", layers)
        assert is_red(image).any()
        assert not is_red(image[..., ::-1]).any()


def test_a_picture_shows_start_deviation_and_bump(tmp_path):
    data = data_of(bumpy(), 0.2)
    before = np.asarray(Image.open(io.BytesIO(encode(draw(data, parse_panels("before:iso"), 300, 220)))))[..., :3]
    orange = np.abs(before.astype(int) - rgb(SOURCE)).max(axis=2) < 30
    assert orange.mean() > 0.01
    after = np.asarray(Image.open(io.BytesIO(encode(draw(data, parse_panels("top"), 300, 220)))))[..., :3]
    # A bump of four tolerances has the colour of what is above the scale.
    assert data.scale is not None
    beyond = (np.abs(after.astype(int) - data.scale.table()[255]).max(axis=2) < 40).sum()
    assert data.scale.limit == pytest.approx(0.25 * BUMP)
    assert beyond > 30
    several = Image.open(io.BytesIO(encode(draw(data, parse_panels("best,front,top"), 160, 120))))
    # Rounded to whole pixels by Matplotlib, in its own way in each version.
    np.testing.assert_allclose(several.size, (2 * 160 + 28, 2 * (120 + 44) + 86), atol=1)
    save_picture(data, tmp_path / "view.jpg", parse_panels("top"))
    with Image.open(tmp_path / "view.jpg") as saved:
        np.testing.assert_allclose(saved.size, (PANEL_WIDTH + 28, PANEL_HEIGHT + 44 + 86), atol=1)


def test_a_failure_is_drawn_where_it_lay():
    image = Image.open(io.BytesIO(encode(draw(data_of(failed()), parse_panels("best"), 160, 120), "jpeg")))
    assert image.size[0] == 160 + 28


@pytest.mark.parametrize("text", ["", "fronty", "later:iso", "iso;top"])
def test_unknown_views_are_refused(text):
    with pytest.raises(InputError, match="unknown"):
        parse_panels(text)


def test_notebook_shows_verdict_numbers_and_picture():
    html = notebook_html(bumpy())
    assert bumpy().verdict.level.upper() in html
    assert "data:image/jpeg;base64," in html
    assert "<script" not in html
    assert html == bumpy()._repr_html_()
    assert "FAILED" in notebook_html(failed())


def test_a_window_needs_a_display(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match="--save"):
        require_display()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("dqreg.report.window._x_answers", lambda: True)
    require_display()


def test_a_window_shows_the_same_colours():
    data = data_of(bumpy(), 0.2)
    target, scan = shapes_of(data)
    assert len(target.vertices) == len(bumpy().inputs.target.geometry.vertices)
    assert data.scale is not None
    assert data.deviations is not None
    on = data.deviations.counted
    expected = data.scale.table()[data.scale.codes(data.deviations.values)] / 255.0
    np.testing.assert_allclose(np.asarray(scan.colors)[on], expected[on])
