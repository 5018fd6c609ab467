"""Batches on a Dask cluster: a scheduler, and workers that are processes of their own."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import signal
import socket
import sys
import threading
import time

import numpy as np
import pytest

from dqreg.errors import InputError, MissingDependencyError
from dqreg.registration.batch import Workers, read_manifest, run_batch
from dqreg.registration.batch import dask_client as door
from dqreg.registration.batch.row import Targets, run_row
from tests.registration.batch.hostile import thumbnail
from tests.registration.batch.scenes import make_scene, results, without_times

# Dask's own: sockets of a worker that was killed, and loops that close late.
pytestmark = [
    # Not imported to be looked for: its half a second would be every worker's.
    pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="could not import 'distributed'"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning:distributed.*"),
]


@pytest.fixture(scope="module")
def cluster():
    settings = {"distributed.comm.timeouts.connect": "20s", "distributed.worker.multiprocessing-method": "spawn"}
    old = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = "1"
    import dask
    import distributed

    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
    ):
        yield cluster
    if old is None:
        del os.environ["OMP_NUM_THREADS"]
    else:
        os.environ["OMP_NUM_THREADS"] = old


def kill_one(cluster) -> None:
    pids = [worker.pid for worker in cluster.workers.values() if worker.pid]
    os.kill(pids[0], signal.SIGKILL)


def test_a_killed_worker_loses_nothing_and_results_are_those_of_one_machine(cluster, tmp_path):
    rows = read_manifest(make_scene(tmp_path / "scene", 5).manifest)
    told = []

    def observe(progress):
        told.append(progress)
        if sum(each.line is not None for each in told) == 1:
            kill_one(cluster)

    workers = Workers(scheduler=cluster.scheduler_address, timeout=120.0)
    found = run_batch(rows, tmp_path / "out", workers, observe=observe)
    assert [(line.row.name, line.verdict) for line in found.lines] == [(row.name, "accepted") for row in rows]
    assert [progress.done for progress in told] == list(range(6))
    targets, made = Targets(), results(tmp_path / "out")
    for row in rows:
        here, there = without_times(run_row(row, targets).record), made[row.name]
        assert there["batch"] == here["batch"]
        # The number of threads may change the order of sums.
        np.testing.assert_allclose(there["T_target_source"], here["T_target_source"], rtol=0.0, atol=1e-9)


def test_a_row_whose_process_dies_is_tried_once_more_elsewhere_and_then_named(cluster, tmp_path):
    scene = make_scene(tmp_path / "scene", 1)
    (scene.folder / "scan0.npy").rename(scene.folder / "crash.npy")
    scene.manifest.write_text(scene.manifest.read_text().replace("scan0", "crash"))
    workers = Workers(scheduler=cluster.scheduler_address, timeout=120.0)
    (bad,) = run_batch(read_manifest(scene.manifest), tmp_path / "out", workers, thumbnail=thumbnail).lines
    assert bad.verdict == "crashed"
    (reason,) = bad.reasons
    assert "signal 6" in reason
    # The worker killed in another test may just be coming back: then there is no elsewhere.
    assert re.search(r"\(tried twice, on tcp://\S+( and tcp://\S+)?\)$", reason)


def test_other_versions_and_silent_workers_are_told(cluster, monkeypatch):
    with door.connected(cluster.scheduler_address) as client, monkeypatch.context() as patch:
        patch.setattr(door.importlib.metadata, "version", lambda name: "0.0.1")
        with pytest.raises(InputError, match=r"have dqreg .*, and here is 0\.0\.1"):
            door._require_dqreg(client, "tcp://there")
    monkeypatch.setattr(door, "_versions", lambda: __import__("time").sleep(5.0))
    monkeypatch.setattr(door, "WORKER_SECONDS", 0.5)
    with pytest.raises(InputError, match="do not answer"), door.connected(cluster.scheduler_address):
        pass


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0" * 64])
def test_whatever_answers_at_a_wrong_address_ends_in_one_line(monkeypatch, said):
    monkeypatch.setattr(door, "CONNECT_SECONDS", 0.5)
    kept = []

    def answer():
        with contextlib.suppress(OSError):
            while True:
                kept.append(listening.accept()[0])
                kept[-1].sendall(said)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
        with pytest.raises(InputError, match=f"no Dask scheduler answers at {address}: ") as told:
            door.within(30.0, lambda: door.connected(address).__enter__())
    for each in kept:
        each.close()
    assert "\n" not in str(told.value)


def test_a_scheduler_that_stops_answering_is_gone(monkeypatch):
    from dqreg.registration.batch import dask_cluster

    class Silent:
        status = "running"

        def nthreads(self):
            time.sleep(60.0)

    monkeypatch.setattr(dask_cluster, "SILENT_SECONDS", 0.1)
    with pytest.raises(InputError, match="is gone; rows done so far are kept"):
        dask_cluster._RowTasks(Silent(), "tcp://here", [], ())._slots()


def test_no_scheduler_and_no_dask_are_said_in_words(monkeypatch, tmp_path):
    monkeypatch.setattr(door, "CONNECT_SECONDS", 0.2)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(InputError, match=f"no Dask scheduler answers at {address}"), door.connected(address):
            pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'dqreg\[cluster\]'"):
        door.load_distributed()
