"""What `logging.getLogger("dqreg")` says: a line a result, for the log of a node. Without a handler: nothing."""

from __future__ import annotations

import logging

from dqreg.registration.result.result import Registration
from dqreg.trust.records import Verdict

LOGGER = logging.getLogger("dqreg")
# Python itself would print warnings of a logger that nobody listens to.
SILENT = logging.NullHandler()
LOGGER.addHandler(SILENT)


def logged(result: Registration, what: str = "") -> Registration:
    """The result, after a line about it."""
    name = what or f"{result.settings.get('source')} to {result.settings.get('target')}"
    log_verdict(result.verdict, name, result.timings.get("total", float("nan")))
    return result


def log_verdict(verdict: Verdict, what: str, seconds: float) -> None:
    """One line: INFO where the verdict is accepted, WARNING with all reasons where not."""
    accepted = verdict.level == "accepted"
    level = logging.INFO if accepted else logging.WARNING
    if LOGGER.isEnabledFor(level) and _is_heard():
        reasons = verdict.reasons[:1] if accepted else verdict.reasons
        LOGGER.log(level, "%s: %s in %.3f s: %s", what, verdict.level, seconds, "; ".join(reasons))


def _is_heard() -> bool:
    """Whether a handler would get a line, which takes longer to make than to look for one."""
    logger: logging.Logger | None = LOGGER
    while logger is not None:
        if any(handler is not SILENT for handler in logger.handlers):
            return True
        logger = logger.parent if logger.propagate else None
    return False
