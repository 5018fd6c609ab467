"""A page that follows the program: viser's server, on this machine alone."""

from __future__ import annotations

import contextlib
import io
import time
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._rotations import nearest_rotation
from dqreg.errors import InputError, load_package
from dqreg.report.view3d import ELLIPSOID_DIAGONALS
from dqreg.rigid import quaternion

HOST = "127.0.0.1"


def open_server(port: int, label: str) -> Any:
    """A running server that other machines cannot reach; the next free port where this one is taken."""
    if not 0 < port < 65536:
        raise InputError(f"--port must be from 1 to 65535; got {port}")
    viser = load_package("viser", "dqreg[view]", "a live view")
    # It greets on the screen even where it is told not to.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=HOST, port=port, label=label, verbose=False)
    # The button would send the scene to a server of viser's.
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    return server


def where(server: Any) -> str:
    """How to look at it, from here and from another machine."""
    port = server.get_port()
    return (
        f"open http://{HOST}:{port} in a browser (from another machine: ssh -L {port}:{HOST}:{port} THIS_MACHINE, and "
        "the same address); Ctrl-C ends"
    )


def wait(server: Any) -> None:
    """Until the user ends it."""
    try:
        while True:
            time.sleep(0.2)
    except KeyboardInterrupt:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def place(handle: Any, T: FloatArray) -> None:
    """Put an object of the scene at a pose."""
    handle.wxyz, handle.position = quaternion.from_matrix(T[:3, :3]), T[:3, 3]


def add_ellipsoid(server: Any, name: str, axes: FloatArray, at: FloatArray, size: float) -> tuple[Any, float]:
    """Semi-axes, one a row, drawn larger so that they can be seen; and how many times."""
    lengths = np.linalg.norm(axes, axis=1)
    larger = ELLIPSOID_DIAGONALS * size / float(lengths.max())
    directions = axes / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    # Axes of length zero have no direction: whatever completes a rotation.
    scale = tuple(float(max(length * larger, 1e-3 * size)) for length in lengths)
    wxyz = quaternion.from_matrix(nearest_rotation(directions.T))
    handle = server.scene.add_icosphere(name, 1.0, (220, 60, 40), scale=scale, opacity=0.45, wxyz=wxyz, position=at)
    return handle, larger
