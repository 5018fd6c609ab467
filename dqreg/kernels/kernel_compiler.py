"""How Numba compiles a kernel: of its passes those that a kernel needs, and next to no search for garbage."""

from __future__ import annotations

from typing import Any

from numba.core import typed_passes as typed
from numba.core import untyped_passes as untyped
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager

from dqreg.kernels.garbage import not_collected

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


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """What Numba asks for the passes of one function."""

    def compile_extra(self, function: Any) -> Any:
        """The compiled function."""
        with not_collected():
            return super().compile_extra(function)

    def define_pipelines(self) -> list[PassManager]:
        """One list of passes, without another way where it fails."""
        passes = PassManager("kernel")
        for each in PASSES:
            passes.add_pass(each, each.name())
        passes.finalize()
        return [passes]
