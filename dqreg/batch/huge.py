"""One huge registration on a cluster: chunks of the scan stay on the workers, one small matrix a step comes back.

The cost of points to planes is a quadratic form of the pose that adds up over points, and so do the sums from which
the width of the kernel is learned. A step of the last stage is therefore the same whether one machine takes it over
the whole scan or many take it over chunks; only the order of the sums differs.
"""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from dqreg.batch.huge_stage import STAGE, Stage
from dqreg.batch.sums import measure, split, total
from dqreg.errors import InputError

if TYPE_CHECKING:
    from dqreg.prepared import Target
    from dqreg.result import Registration


def register_huge(
    source: Any,
    target: Any,
    start: Any = None,
    *,
    scheduler: str | None = None,
    chunks: int | None = None,
    **options: Any,
) -> Registration:
    """Register with every point of the scan in the last stage, shared out over a Dask cluster.

    The pose is found on this machine first, as `dqreg.register` does. Then chunks of the scan go to the workers once,
    and each step sends them a pose and brings back one 13x13 matrix a chunk. The pose is the same for any number of
    chunks, on the cluster or off it, to the rounding of the sums.

    Parameters
    ----------
    source, target, start
        As in `dqreg.register`.
    scheduler : str, optional
        Address of a Dask scheduler; without one the chunks are worked off here.
    chunks : int, optional
        Default: one a thread of the cluster, or one here.
    **options
        Of `dqreg.register`; ``method`` must be "auto" or "plane".

    Returns
    -------
    Registration
        With the pose, rms and share of inliers of all points. Verdict, covariance and observability are those of the
        stage before, on fewer points: the covariance is too large rather than too small.

    Raises
    ------
    InputError
        As in `dqreg.register`; if the cluster cannot be used; for ``dof`` and ``prior``, which the last stage here
        does not know.

    Examples
    --------
    >>> from dqreg.geometry import Mesh, sample_mesh
    >>> from dqreg.synth.parts import bracket
    >>> part = Mesh(*bracket())
    >>> scan = sample_mesh(part, 5_000, np.random.default_rng(0))
    >>> result = register_huge(scan.points, part, "identity", chunks=3)
    >>> bool(np.abs(result.T_target_source - np.eye(4)).max() < 1e-9), result.history[-1].points
    (True, 5000)
    """
    from dqreg.prepared import Target, prepare_target
    from dqreg.register import register

    if options.get("method", "auto") not in ("auto", "plane"):
        raise InputError(f'method must be "auto" or "plane" here; got {options["method"]!r}')
    known = [name for name in ("dof", "prior") if options.get(name) is not None]
    if known:
        raise InputError(f"{known[0]} is not known to the chunked last stage; use dqreg.register with effort='best'")
    if chunks is not None and chunks < 1:
        raise InputError(f"chunks must be 1 or more; got {chunks!r}")
    prepared = target if isinstance(target, Target) else prepare_target(target)
    kept = options.pop("keep_inputs", True)
    first = register(source, prepared, start, **options, keep_inputs=True)
    if np.isfinite(first.T_target_source).all():
        first = _refined(first, prepared, scheduler, chunks)
    return first if kept else dataclasses.replace(first, inputs=None)


def _refined(first: Registration, target: Target, scheduler: str | None, chunks: int | None) -> Registration:
    from dqreg.answer import from_work, to_work
    from dqreg.geometry import prepare_scan
    from dqreg.icp import COARSE, InlierMixture

    began = time.perf_counter()
    assert first.inputs is not None
    source, indexed, told = first.inputs.source, target.indexed, first.settings
    scan = prepare_scan(source.cloud, COARSE)
    T = to_work(first.T_target_source, indexed.origin, source.origin)
    share = float(np.clip(first.inlier_fraction, 0.01, 0.99))
    mixture = InlierMixture(told["width"], share, told["max_distance"])
    angle = float(np.deg2rad(told["max_angle_deg"]))
    count = len(first.history)
    if scheduler is None:
        parts, surface = split(scan, chunks or 1), indexed.surface
        stage = Stage(scan, indexed.surface, lambda question: total([measure(p, surface, question) for p in parts]))
        end = stage.descend(T, mixture, angle, count)
    else:
        from dqreg.batch.chunks import on_workers

        with on_workers(scheduler, scan, indexed, chunks) as ask:
            stage = Stage(scan, indexed.surface, lambda question: total(ask(question)))
            end = stage.descend(T, mixture, angle, count)
    if not end.history:
        return dataclasses.replace(first, status=end.status)
    last = end.history[-1]
    seconds = time.perf_counter() - began
    back = [
        dataclasses.replace(each, T_target_source=from_work(each.T_target_source, indexed.origin, source.origin))
        for each in end.history
    ]
    return dataclasses.replace(
        first,
        T_target_source=from_work(end.T_target_source, indexed.origin, source.origin),
        status=end.status,
        history=(*first.history, *back),
        rms=last.rms,
        inlier_fraction=last.inlier_fraction,
        timings={**first.timings, STAGE: seconds, "total": first.timings["total"] + seconds},
        settings={**told, "used_points": last.points, "width": last.scale},
    )
