"""What the runs of an engine depend on beside their task: its code, dqreg's own, and the versions of what they use."""

from __future__ import annotations

import functools
import hashlib
import pickle
import sys
import sysconfig
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from dqreg.compare.engines.registry import OURS, EngineSpec, module_of
from dqreg.compare.environment import ALWAYS, installed_versions

PACKAGE = Path(__file__).parents[1]
# What of dqreg the runs of a peer depend on: how it is called, and the tasks that it is given.
OF_PEERS = ("compare/engines", "compare/case.py", "compare/sweep_tasks.py", "synth", "geometry", "rigid")
INSTALLED = frozenset({"site-packages", "dist-packages"})


def identity(spec: EngineSpec) -> str:
    """Digest of an engine: runs with another one are of other code.

    A method of one's own is its file and the files of one's own that it imports at its top. One that stands in no file,
    as in a notebook, is another each time.
    """
    found = hashlib.blake2b(sys.version.encode(), digest_size=8)
    for name, version in sorted(installed_versions((*ALWAYS, *spec.needs)).items()):
        found.update(f"{name} {version}\n".encode())
    peer = spec.origin == "registry" and spec.name not in OURS
    found.update(_code(OF_PEERS if peer else ("",)).encode())
    for path in sorted(_own_files(spec)):
        found.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    if spec.origin == "object":
        found.update(_state(spec))
    return found.hexdigest()


@functools.cache
def _code(places: tuple[str, ...]) -> str:
    """Digest of the sources in some places of the package."""
    found = hashlib.blake2b()
    for place in (PACKAGE / name for name in places):
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            found.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()


def _own_files(spec: EngineSpec) -> set[Path]:
    """Files that hold a method of one's own."""
    if spec.origin == "registry":
        return set()
    first = sys.modules.get(type(spec.engine).__module__) if spec.origin == "object" else module_of(Path(spec.origin))
    seen: dict[str, ModuleType] = {}
    left = [first]
    while left:
        module = left.pop()
        if module is None or module.__name__ in seen or _file(module) is None:
            continue
        # Of an installed package the module of the engine itself stands for its version.
        if module is first or _is_own(module):
            seen[module.__name__] = module
            left.extend(_named_in(module))
    return {path for module in seen.values() if (path := _file(module)) is not None}


def _named_in(module: ModuleType) -> Iterator[ModuleType | None]:
    """Modules that a module names at its top, or of whose contents it names some."""
    for value in vars(module).values():
        if isinstance(value, ModuleType):
            yield value
        elif isinstance(home := getattr(value, "__module__", None), str):
            yield sys.modules.get(home)


def _file(module: ModuleType) -> Path | None:
    name = getattr(module, "__file__", None)
    return Path(name).resolve() if isinstance(name, str) and Path(name).is_file() else None


def _is_own(module: ModuleType) -> bool:
    """Whether a module is a file that belongs to no installed package, to neither Python nor dqreg."""
    path = _file(module)
    if path is None:
        return False
    homes = (PACKAGE, *(Path(sysconfig.get_paths()[key]).resolve() for key in ("stdlib", "platstdlib")))
    return not INSTALLED & set(path.parts) and not any(path.is_relative_to(home) for home in homes)


def _state(spec: EngineSpec) -> bytes:
    """The parameters of an object; what tells nothing apart where it cannot be packed."""
    if not _own_files(spec):
        return uuid.uuid4().bytes
    try:
        return pickle.dumps(spec.engine)
    except (pickle.PicklingError, AttributeError, TypeError):
        return b""
