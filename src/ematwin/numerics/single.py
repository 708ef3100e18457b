"""A loop in single precision, from the same source as in double.

numba follows numpy: a float32 times a literal such as 0.5 is a float64, so that one literal in a
step takes all that comes after it to double precision, and half of the lanes away. Here literals
and constants are made float32 in a loop once all steps have been inlined into it, before numba
asks for types. What stays double is what the loop holds in arrays of double precision.
"""

import math
from types import ModuleType
from typing import Any

import numpy as np
from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.untyped_passes import InlineInlinables

from ematwin.numerics.tolerance import Tolerance


@register_pass(mutates_CFG=False, analysis_only=False)
class _Literals(FunctionPass):
    """Makes floats that stand in the source float32, and those of `math`."""

    _name = "ematwin_literals_in_single"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        modules: dict[str, ModuleType] = {}  # by the variable that holds one
        for block in state.func_ir.blocks.values():
            for assigned in block.find_insts(ir.Assign):
                value = assigned.value
                if isinstance(value, (ir.Const, ir.Global, ir.FreeVar)):
                    if isinstance(value.value, ModuleType):
                        modules[assigned.target.name] = value.value
                    found = value.value
                elif isinstance(value, ir.Expr) and value.op == "getattr":
                    module = modules.get(value.value.name)
                    found = getattr(math, value.attr) if module is math else None
                else:
                    continue
                if isinstance(found, float):
                    found = found.single if isinstance(found, Tolerance) else found
                    assigned.value = ir.Const(np.float32(found), value.loc)
        return True


class InSingle(CompilerBase):
    """numba's own passes, and the literals between them."""

    def define_pipelines(self) -> list[Any]:  # noqa: D102
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Literals, InlineInlinables)
        passes.finalize()
        return [passes]
