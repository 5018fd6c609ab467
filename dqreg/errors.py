"""Named errors of dqreg; each message says what was given, what was expected and what to do."""

from __future__ import annotations


class DqregError(Exception):
    """Base of every error that dqreg raises on purpose."""


class InputError(DqregError, ValueError):
    """An argument or a file does not hold what the call needs."""


class UnitsError(InputError):
    """Lengths of source and target look as if they were in different units."""


class DegenerateGeometryError(DqregError, ValueError):
    """The matches leave part of the pose undetermined (for example: all points on one line)."""


class MissingDependencyError(DqregError, ImportError):
    """A package or a system library is absent; the message holds the command that brings it."""
