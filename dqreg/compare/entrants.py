"""Who takes part: engines by name, from a file, or as objects; and how a worker process gets hold of them."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import importlib.util
import os
import pickle
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dqreg.compare.engines.protocol import Setting
from dqreg.errors import InputError


@dataclasses.dataclass(frozen=True)
class Entrant:
    """An engine, and where a worker finds it."""

    name: str  # Shown in tables
    needs: tuple[str, ...]  # Distributions that it needs
    from_nothing: bool  # Whether it can do without a start
    settings: tuple[Setting, ...]  # Fair settings it takes part in
    place: str  # "registry", "object", or the path of a Python file
    engine: Any = None  # The engine itself, for "object"

    @property
    def missing(self) -> tuple[str, ...]:
        """Needed distributions that are not installed."""
        return tuple(name for name in self.needs if not _installed(name))

    def load(self) -> Any:
        """Get the engine."""
        if self.place == "object":
            return self.engine
        if self.place == "registry":
            from dqreg.compare.engines.registry import engine

            return engine(self.name)
        return next(found for found in _in_file(Path(self.place)) if found.name == self.name)


def entrants(engines: Iterable[Any] | None) -> list[Entrant]:
    """Engines that shall take part."""
    found: list[Entrant] = []
    if engines is None:
        from dqreg.compare.engines.registry import ENGINES

        engines = list(ENGINES)
    for item in engines:
        found.extend(_resolve(item))
    by_name: dict[str, Entrant] = {}
    for entrant in found:
        if entrant.name in by_name and by_name[entrant.name] != entrant:
            raise InputError(f"two different engines have the name {entrant.name!r}; rename one of them")
        by_name[entrant.name] = entrant
    if not by_name:
        raise InputError("no engine takes part; name at least one")
    return list(by_name.values())


def check_sendable(entrant: Entrant) -> None:
    """Raise unless an engine can be handed to a worker process."""
    try:
        pickle.dumps(entrant)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"the engine {entrant.name!r} cannot be sent to a worker process ({error}); put it into a file of its own "
            "and give the file's path instead, or pass isolate=False"
        ) from error


def _resolve(item: Any) -> list[Entrant]:
    if isinstance(item, os.PathLike) or (isinstance(item, str) and item.endswith(".py")):
        path = Path(item).resolve()
        return [_entrant(engine, str(path)) for engine in _in_file(path)]
    if isinstance(item, str):
        from dqreg.compare.engines.registry import engine

        return [_entrant(engine(item), "registry")]
    if not _is_engine(item):
        raise InputError(f"not an engine: {item!r}; an engine has a name and a method register(task)")
    return [_entrant(item, "object")]


def _entrant(engine: Any, place: str) -> Entrant:
    return Entrant(
        name=engine.name,
        needs=tuple(getattr(engine, "needs", ())),
        from_nothing=bool(getattr(engine, "from_nothing", False)),
        settings=tuple(getattr(engine, "settings", ("manual",))),
        place=place,
        engine=engine if place == "object" else None,
    )


def _in_file(path: Path) -> list[Any]:
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
    except Exception as error:  # whatever a stranger's file raises
        raise InputError(f"--engine-file {path}: {type(error).__name__}: {error}") from error
    found = {id(value): value for value in vars(module).values() if _is_engine(value)}
    if not found:
        raise InputError(
            f"--engine-file {path} holds no engine; needed: an object with a name and a method register(task)"
        )
    return list(found.values())


def _is_engine(value: Any) -> bool:
    return (
        not isinstance(value, type)
        and isinstance(getattr(value, "name", None), str)
        and callable(getattr(value, "register", None))
    )


def _installed(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True
