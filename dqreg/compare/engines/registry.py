"""All engines by name."""

from __future__ import annotations

import difflib
import importlib.metadata
from collections.abc import Mapping
from types import MappingProxyType

from dqreg.compare.engines.kiss_icp import KissIcpMap
from dqreg.compare.engines.kiss_matcher import KissMatcher
from dqreg.compare.engines.open3d_global import Open3dGlobal
from dqreg.compare.engines.open3d_icp import Open3dIcp, Open3dNdt
from dqreg.compare.engines.open3d_tensor import Open3dTensor
from dqreg.compare.engines.ours import Dqreg, DqregLoop
from dqreg.compare.engines.protocol import Engine
from dqreg.compare.engines.simpleicp import SimpleIcp
from dqreg.compare.engines.small_gicp import SmallGicp
from dqreg.compare.engines.trimesh import TrimeshIcp, TrimeshMeshOther
from dqreg.errors import InputError

_ALL: tuple[Engine, ...] = (
    Dqreg(),
    Dqreg("dqreg fast", effort="fast"),
    Dqreg("dqreg best", effort="best"),
    DqregLoop("dqreg loop dq", "dq"),
    DqregLoop("dqreg loop dq accelerated", "dq", accelerate=True, settings=("same-loop",)),
    DqregLoop("dqreg loop dq-points", "dq-points"),
    DqregLoop("dqreg loop svd", "svd"),
    DqregLoop("dqreg loop plane", "plane"),
    Open3dIcp("open3d point-to-point", "point-to-point"),
    Open3dIcp("open3d point-to-plane", "point-to-plane"),
    Open3dIcp("open3d symmetric", "symmetric"),
    Open3dIcp("open3d generalised", "generalized"),
    Open3dNdt(),
    Open3dTensor(),
    Open3dGlobal("open3d fpfh+ransac", "ransac"),
    Open3dGlobal("open3d fpfh+fgr", "fgr"),
    SmallGicp("small_gicp icp", "ICP"),
    SmallGicp("small_gicp plane", "PLANE_ICP"),
    SmallGicp("small_gicp gicp", "GICP"),
    SmallGicp("small_gicp vgicp", "VGICP"),
    KissIcpMap(),
    TrimeshIcp("trimesh icp", shipped=False),
    TrimeshIcp("trimesh icp as shipped", shipped=True),
    TrimeshMeshOther("trimesh mesh_other", shipped=False),
    TrimeshMeshOther("trimesh mesh_other as shipped", shipped=True),
    SimpleIcp(),
    KissMatcher("kiss-matcher"),
    KissMatcher("kiss-matcher + gicp", refined=True, needs=("kiss-matcher", "small-gicp")),
)

# Read-only: an engine of one's own is passed as an object, so that it also reaches processes that know only this list.
ENGINES: Mapping[str, Engine] = MappingProxyType({item.name: item for item in _ALL})


def engine(name: str | Engine) -> Engine:
    """An engine by its name; an engine itself is passed through."""
    if not isinstance(name, str):
        if isinstance(getattr(name, "name", None), str) and callable(getattr(name, "register", None)):
            return name
        raise InputError(f"not an engine: {name!r}; an engine has a name and a method register(task)")
    if name in ENGINES:
        return ENGINES[name]
    near = difflib.get_close_matches(name.lower(), list(ENGINES), n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(ENGINES)}"
    raise InputError(f"there is no engine {name!r}; {hint}")


def available() -> tuple[str, ...]:
    """Names of the engines whose packages are installed."""
    return tuple(name for name, item in ENGINES.items() if not missing(item))


def missing(item: Engine) -> tuple[str, ...]:
    """Distributions that an engine needs and that are not installed."""
    return tuple(need for need in item.needs if not _installed(need))


def _installed(distribution: str) -> bool:
    try:
        importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True
