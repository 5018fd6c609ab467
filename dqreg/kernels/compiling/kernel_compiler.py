"""How Numba compiles a kernel, by the passes that it needs and code once, for what Python calls; and how it is kept."""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core import typed_passes as typed
from numba.core import untyped_passes as untyped
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult
from numba.core.compiler_machinery import PassManager

from dqreg.kernels.compiling.gc_pause import gc_paused

# Not those for closures, comprehensions, `with`, literals as types and errors with text, which no kernel has, and none
# that annotates for readers: a thirtieth of the time.
PASSES = (
    untyped.TranslateByteCode,
    untyped.FixupArgs,
    untyped.IRProcessing,
    untyped.ReconstructSSA,
    typed.NopythonTypeInference,
    typed.PreLowerStripPhis,
    typed.IRLegalization,
    typed.NativeLowering,
    typed.NoPythonBackend,
)
# What the names of Numba's variables for a function's constants begin with: it looks for them by address.
CONSTANTS = "_ZN08NumbaEnv"


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """What Numba asks for the passes of one function."""

    def compile_extra(self, function: Any) -> Any:
        """The compiled function."""
        with gc_paused():
            return super().compile_extra(function)

    def define_pipelines(self) -> list[PassManager]:
        """One list of passes, without another way where it fails."""
        state = self.state
        library = InsideLibrary if state.flags.no_cpython_wrapper else KernelLibrary
        state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        passes = PassManager("kernel")
        for each in PASSES:
            passes.add_pass(each, each.name())
        passes.finalize()
        return [passes]


class KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A kernel and the functions inside it, optimised once: all together."""

    def _optimize_functions(self, module: Any) -> None:
        # Numba would optimise each function by itself first.
        module.data_layout = self._codegen._data_layout


class InsideLibrary(KernelLibrary):
    """A function that kernels alone call: it is optimised and made machine code inside them."""

    _final_module: Any

    def _optimize_final_module(self) -> None:
        """Leave it to the kernels."""

    def _finalize_final_module(self) -> None:
        function: Any = self._final_module
        names = (v.name for v in function.global_variables if v.name.startswith(CONSTANTS))
        lines = [f'target triple = "{function.triple}"', *(f'@"{name}" = common global i64 0' for name in names)]
        self._final_module = llvm.parse_assembly("\n".join(lines))
        super()._finalize_final_module()
        # What the engine was given lives as long as the library.
        self._in_engine, self._final_module = self._final_module, function


class KeptLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Machine code that was kept. What a new kernel would link is read where there is one: a half of the loading."""

    _bitcode = b""
    _shared_module: Any

    @classmethod
    def load(cls, codegen: Any, name: str, code: bytes, bitcode: bytes, symbols: frozenset[str]) -> KeptLibrary:
        """The library of what `reduced` gave."""
        library = cls(codegen, name)
        library.enable_object_caching()
        library._set_compiled_object(code)
        library._bitcode = bitcode
        library._finalize_final_module()
        codegen._engine._defined_symbols |= symbols
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return self._shared_module


def reduced(code: Any) -> tuple[Any, ...]:
    """A compiled function as what can be pickled."""
    module = code.library._get_module_for_linking()
    symbols = {v.name for of in (module.functions, module.global_variables) for v in of if not v.is_declaration}
    (name, _, data), *others, environments = code._reduce()
    # One without constants is for what is not machine code, and to make it again imports a tenth of a second of Numba.
    environments = tuple(each for each in environments if each.consts)
    return (name, *data, frozenset(symbols)), *others, environments


def rebuilt(context: Any, library: Any, description: Any, environment: Any, *others: Any) -> Any:
    """The compiled function of that, in a target context; as `CompileResult._rebuild` but for its library."""
    signature, object_mode, lifted, annotation, begin, environments = others
    for call in begin:
        call()
    loaded = KeptLibrary.load(context.codegen(), *library)
    for each in environments:
        context.codegen().set_env(each.env_name, each)
    return CompileResult(
        context.typing_context,
        context,
        context.get_executable(loaded, description, environment),
        None,
        annotation,
        signature,
        object_mode,
        lifted,
        description,
        loaded,
        None,
        environment,
        None,
        begin,
        environments,
    )
