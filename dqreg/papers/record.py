"""A report as JSON: every number at full precision, nothing that a strict reader would refuse."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

from dqreg.papers.document import Report


def to_json(report: Report) -> str:
    """Whole report as strict JSON."""
    return json.dumps(_plain(asdict(report)), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
