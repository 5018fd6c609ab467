"""What the runs of an engine depend on beside their task: its code, dqreg's own, and the versions of what they use."""

from __future__ import annotations

import hashlib
import io
import pickle
import sys
import sysconfig
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from dqreg.compare.engines.registry import OURS, EngineSpec, module_of
from dqreg.files.code_identity import PACKAGE, code_identity

# What of dqreg the runs of a peer depend on: how it is called, and the tasks that it is given.
OF_PEERS = ("compare/engines", "compare/case.py", "compare/sweep_tasks.py", "synth", "geometry", "rigid")
INSTALLED = frozenset({"site-packages", "dist-packages"})
# Begins the identity of an engine that cannot be told from others.
UNTOLD = "untold "


def identity(spec: EngineSpec) -> str:
    """Digest of an engine: runs with another one are of other code.

    A method of one's own is its file and the files of one's own that it imports at its top. An object is what it holds,
    and the files of all classes and functions in it. One that cannot be packed, or has code in no file, as in a
    notebook, is another each time.
    """
    peer = spec.origin == "registry" and spec.name not in OURS
    found = hashlib.blake2b(code_identity(OF_PEERS if peer else ("",), spec.needs).encode(), digest_size=8)
    files: set[Path] = set()
    if spec.origin == "object":
        held = _Held(spec.engine)
        if not held.told:
            return UNTOLD + uuid.uuid4().hex
        found.update(held.values)
        files = _with_imports([sys.modules[name] for name in held.modules])
    elif spec.origin != "registry":
        files = _with_imports([module_of(Path(spec.origin))])
    for path in sorted(files):
        found.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


class _Held(pickle.Pickler):
    """Values of an object and of its class, and the modules in which its classes and functions stand."""

    def __init__(self, engine: Any) -> None:
        self._stream = io.BytesIO()
        super().__init__(self._stream)
        self.modules: set[str] = set()
        try:
            self.dump(engine)
            for kind in type(engine).__mro__:
                if _is_own(sys.modules.get(kind.__module__)):
                    self.dump({name: value for name, value in vars(kind).items() if _is_parameter(name, value)})
        except Exception:  # whatever an object of somebody's own raises
            self.told = False
        else:
            self.told = all(map(_stands_in_a_file, self.modules))
        self.values = self._stream.getvalue()

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, (type, FunctionType)):
            self.modules.add(value.__module__)
        return NotImplemented


def _is_parameter(name: str, value: Any) -> bool:
    """Whether an attribute of a class is none of its methods, nor of what Python keeps in it."""
    return not (name.startswith(("__", "_abc_")) or hasattr(value, "__get__"))


def _stands_in_a_file(name: str) -> bool:
    module = sys.modules.get(name)
    return module is not None and (name.partition(".")[0] in sys.stdlib_module_names or _file(module) is not None)


def _with_imports(first: list[ModuleType]) -> set[Path]:
    """Files of modules, and of those of one's own that they name."""
    seen: dict[str, ModuleType] = {}
    left: list[ModuleType | None] = [*first]
    while left:
        module = left.pop()
        if module is None or module.__name__ in seen or _file(module) is None:
            continue
        # Of an installed package the module itself stands for its version.
        if module in first or _is_own(module):
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


def _is_own(module: ModuleType | None) -> bool:
    """Whether a module is a file that belongs to no installed package, to neither Python nor dqreg."""
    path = None if module is None else _file(module)
    if path is None:
        return False
    homes = (PACKAGE, *(Path(sysconfig.get_paths()[key]).resolve() for key in ("stdlib", "platstdlib")))
    return not INSTALLED & set(path.parts) and not any(path.is_relative_to(home) for home in homes)
