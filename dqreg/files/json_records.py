"""The JSON object in a file, or a named error: whatever lies there, a file of another program for one."""

from __future__ import annotations

import json
import os
from typing import Any

from dqreg.errors import InputError
from dqreg.files.untrusted import read_record


def read_json(path: str | os.PathLike[str], wanted: str, kind: str = "JSON file") -> dict[str, Any]:
    """The object of a JSON file; the errors say what was wanted, and what kind of file it is not."""
    try:
        found = json.loads(read_record(path, wanted))
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is no readable {kind}: expected {wanted} ({error})") from error
    if not isinstance(found, dict):
        raise InputError(f"{path} is no {kind}: expected {wanted}, a JSON object; got {type(found).__name__}")
    return found
