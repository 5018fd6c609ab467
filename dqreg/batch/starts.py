"""Where a row begins: nothing, the identity, or a pose in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dqreg.errors import InputError

WORDS = ("none", "identity")


def read_start(text: str) -> Any:
    """The start of a row as `dqreg.register` takes it.

    Parameters
    ----------
    text : str
        "none", "identity", or the path of a 4x4 pose ``T_target_source``: text, or a result of dqreg (JSON).

    Returns
    -------
    None, str or ndarray
        None for "none".

    Raises
    ------
    InputError
        If the file holds no pose.

    Examples
    --------
    >>> read_start("none"), read_start("identity")
    (None, 'identity')
    """
    import numpy as np

    from dqreg.arrays import as_pose
    from dqreg.result import Registration

    if text in WORDS:
        return None if text == "none" else text
    path = Path(text)
    if not path.is_file():
        raise InputError(f"start must be none, identity or a file with a 4x4 pose; there is no file {text}")
    if path.suffix.lower() == ".json":
        loaded = Registration.load(path)
        loaded.inverse()  # raises in words where that result found no pose
        return loaded.T_target_source
    try:
        numbers = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"start {text}: not a 4x4 pose of plain numbers ({error})") from error
    return as_pose(numbers, f"start {text}")
