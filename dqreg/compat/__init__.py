"""Other packages' habits: their calls and names, with dqreg's steps behind them."""

from __future__ import annotations

from dqreg.compat import open3d

__all__ = ["open3d"]
