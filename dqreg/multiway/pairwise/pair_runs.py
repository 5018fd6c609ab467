"""The registrations of the pairs: in threads, within a time limit, kept on disk as they end."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import cached_property
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._numbers import is_whole
from dqreg.errors import DqregError, InputError, UnitsError
from dqreg.files.code_identity import code_identity
from dqreg.multiway.pose_graph.edges import PART, Edge
from dqreg.multiway.scans.kept_pairs import digest_of_part, keep, kept
from dqreg.multiway.scans.scans import View
from dqreg.registration.initial_pose import drop_pairs
from dqreg.registration.options.options import Effort
from dqreg.registration.register import register
from dqreg.registration.result.empty_results import without_pose
from dqreg.registration.target import Target
from dqreg.report.work_bar import TimeLeft
from dqreg.trust.records import Code, Reason


@dataclasses.dataclass(frozen=True)
class PairJob:
    """A pair to register."""

    target: int  # -1 is the part
    source: int
    start: FloatArray | None = None  # (4, 4): T_target_source to begin at; None searches
    near: bool = False  # Whether other pairs say where it is: what lies elsewhere is not looked for


@dataclasses.dataclass(frozen=True)
class Progress:
    """How far a multiway registration is.

    Attributes
    ----------
    done, total : int
        Pairs registered so far, and known so far to be needed.
    seconds_left : float
        Estimate for the remaining ones; NaN before the first is done.
    edge : Edge
        The pair that ended last; of a scan that was registered to several at once, the settings of the registration
        hold their numbers as ``against``.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, sample_mesh
    >>> from dqreg.multiway import register_many
    >>> from dqreg.synth.parts import bracket
    >>> part, rng, seen = Mesh(*bracket()), np.random.default_rng(0), []
    >>> scans = [sample_mesh(part, 800, rng) for _ in range(2)]
    >>> _ = register_many(scans, starts=[np.eye(4)] * 2, effort="fast", workers=1, observe=seen.append)
    >>> seen[-1].done, seen[-1].total, (seen[-1].edge.target, seen[-1].edge.source)
    (1, 1, (0, 1))
    """

    done: int
    total: int
    seconds_left: float
    edge: Edge


@dataclasses.dataclass
class PairRunner:
    """Registers pairs; counts them, and stops when asked or when the time is up."""

    views: Sequence[View]
    part: Target | None
    effort: Effort
    seed: int
    workers: int
    deadline: float  # Of `time.perf_counter`
    observe: Callable[[Progress], object] | None
    folder: Path | None
    done: int = 0
    total: int = 0
    stopped: str = ""  # Why no further pair is begun

    def run(self, jobs: Sequence[PairJob]) -> list[Edge]:
        """Edges in the order of the jobs; those not begun in time are "untried" and have no pose."""
        self.total += len(jobs)
        left = TimeLeft([("", len(jobs))])
        found: dict[int, Edge] = {}
        waiting = list(range(len(jobs)))
        began = time.perf_counter()
        with ThreadPoolExecutor(self.workers) as pool:
            running: dict[Future[Edge], int] = {}
            while (waiting and not self.is_over()) or running:
                while waiting and len(running) < self.workers and not self.is_over():
                    row = waiting.pop(0)
                    running[pool.submit(self._edge, jobs[row])] = row
                ended, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    row = running.pop(future)
                    found[row] = future.result()
                    self.done += 1
                    left.done("", 1.0, (time.perf_counter() - began) / len(found))
                    self._tell(found[row], left.seconds)
                    if all(jobs[k].target != jobs[row].target for k in (*waiting, *running.values())):
                        self._drop_tables(jobs[row].target)
        return [found.get(row) or _untried(job, self.stopped) for row, job in enumerate(jobs)]

    def _drop_tables(self, target: int) -> None:
        """Free what the search made of a scan after its last pair: of each of many scans it would stay to the end."""
        if target != PART and (prepared := self.views[target].target) is not None:
            drop_pairs(prepared.indexed)

    def count(self, edge: Edge) -> None:
        """Count and tell a registration that was made elsewhere, as one to several scans at once."""
        self.total += 1
        self.done += 1
        self._tell(edge, np.nan)

    def is_over(self) -> bool:
        """Whether no further pair is to be begun."""
        if not self.stopped and time.perf_counter() >= self.deadline:
            self.stopped = "the time limit"
        return bool(self.stopped)

    def _tell(self, edge: Edge, seconds_left: float) -> None:
        if self.observe is not None and self.observe(Progress(self.done, self.total, seconds_left, edge)) is False:
            self.stopped = "the observer"

    def _edge(self, job: PairJob) -> Edge:
        finished = None if self.folder is None else kept(self._file(job), self._fingerprint(job))
        if finished is not None:
            return Edge(job.target, job.source, finished)
        target = self.part if job.target == PART else self.views[job.target].target
        assert target is not None
        limit = self.deadline - time.perf_counter()
        try:
            result = register(
                self.views[job.source].cloud,
                target,
                job.start,
                effort=self.effort,
                seed=self.seed,
                search="never" if job.near else "doubt",
                time_limit=max(limit, 1e-3) if np.isfinite(limit) else None,
                keep_inputs=False,
                units="check" if job.target == PART else "ignore",
            )
        except UnitsError as error:
            # What it advises beyond this is of one scan.
            return _failed(
                job, f"{str(error).splitlines()[0].split('. ')[0]}. Convert the scans or the part", "unreadable"
            )
        except DqregError as error:
            return _failed(job, str(error), "unreadable")
        result = dataclasses.replace(result, history=())
        if self.folder is not None and not self.is_over():
            keep(self._file(job), result, self._fingerprint(job))
        return Edge(job.target, job.source, result)

    def _fingerprint(self, job: PairJob) -> dict[str, object]:
        start = None if job.start is None else np.round(job.start, 9).tolist()
        return {
            "code": code_identity(),
            "target": self._part_digest if job.target == PART else self.views[job.target].whole_digest,
            "source": self.views[job.source].whole_digest,
            "start": start,
            "effort": self.effort,
            "seed": self.seed,
            "near": job.near,
        }

    @cached_property
    def _part_digest(self) -> str:
        assert self.part is not None
        return digest_of_part(self.part)

    def _file(self, job: PairJob) -> Path:
        assert self.folder is not None
        kind = "search" if job.start is None else "near" if job.near else "start"
        return self.folder / f"{job.target}-{job.source}-{kind}.json"


def workers_of(asked: int | None) -> int:
    """Threads to work in: as many as asked for, else one a core."""
    if asked is None:
        return os.cpu_count() or 1
    if not is_whole(asked) or asked < 1:
        raise InputError(f"workers must be a whole number above 0, or None for one a core; got {asked!r}")
    return int(asked)


def _untried(job: PairJob, why: str) -> Edge:
    return dataclasses.replace(_failed(job, f"not tried before {why}", "search_time_limit"), code="untried")


def _failed(job: PairJob, why: str, code: Code) -> Edge:
    result = without_pose((Reason(f"no pose: {why}", code),), "not run", {})
    return Edge(job.target, job.source, result, code="no_pose")
