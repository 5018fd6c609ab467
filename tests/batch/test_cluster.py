"""Batches and huge scans on a Dask cluster: a scheduler, and workers that are processes of their own."""

from __future__ import annotations

import os
import signal
import sys

import numpy as np
import pytest

from dqreg.batch import Crew, read_manifest, run_batch
from dqreg.batch import cluster as door
from dqreg.batch import huge as huge_room
from dqreg.batch.huge import register_huge
from dqreg.batch.row import Targets, run_row
from dqreg.errors import InputError, MissingDependencyError
from dqreg.geometry import Mesh, sample_mesh
from dqreg.synth.parts import bracket
from tests.batch.scenes import make_scene, results, without_times

distributed = pytest.importorskip("distributed")
# Dask's own: sockets of a worker that was killed, and loops that close late.
pytestmark = [
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

    crew = Crew(scheduler=cluster.scheduler_address, timeout=120.0)
    found = run_batch(rows, tmp_path / "out", crew, observe=observe)
    assert [(line.row.name, line.verdict) for line in found.lines] == [(row.name, "accepted") for row in rows]
    assert [progress.done for progress in told] == list(range(6))
    targets, made = Targets(), results(tmp_path / "out")
    for row in rows:
        here, there = without_times(run_row(row, targets).record), made[row.name]
        assert there["batch"] == here["batch"]
        # The number of threads may change the order of sums.
        np.testing.assert_allclose(there["T_target_source"], here["T_target_source"], rtol=0.0, atol=1e-9)


@pytest.fixture(scope="module")
def scan():
    mesh = Mesh(*bracket())
    rng = np.random.default_rng(3)
    points = sample_mesh(mesh, 30_000, rng).points
    return mesh, points + rng.normal(scale=1e-4 * mesh.diagonal, size=points.shape)


def test_a_huge_scan_has_the_same_pose_on_the_cluster_even_if_a_worker_dies(cluster, scan, monkeypatch):
    mesh, points = scan
    alone = register_huge(points, mesh, "identity", effort="fast")
    steps, real = [], huge_room.total

    def sums(parts):
        steps.append(len(parts))
        if len(steps) == 1:
            kill_one(cluster)
        return real(parts)

    monkeypatch.setattr(huge_room, "total", sums)
    there = register_huge(points, mesh, "identity", effort="fast", scheduler=cluster.scheduler_address, chunks=5)
    # The same points and pairs; only the order of the sums differs.
    assert np.abs(there.T_target_source - alone.T_target_source).max() <= 1e-10 * mesh.diagonal
    assert set(steps) == {5}
    assert len(there.history) == len(alone.history)
    assert there.rms == pytest.approx(alone.rms, rel=1e-9)


def test_no_scheduler_and_no_dask_are_said_in_words(monkeypatch, tmp_path):
    monkeypatch.setattr(door, "CONNECT_SECONDS", 1)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(InputError, match=f"no Dask scheduler answers at {address}"), door.connected(address):
            pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'dqreg\[cluster\]'"):
        door.load_distributed()
