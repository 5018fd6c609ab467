"""Foreign readers in a process of their own: damaged files crash them, hang them or make them take any memory."""

from __future__ import annotations

import subprocess
import sys

# First of all, so that they hold while the library is loaded; where a system has none, the wall time alone holds.
LIMITS = """
import sys
seconds, memory, *words = sys.argv[1:]
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except (ImportError, ValueError):
    pass
"""
# Wall time for each second of processor time allowed: a loaded machine is slow, a sleeping process has no excuse.
PATIENCE_RATIO = 10.0


def run_limited(
    program: str, *words: object, seconds: float, memory: float
) -> subprocess.CompletedProcess[bytes] | None:
    """Run the program's text, which finds its arguments as ``words``; None where it was not done in time."""
    arguments = map(str, (int(seconds), int(memory), *words))
    command = [sys.executable, "-P", "-c", LIMITS + program, *arguments]
    try:
        return subprocess.run(command, capture_output=True, timeout=PATIENCE_RATIO * seconds, check=False)
    except subprocess.TimeoutExpired:
        return None
