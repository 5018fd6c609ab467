"""What the shell is told by a number; docs/command_line.md says it in words.

Imports nothing: signals need these numbers before anything else is loaded.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable

NOT_ACCEPTED, BAD_INPUT = 1, 2
NOT_PASSED, UNEXPECTED_ERROR = 3, 4
# Codes above it tell which signal ended the program; that of Ctrl-C.
SIGNAL_CODE, STOPPED_CODE = 128, 130


def code_of(levels: Iterable[str], outcomes: Iterable[str | None] = ()) -> int:
    """Code of alignments by the levels of their verdicts, and of the parts in them; of None nothing was asked.

    >>> code_of(["accepted"], ["pass", None]), code_of(["accepted"], ["undecided"]), code_of(["suspect"], ["fail"])
    (0, 3, 1)
    """
    if any(level != "accepted" for level in levels):
        return NOT_ACCEPTED
    return NOT_PASSED if any(outcome not in ("pass", None) for outcome in outcomes) else 0
