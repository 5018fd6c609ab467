"""An odometry in the frame of the studio: what is written for the page, and the page itself."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")

from dqreg.cli.studio import drive as run
from dqreg.errors import InputError
from dqreg.files import write_cloud
from dqreg.geometry import Mesh, sample_mesh
from dqreg.studio.travel import Travel
from dqreg.synth.parts import box
from tests.studio.studio_page import browsing, keep_picture, opened, running

# A room with a pillar, and a sensor that goes along x by so much a frame.
STEP, FRAMES = 0.3, 4


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    walls, pillar = Mesh(*box((20.0, 14.0, 5.0))), Mesh(*box((1.0, 1.5, 5.0)))
    for number in range(FRAMES):
        rng = np.random.default_rng(number)
        inside = sample_mesh(pillar, 1500, rng).points + np.array([4.0, 3.0, 0.0])
        places = np.concatenate([sample_mesh(walls, 6000, rng).points, inside])
        write_cloud(folder / f"{number:03}.ply", places - np.array([STEP * number, 0.0, 0.0]))
    return folder


def test_every_frame_is_told_with_its_map_and_its_place(drive, tmp_path):
    run(drive, tmp_path)
    state = json.loads((tmp_path / "state.json").read_text())
    assert (state["frames"], state["of"], state["over"], state["error"]) == (FRAMES, FRAMES, True, None)
    assert len(state["levels"]) == FRAMES
    # The frames were moved by exactly that much: places to a tenth of a step.
    along = state["size"] * np.array(state["path"])
    np.testing.assert_allclose(along, [[STEP * k, 0.0, 0.0] for k in range(FRAMES)], atol=0.1 * STEP)
    for name in ("frame", "map"):
        drawn = state[name]
        # Six bytes a place, and one for the light of those of the frame.
        size = (tmp_path / drawn["file"]).stat().st_size
        assert size == drawn["count"] * (7 if name == "frame" else 6)
    assert len(list(tmp_path.glob("frame-*.bin"))) <= 3


def test_a_sequence_that_is_none_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Travel(tmp_path / "none", tmp_path / "out", run)


@pytest.mark.soak
def test_the_page_follows_the_odometry(drive):
    with running("--odometry", drive) as address, browsing() as browser, opened(browser, address) as page:
        page.locator("#odometry-said", has_text=f"Frame {FRAMES} of {FRAMES}").wait_for()
        page.locator("#odometry-said", has_text="done").wait_for()
        assert page.locator("polyline.path").get_attribute("points").count(",") == FRAMES
        assert page.evaluate("[studio.stage.scene.on.count, studio.stage.scene.target.count].every(n => n > 1000)")
        keep_picture(page, "studio_odometry")


@pytest.mark.soak
def test_a_sequence_without_frames_is_a_sentence(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    with running("--odometry", tmp_path) as address, browsing() as browser, opened(browser, address) as page:
        page.locator("#odometry-said", has_text="holds no").or_(
            page.locator("#odometry-said", has_text="no ")
        ).wait_for()
