from __future__ import annotations

import sys

import pytest

from dqreg.errors import InputError
from dqreg.report.window import require_display


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({}, "no display"),
        # A session that has ended, or a number that is wrong: nobody answers there.
        ({"DISPLAY": ":4711"}, "':4711' does not answer"),
        ({"WAYLAND_DISPLAY": "wayland-0", "XDG_RUNTIME_DIR": "{folder}"}, "no display"),
    ],
)
def test_a_display_that_is_not_there_is_said_with_what_to_do(tmp_path, monkeypatch, variables, said):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value.format(folder=tmp_path))
    with pytest.raises(InputError, match=said) as error:
        require_display()
    assert "--save view.png" in str(error.value)
