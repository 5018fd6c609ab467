from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numba.core.errors import NumbaError

from dqreg.kernels.compiling import compiled, gc_pause, kernel_compiler


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(compiled, "folders", lambda: ((), None))
    frozen = gc.get_freeze_count()
    yield
    assert gc.isenabled()
    if gc.get_freeze_count() > frozen:
        gc.unfreeze()


def seen_while_compiling(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    seen: list[bool] = []
    infer = kernel_compiler.KernelCompiler.define_pipelines

    def define(self: Any) -> Any:
        seen.append(gc.isenabled())
        return infer(self)

    monkeypatch.setattr(kernel_compiler.KernelCompiler, "define_pipelines", define)
    return seen


@pytest.mark.parametrize("ours", [False, True])
def test_nobody_looks_for_garbage_while_a_kernel_is_compiled(monkeypatch: pytest.MonkeyPatch, ours: bool) -> None:
    monkeypatch.setattr(gc_pause, "_freezes_survivors", ours)
    seen = seen_while_compiling(monkeypatch)
    before = gc.get_freeze_count()
    halved: Any = compiled.compiled(lambda x: x / 2.0)
    assert halved(3.0) == 1.5
    assert seen == [False]
    # A caller's objects are not ours to leave alone.
    assert (gc.get_freeze_count() > before) == ours


def test_after_a_kernel_that_cannot_be_compiled_garbage_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = seen_while_compiling(monkeypatch)
    wrong: Any = compiled.compiled(lambda x: x.nothing)
    with pytest.raises(NumbaError):
        wrong(3.0)
    assert seen == [False]
    assert gc.isenabled()


def test_who_looks_for_no_garbage_goes_on_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gc_pause, "_freezes_survivors", True)
    before = gc.get_freeze_count()
    gc.disable()
    try:
        tripled: Any = compiled.compiled(lambda x: x * 3.0)
        assert tripled(2.0) == 6.0
        assert not gc.isenabled()
        assert gc.get_freeze_count() == before
    finally:
        gc.enable()


def kernel_with_a_function_inside() -> tuple[Any, Any]:
    inside: Any = compiled.inside_kernels(lambda x: x * x + 1.0)
    inside_too: Any = compiled.inside_kernels(lambda x: inside(x) * inside(x + 1.0))
    return compiled.compiled(lambda x: inside_too(x) - inside(x)), inside_too


def test_a_function_inside_kernels_is_kept_for_the_next_kernel_and_has_no_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path,), tmp_path))
    monkeypatch.setattr(compiled.KeptCode, "_file", lambda self, *_: Path(f"{names.index(self)}.code"))
    names: list[Any] = []
    for found in (0, 1):
        kernel, inside = kernel_with_a_function_inside()
        names[:] = [kernel._cache, inside._cache, inside.py_func.__closure__[0].cell_contents._cache]
        assert kernel(3.0) == 10.0 * 17.0 - 10.0
        assert sum(inside.stats.cache_hits.values()) == found
        (result,) = inside.overloads.values()
        engine = result.library.codegen._engine
        # Names of what was kept are known as well.
        assert found or not engine.is_symbol_defined(result.fndesc.llvm_func_name)
        assert engine.get_global_value_address(result.environment.env_name)
        # Another kernel, which is not kept, calls it as well.
        (tmp_path / "0.code").unlink()


def test_of_what_is_kept_the_code_to_link_is_read_where_a_kernel_links_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: ((tmp_path,), tmp_path))
    monkeypatch.setattr(compiled.KeptCode, "_file", lambda self, *_: Path(f"{names.index(self)}.code"))
    read: list[bytes] = []
    parse = kernel_compiler.llvm.parse_bitcode
    monkeypatch.setattr(kernel_compiler.llvm, "parse_bitcode", lambda code: (read.append(code), parse(code))[1])
    names: list[Any] = []
    # Compiled; kept; with the kernel gone, which is compiled anew and links what is inside it, kept, itself.
    for expected in (0, 0, 1):
        kernel, inside = kernel_with_a_function_inside()
        names[:] = [kernel._cache, inside._cache, inside.py_func.__closure__[0].cell_contents._cache]
        read.clear()
        assert kernel(3.0) == 10.0 * 17.0 - 10.0
        assert bool(read) == bool(expected)
        if not expected and sum(kernel.stats.cache_hits.values()):
            (tmp_path / "0.code").unlink()


def test_a_version_of_numba_that_was_not_tried_compiles_by_its_own_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert compiled.compiler("0.59.1") == compiled.compiler("0.69.0rc1") == compiled.compiler("1.0.0") == {}
    assert compiled.compiler("0.60.0") == compiled.compiler("0.68.1") == compiled.COMPILER
    seen = seen_while_compiling(monkeypatch)
    monkeypatch.setattr(compiled, "COMPILER", {})
    halved: Any = compiled.compiled(lambda x: x / 2.0)
    assert (halved(3.0), seen) == (1.5, [])
