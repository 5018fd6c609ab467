"""The command in this process, as its tests call it."""

from __future__ import annotations

import pytest

from dqreg.cli.main import main


def run(*arguments: object) -> int:
    """Exit code of ``dqreg`` with these arguments, which may be paths and numbers."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return int(stop.value.code or 0)
