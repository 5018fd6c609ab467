"""Engines by name, from a file, or as objects, and how a worker process gets hold of them."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import pickle
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from dqreg.compare.engines.clouds import STAGED_DISTANCES
from dqreg.compare.engines.kiss_icp import KissIcpMap
from dqreg.compare.engines.kiss_matcher import KissMatcher
from dqreg.compare.engines.open3d_global import Open3dGlobal
from dqreg.compare.engines.open3d_icp import Open3dIcp, Open3dNdt
from dqreg.compare.engines.open3d_tensor import Open3dTensor
from dqreg.compare.engines.ours import Dqreg, DqregLoop
from dqreg.compare.engines.protocol import Engine, Setting
from dqreg.compare.engines.simpleicp import SimpleIcp
from dqreg.compare.engines.small_gicp import SmallGicp
from dqreg.compare.engines.trimesh import TrimeshIcp, TrimeshMeshOther
from dqreg.errors import InputError, did_you_mean
from dqreg.files.code_identity import installed_versions

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
    Open3dIcp("open3d point-to-plane staged", "point-to-plane", settings=("manual",), stages=STAGED_DISTANCES),
    Open3dIcp(
        "open3d point-to-plane robust", "point-to-plane", settings=("manual",), stages=STAGED_DISTANCES[:1], robust=True
    ),
    Open3dIcp("open3d symmetric", "symmetric"),
    Open3dIcp("open3d generalised", "generalized"),
    Open3dNdt(),
    Open3dTensor(),
    Open3dGlobal("open3d fpfh+ransac", "ransac"),
    Open3dGlobal("open3d fpfh+fgr", "fgr"),
    SmallGicp("small_gicp icp", "ICP"),
    SmallGicp("small_gicp plane", "PLANE_ICP"),
    SmallGicp("small_gicp plane staged", "PLANE_ICP", settings=("manual",), stages=STAGED_DISTANCES),
    SmallGicp("small_gicp gicp", "GICP"),
    SmallGicp("small_gicp gicp staged", "GICP", settings=("manual",), stages=STAGED_DISTANCES),
    SmallGicp("small_gicp gicp fine", "GICP", settings=("manual",), downsampling_share=1.0 / 400.0, samples=200_000),
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
# Names of those that are dqreg itself.
OURS = frozenset(item.name for item in _ALL if isinstance(item, (Dqreg, DqregLoop)))


@dataclasses.dataclass(frozen=True)
class EngineSpec:
    """An engine that takes part in a comparison, and where a worker process finds it."""

    name: str  # Shown in tables
    needs: tuple[str, ...]  # Distributions that it needs
    needs_initial_pose: bool
    settings: tuple[Setting, ...]  # Settings it takes part in
    origin: str  # "registry", "object", or the path of a Python file
    engine: Any = None  # The engine itself, for "object"
    identity: str = ""  # Tells its code from all other; see `dqreg.compare.identity`

    @classmethod
    def of(cls, engine: Any, origin: str) -> EngineSpec:
        """Spec of an engine; what it does not say has the defaults of the protocol."""
        return cls(
            name=engine.name,
            needs=tuple(getattr(engine, "needs", ())),
            needs_initial_pose=bool(getattr(engine, "needs_initial_pose", True)),
            settings=tuple(getattr(engine, "settings", ("manual",))),
            origin=origin,
            engine=engine if origin == "object" else None,
        )

    def load(self) -> Any:
        """The engine."""
        if self.origin == "object":
            return self.engine
        if self.origin == "registry":
            return ENGINES[self.name]
        return next(found for found in _engines_in(Path(self.origin)) if found.name == self.name)

    def require_picklable(self) -> None:
        """Raise unless the engine can be sent to a worker process."""
        try:
            pickle.dumps(self)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InputError(
                f"the engine {self.name!r} cannot be sent to a worker process ({error}); put it into a file of its own "
                "and give the file's path instead, or pass isolate=False"
            ) from error


def engine(name: str | Engine) -> Engine:
    """An engine by its name; an engine itself is passed through."""
    if not isinstance(name, str):
        if _is_engine(name):
            return name
        raise InputError(f"not an engine: {name!r}; an engine has a name and a method register(task)")
    if name in ENGINES:
        return ENGINES[name]
    hint = did_you_mean(name, ENGINES) or f"; known are {', '.join(ENGINES)}"
    raise InputError(f"there is no engine {name!r}{hint}")


def engine_specs(engines: Iterable[Any] | None) -> list[EngineSpec]:
    """Engines by name, as objects, or as Python files that hold some; None takes all that come with dqreg."""
    by_name: dict[str, EngineSpec] = {}
    for spec in (spec for item in (ENGINES if engines is None else engines) for spec in _specs(item)):
        if by_name.setdefault(spec.name, spec) != spec:
            raise InputError(f"two different engines have the name {spec.name!r}; rename one of them")
    if not by_name:
        raise InputError("no engine takes part; name at least one")
    return list(by_name.values())


def available() -> tuple[str, ...]:
    """Names of the engines whose packages are installed."""
    return tuple(name for name, item in ENGINES.items() if not missing(item))


def missing(item: Engine | EngineSpec) -> tuple[str, ...]:
    """Distributions that an engine needs and that are not installed."""
    found = installed_versions(item.needs)
    return tuple(need for need in item.needs if need not in found)


def _specs(item: Any) -> list[EngineSpec]:
    if isinstance(item, os.PathLike) or (isinstance(item, str) and item.endswith(".py")):
        path = Path(item).resolve()
        return [EngineSpec.of(found, str(path)) for found in _engines_in(path)]
    return [EngineSpec.of(engine(item), "registry" if isinstance(item, str) else "object")]


def module_of(path: Path) -> ModuleType:
    """A Python file that holds engines, run anew."""
    if not path.is_file():
        raise InputError(f"--engine-file: there is no file {path}")
    name = f"dqreg_engine_file_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"--engine-file {path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file raises
        raise InputError(f"--engine-file {path}: {type(error).__name__}: {error}") from error
    return module


def _engines_in(path: Path) -> list[Any]:
    """Engines at the top of a Python file."""
    held = vars(module_of(path)).values()
    found = {id(value): value for value in held if _is_engine(value)}
    if not found:
        kinds = [
            value.__name__ for value in held if isinstance(value, type) and callable(getattr(value, "register", 0))
        ]
        hint = f"; make one of its class: ENGINE = {kinds[-1]}()" if kinds else ""
        raise InputError(
            f"--engine-file {path} holds no engine; needed: an object with a name and a method register(task){hint}"
        )
    return list(found.values())


def _is_engine(value: Any) -> bool:
    return (
        not isinstance(value, type)
        and isinstance(getattr(value, "name", None), str)
        and callable(getattr(value, "register", None))
    )
