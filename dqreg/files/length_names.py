"""Which names stand for lengths, or places, in the target's unit: of settings, options and columns."""

from __future__ import annotations

# Settings of a result. Above zero.
SIZES = ("max_distance", "reach", "diagonal")
# Zero or above; None where the data have none.
DISTANCES = ("width", "source_noise", "source_spacing", "cell_size", "chord", "expected_deviation")
SETTING_LENGTHS = (*SIZES, *DISTANCES, "centre")
# Those of them that are asked for.
OPTION_LENGTHS = ("max_distance", "expected_deviation")
# Columns of iterations, and of the summary of a batch.
COLUMN_LENGTHS = ("rms", "kernel", "tx", "ty", "tz", "deviation_p95")


def column_head(name: str, unit: str | None) -> str:
    """The name of a column, with the unit where it holds lengths."""
    return f"{name} [{unit}]" if unit and name in COLUMN_LENGTHS else name
