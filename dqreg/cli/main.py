"""`dqreg`: signals have their meaning before anything else is imported; and how errors leave the program."""

from __future__ import annotations

import errno
import os
import sys
import threading
import warnings

from dqreg.cli.exit_codes import BAD_INPUT, SIGNAL_CODE, STOPPED_CODE, UNEXPECTED_ERROR
from dqreg.cli.signals import Signals, leave, leave_at_once, listen, say
from dqreg.errors import DqregError, printable

# What is wrong with a path itself, wherever it is first used.
UNUSABLE = (errno.ENAMETOOLONG, errno.ELOOP)


def console() -> None:
    """Run `dqreg` with the words of the command line, and exit."""
    # Never undone: while Python takes itself down at the end, a signal must not leave a traceback either.
    listen(leave_at_once)
    from dqreg.kernels.compiling import second_process

    second_process.allow()
    warnings.formatwarning = _warning_line
    try:
        main()
    except SystemExit as end:
        # After a signal all is tidied up by now. Python's own end would wait for threads that nobody needs any more,
        # and libraries that are taken down in the middle of their work have changed the code and written to the
        # standard output. So it is where an error ends the work while another thread prepares the target.
        if isinstance(end.code, int) and (end.code > SIGNAL_CODE or threading.active_count() > 1):
            leave(end.code)
        raise


def _warning_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """A warning of ours as one line, as errors are; others with their place."""
    if category is UserWarning:
        return f"dqreg: warning: {printable(' '.join(str(message).split()))}\n"
    return f"{filename}:{lineno}: {category.__name__}: {message}\n"


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; expected errors are one line on stderr, unexpected ones a trace."""
    for name in ("COLUMNS", "LINES"):
        # A terminal of no width, as some services set it, would be shown nothing at all.
        if not os.environ.get(name, "1").strip("0"):
            del os.environ[name]
    signals = Signals()
    try:
        with signals:
            from dqreg.cli.lazy_group import cli

            code = cli.main(arguments, prog_name="dqreg", standalone_mode=False)
    except BaseException as error:
        # What a signal has become on its way through other people's code is not worth a trace.
        code = 0 if signals.number else _tell(error)
    if signals.number:
        say(signals.number)
        code = SIGNAL_CODE + signals.number
    sys.exit(code if isinstance(code, int) else 0)


def _tell(error: BaseException) -> int:
    """Say what went wrong, the trace with what nobody has expected; what ends Python goes on as it is."""
    import click

    if isinstance(error, click.ClickException):
        return _bad(error.format_message())
    if isinstance(error, click.Abort):
        # A Ctrl-C where nobody listens to signals.
        say(STOPPED_CODE - SIGNAL_CODE)
        return STOPPED_CODE
    if isinstance(error, DqregError):
        return _bad(str(error))
    if isinstance(error, FileNotFoundError) and error.filename is None:
        return _bad("the working folder was deleted; change to another one")
    if isinstance(error, OSError) and error.errno in UNUSABLE:
        return _bad(f"cannot use {error.filename}: {error.strerror}")
    # Files are opened where errors have names; what has none is the output itself.
    if isinstance(error, OSError) and error.filename is None:
        # What is still in the buffer would fail once more at the very end.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
        return _bad(f"cannot write to the standard output: {error.strerror or error}")
    if not isinstance(error, Exception):
        raise error
    # Python itself would end with the code of a pose that is not trusted.
    sys.excepthook(type(error), error, error.__traceback__)
    return _bad(
        f"unexpected {type(error).__name__}, an error of dqreg: please report it with this trace", UNEXPECTED_ERROR
    )


def _bad(message: str, code: int = BAD_INPUT) -> int:
    import click

    try:
        click.echo(f"dqreg: error: {printable(' '.join(message.split()))}", err=True)
    except OSError:
        # Nobody can be told; the exit code says it.
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    return code
