"""From the arrays a caller gives to quadratic forms, slice by slice: memory stays bounded for any number of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from dqreg.arrays import FloatArray, as_vectors, as_weights
from dqreg.errors import InputError
from dqreg.solvers.matches import refuse_zero_directions
from dqreg.solvers.quadratic import QuadraticForm

# Rows converted and checked in one step: some 10 MB.
SLICE = 65_536

Origins = tuple[FloatArray, FloatArray]
Build = Callable[[list[FloatArray], FloatArray, Origins], FloatArray]


def form_of(
    arrays: dict[str, Any], weights: Any, build: Build, *, unit: str | None = None, placed: bool = True
) -> QuadraticForm:
    """Quadratic form of matched rows."""
    given = {name: value if _is_rows(value) else as_vectors(value, name) for name, value in arrays.items()}
    count = len(next(iter(given.values())))
    for name, value in given.items():
        if len(value) != count:
            first = next(iter(given))
            raise InputError(
                f"{first} has {count} rows and {name} {len(value)}; row i of one must match row i of the other"
            )
    beta = as_weights(1.0 if weights is None else weights, "weights", count)
    origins = _origins(given, beta) if placed and count else (np.zeros(3), np.zeros(3))
    matrix = np.zeros((13, 13))
    with np.errstate(over="ignore", invalid="ignore"):
        for rows, part in _slices(given, beta):
            if unit is not None:
                k = list(given).index(unit)
                lengths = np.sqrt(np.einsum("ij,ij->i", rows[k], rows[k]))
                if not lengths.all():
                    refuse_zero_directions(rows[k], unit, part)
                    lengths[lengths == 0.0] = 1.0
                rows[k] = rows[k] / lengths[:, None]
            matrix += build(rows, part, origins)
    if not np.isfinite(matrix).all():
        raise InputError("the coordinates are finite, but their squares are not; give them in a larger unit")
    return QuadraticForm(matrix, *origins)


def _is_rows(value: Any) -> bool:
    # Arrays on disk stay there: only slices of them are read.
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 3


def _slices(given: dict[str, Any], weights: FloatArray) -> Iterator[tuple[list[FloatArray], FloatArray]]:
    for i in range(0, len(weights), SLICE):
        part = slice(i, i + SLICE)
        yield [as_vectors(value[part], f"{name}, rows from {i}") for name, value in given.items()], weights[part]


def _origins(given: dict[str, Any], weights: FloatArray) -> Origins:
    sums = np.zeros((2, 3))
    total = float(weights.sum())
    for rows, part in _slices(given, weights / total if total > 0.0 else np.full(len(weights), 1.0 / len(weights))):
        sums += [part @ rows[0], part @ rows[1]]
    return sums[0], sums[1]
