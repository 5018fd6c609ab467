"""Numbers that the two papers print, from one data file that says where each stands."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

PRINTED: dict[str, Any] = tomllib.loads(resources.files("dqreg.papers").joinpath("printed.toml").read_text("utf-8"))
WALKER, JIA = PRINTED["walker1991"], PRINTED["jia2020"]
