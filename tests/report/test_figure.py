from __future__ import annotations

import io

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread

from dqreg.papers.document import Curve, Figure, Panel
from dqreg.papers.output import draw_png
from dqreg.report.figure import encode, new_figure, stacked

FIGURE = Figure("f", "F", (Panel("x [mm]", "y [mm]", (Curve("a", (1.0, 2.0), (1.0, float("nan"))),)),))


def test_png_is_opaque_and_wide_enough_for_print():
    picture = imread(io.BytesIO(draw_png(FIGURE)))
    assert picture.shape[1] >= 1000
    assert np.all(picture[..., 3] == 1.0)


@pytest.mark.parametrize(
    ("kind", "begin"), [("png", b"\x89PNG"), ("jpeg", b"\xff\xd8"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_every_kind_of_file(kind, begin):
    assert encode(new_figure(1.0, 1.0, 50.0), kind).startswith(begin)


def test_no_global_state_is_touched():
    import matplotlib.pyplot as plt

    before = dict(matplotlib.rcParams), plt.get_fignums()
    draw_png(FIGURE)
    assert (dict(matplotlib.rcParams), plt.get_fignums()) == before


def test_a_short_logarithmic_axis_has_plain_numbers_and_a_long_one_powers():
    def painter(high):
        def paint(axes):
            axes.plot([1.0, 2.0], [1.0, high])
            axes.set_yscale("log")

        return paint

    made, rows = stacked([painter(20.0), painter(1e8)], 4.0, [3.0, 3.0], 100.0)
    made.canvas.draw()
    short, long = ([label.get_text() for label in axes.get_yticklabels()] for axes in rows)
    assert {"1", "2", "5", "10", "20"} <= set(short)
    assert any("10^" in label for label in long)
