"""What a library might do to a worker process, by the name of the scan; sent as the thumbnail function."""

from __future__ import annotations

import os
import time

from dqreg.registration.batch.row import Done
from dqreg.registration.batch.worker import receive, send


def thumbnail(result):
    name = os.path.basename(result.settings["source"])  # noqa: PTH119
    if "crash" in name:
        os.write(2, b"out of cheese\n")
        os.abort()
    if "hang" in name:
        time.sleep(600.0)
    if "raise" in name:
        raise RuntimeError("no luck")
    os.write(1, b"libraries print where answers go\n")
    return b"picture"


def parrot():
    """A worker that registers nothing, and so starts fast."""
    asked, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    send(answers, None)
    while True:
        row, _ = receive(asked)
        if row.name == "hang":
            time.sleep(600.0)
        if row.name == "leave":
            os._exit(3)
        send(answers, Done("ran", str(os.getpid())))
