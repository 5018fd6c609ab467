"""Live views by viser: what a client is sent over the wire, and that nobody but this machine can be one."""

from __future__ import annotations

import dataclasses
import socket
import sys
import urllib.request

import numpy as np
import pytest

from dqreg.errors import InputError, MissingDependencyError
from dqreg.report import live_server
from dqreg.report.live_server import HOST, add_ellipsoid, open_server, wait, where
from dqreg.rigid import pose, twist
from dqreg.trust.records import Alternative
from tests.report.scenes import T_TRUTH, bumpy, data_of

viser = pytest.importorskip("viser")


def received(server, enough: set[str], seconds: float = 20.0) -> bytes:
    """What a browser receives over the websocket, unpacked, until it holds all names."""
    sync, zstandard = pytest.importorskip("websockets.sync.client"), pytest.importorskip("zstandard")
    protocol, found = [f"viser-v{viser.__version__}"], b""
    with sync.connect(f"ws://{HOST}:{server.get_port()}", subprotocols=protocol, max_size=None) as link:
        while not all(name.encode() in found for name in enough):
            message = link.recv(timeout=seconds)
            # Two sizes, then the compressed part, then plain numbers.
            whole, packed = (int.from_bytes(message[at : at + 8], "little") for at in (0, 8))
            found += zstandard.ZstdDecompressor().decompress(message[16 : 16 + packed], max_output_size=whole)
    return found


@pytest.fixture(scope="module")
def shown():
    from dqreg.report.live_result import serve_result

    result = bumpy()
    turned = twist.exp(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])) @ result.T_target_source
    data = data_of(dataclasses.replace(result, alternatives=(Alternative(turned, 1.0),)), 0.2)
    live = serve_result(data, 18_231)
    yield data, live
    live.server.stop()


def test_a_client_is_sent_part_scan_and_ellipsoid_and_nobody_else_is(shown):
    server = shown[1].server
    port = server.get_port()
    with urllib.request.urlopen(f"http://{HOST}:{port}", timeout=20) as answer:
        assert answer.status == 200
    text = received(server, {"/part", "/scan", "/ellipsoid", "Iteration", "Pose"})
    assert b"ACCEPTED" in text
    # Another address of this machine is not listened on.
    with socket.socket() as link:
        link.settimeout(5.0)
        assert link.connect_ex(("127.0.0.2", port)) != 0
    assert f"ssh -L {port}:{HOST}:{port}" in where(server)


def test_iterations_and_rivals_put_the_scan_where_they_had_it(shown):
    """The scan as it is drawn, moved as its handle says, is the scan under the pose of that iteration."""
    data, live = shown
    scan, gui = live.scene["scan"], live.controls
    result = data.result

    def drawn() -> np.ndarray:
        R = pose.from_parts(live_server.quaternion.to_matrix(np.array(scan.wxyz)), np.array(scan.position))
        return pose.apply(R, data.points[:50] / data.size) * data.size + data.origin

    def under(T: np.ndarray) -> np.ndarray:
        return pose.apply(T @ pose.inverse(result.T_target_source), data.points[:50] + data.origin)

    np.testing.assert_allclose(drawn(), under(result.T_target_source), atol=1e-6 * data.size)
    gui["Iteration"].value = 1
    np.testing.assert_allclose(drawn(), under(result.history[0].T_target_source), atol=1e-6 * data.size)
    gui["Pose"].value = "Alternative 1"
    np.testing.assert_allclose(drawn(), under(result.alternatives[0].T_target_source), atol=1e-6 * data.size)
    gui["part"].value = False
    assert not live.scene["part"].visible
    assert np.linalg.norm(result.T_target_source - T_TRUTH) < 1.0


def test_the_odometry_shows_frame_map_and_trajectory():
    pytest.importorskip("kiss_icp")
    from dqreg.odometry import Odometry
    from dqreg.odometry.live import LiveMap

    rng = np.random.default_rng(0)
    walls = rng.uniform(-4, 4, (6000, 3))
    rows = np.arange(6000)
    walls[rows, rows % 3] = 4.0 * np.sign(walls[rows, rows % 3])
    odometry, view = Odometry(), LiveMap(18_235)
    try:
        for step in range(3):
            frame = walls - [0.1 * step, 0.0, 0.0]
            view.show(frame, odometry.register_frame(frame))
        np.testing.assert_allclose(view.sensor.position, odometry.poses[-1][:3, 3], atol=1e-9)
        received(view.server, {"/frame", "/map", "/trajectory", "/sensor", "/ellipsoid", "accepted"})
    finally:
        view.server.stop()


def test_an_ellipsoid_has_the_axes_of_the_covariance():
    server = open_server(18_240, "test")
    try:
        axes = np.array([[0.0, 3.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]]) * 1e-4
        handle, larger = add_ellipsoid(server, "/e", axes, np.zeros(3), 1.0)
        R = live_server.quaternion.to_matrix(np.array(handle.wxyz))
        np.testing.assert_allclose(np.abs((R * np.array(handle.scale)).T), np.abs(axes) * larger, atol=1e-12)
        assert np.linalg.norm(axes[0]) * larger == pytest.approx(live_server.ELLIPSOID_DIAGONALS)
    finally:
        server.stop()


def test_it_ends_with_ctrl_c_and_says_what_is_missing(monkeypatch):
    class Stopped:
        done = False

        def stop(self) -> None:
            self.done = True

    server = Stopped()
    monkeypatch.setattr(live_server.time, "sleep", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
    wait(server)
    assert server.done
    with pytest.raises(InputError, match="--port must be"):
        open_server(0, "test")
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingDependencyError, match=r"dqreg\[view\]"):
        open_server(18_250, "test")
