"""Length units by name, and the factor between two of them."""

from __future__ import annotations

from dqreg.errors import UnitsError

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254, "ft": 0.3048}


def factor(source: str | None, target: str | None) -> float:
    """What source lengths are multiplied with to be in target units; 1 where either unit is unknown.

    Parameters
    ----------
    source, target : str or None
        One of "mm", "cm", "m", "inch", "ft".

    Returns
    -------
    float
        The factor.

    Raises
    ------
    UnitsError
        If a name is not known.

    Examples
    --------
    >>> factor("m", "mm")
    1000.0
    """
    for name in (source, target):
        if name is not None and name not in METRES:
            raise UnitsError(f"unknown length unit {name!r}; known are {', '.join(METRES)}")
    if source is None or target is None:
        return 1.0
    # The ratio of the two table entries, without the rounding that 1 / 1e-3 would bring.
    return 1.0 if source == target else round(METRES[source] / METRES[target], 15)
