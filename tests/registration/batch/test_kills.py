"""A batch killed at any moment: nothing is lost, nothing is done twice, nothing is half-written, nothing lives on.

``DQREG_KILLS=50`` in the environment makes it that many kills, with two workers; the default is one, with one.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import time
from collections import Counter

import numpy as np
import pytest

from tests.registration.batch.scenes import alive, all_gone, left_over, make_scene, results, stamps, started, summary

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
KILLS = int(os.environ.get("DQREG_KILLS", "1"))
SOAK = "DQREG_KILLS" in os.environ
ROWS, WORKERS = (6, 2) if SOAK else (3, 1)
# Most of them leave no time for anything.
SENT = [signal.SIGKILL, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT]
# Signals that may come too late.
MISSED = 4
soak = pytest.mark.skipif(not SOAK, reason="long: set DQREG_KILLS")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("kills"), ROWS)


@pytest.fixture(scope="module")
def undisturbed(scene, tmp_path_factory):
    out, began = tmp_path_factory.mktemp("undisturbed") / "out", time.monotonic()
    with started("batch", scene.manifest, "--out", out, "--workers", WORKERS) as run:
        assert run.wait(120.0) == 0, run.stderr.read()
    return results(out), {path.name: path.read_bytes() for path in out.glob("thumbnails/*")}, time.monotonic() - began


def go(scene, out, token):
    return started("batch", scene.manifest, "--out", out, "--workers", WORKERS, "--resume", token=token)


def test_killed_at_random_moments_and_resumed(scene, undisturbed, tmp_path, record_property):
    whole, pictures, seconds = undisturbed
    rng, token = np.random.default_rng(KILLS), secrets.token_hex(8)
    sent, rounds = Counter(), 0
    while sent.total() < KILLS:
        out, seen, code = tmp_path / str(rounds), {}, -1
        rounds += 1
        while code != 0:
            killed = None
            with go(scene, out, token) as run:
                if sent.total() < KILLS:
                    try:
                        run.wait(rng.uniform(0.1, 1.2) * seconds)
                    except subprocess.TimeoutExpired:
                        # Only the one process: its workers must notice by themselves.
                        killed = signal.Signals(rng.choice(SENT))
                        run.send_signal(killed)
                        sent[killed.name] += 1
                code, errors = run.wait(120.0), run.stderr.read()
            assert code == 0 or killed, errors
            assert all_gone(token)
            now = stamps(out) if out.exists() else {}
            assert all(now[name] == stamp for name, stamp in seen.items())  # nothing was written again
            for path in out.glob("results/*.json"):
                json.loads(path.read_text())
            assert killed == signal.SIGKILL or left_over(out) == []
            seen = now
        assert results(out) == whole
        assert {path.name: path.read_bytes() for path in out.glob("thumbnails/*")} == pictures
        assert left_over(out) == []
        lines = summary(out)
        assert [line["name"] for line in lines] == [f"scan{number}" for number in range(ROWS)]
        assert {line["verdict"] for line in lines} == {"accepted"}
        shutil.rmtree(out)
    record_property("sent", str(dict(sent)))
    record_property("rounds", rounds)


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=soak)])
def test_a_signal_ends_politely_and_resume_goes_on(scene, undisturbed, tmp_path, number):
    whole, _, _ = undisturbed
    rng, token, out = np.random.default_rng(int(number)), secrets.token_hex(8), tmp_path / "out"
    code, rounds, missed = 128 + number, 0, 0
    while code == 128 + number:
        before = stamps(out) if out.exists() else {}
        with go(scene, out, token) as run:
            if rounds < max(1, KILLS // 3):
                # Once the work has begun: before that there is nothing to be polite about.
                first = run.stdout.readline()
                if " left" in first or "done already" in first:
                    time.sleep(rng.uniform(0.0, 0.03))
                    run.send_signal(number)
            rest, errors = run.communicate(timeout=60.0)
        code, rounds = run.returncode, rounds + 1
        assert code in (0, 128 + number), errors
        assert all_gone(token)
        assert left_over(out) == []
        assert "Traceback" not in errors
        now = stamps(out)
        assert all(now[name] == stamp for name, stamp in before.items())
        lines = summary(out)
        assert {line["name"] for line in lines if line["verdict"] == "accepted"} == set(now)
        assert {line["verdict"] for line in lines} <= {"accepted", "not run"}
        if code:
            assert "--resume" in errors
            assert "not run" in rest
        elif rounds == 1 and missed < MISSED:
            # On a busy machine all was done before the signal came: once more, from the beginning.
            shutil.rmtree(out)
            code, rounds, missed = 128 + number, 0, missed + 1
    assert rounds > 1
    assert results(out) == whole


@soak
def test_a_second_signal_ends_at_once(scene, tmp_path):
    token, out = secrets.token_hex(8), tmp_path / "out"
    with go(scene, out, token) as run:
        run.stdout.readline()
        for _ in range(2):
            run.send_signal(signal.SIGINT)
            run.send_signal(signal.SIGTERM)
        _, errors = run.communicate(timeout=60.0)
    assert run.returncode in (128 + signal.SIGINT, 128 + signal.SIGTERM)
    assert "Traceback" not in errors
    assert all_gone(token)
    assert left_over(out) == []


@soak
def test_a_worker_killed_from_outside_costs_its_row(scene, tmp_path):
    token, out = secrets.token_hex(8), tmp_path / "out"
    with go(scene, out, token) as run:
        run.stdout.readline()
        worker = next(pid for pid in alive(token) if pid != run.pid)
        os.kill(worker, signal.SIGKILL)
        _, errors = run.communicate(timeout=60.0)
    lines = summary(out)
    lost = [line for line in lines if line["verdict"] == "crashed"]
    # It may have been between two rows, or had none left.
    assert len(lost) <= 1
    assert run.returncode == len(lost), errors
    assert all("signal 9" in line["reasons"] for line in lost)
    assert len(results(out)) == ROWS - len(lost)
