"""The compiled steps of a kind as object files that need no Python.

numba compiles a step to LLVM's intermediate language. Scalars in and out of plain arrays leave
nothing in it that calls Python: only the wrapper by which Python would call it does, and that is
dropped. LLVM then writes object files for any processor, here for the oldest of each family, so
that no newer instruction is needed where the model runs.
"""

from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba import carray, cfunc, njit, types  # type: ignore[attr-defined]

from ematwin.models.stepped import Stepped
from ematwin.numerics.compile import RELAXED


class Platform(NamedTuple):
    """A platform by the names that FMI 3 and FMI 2 give it, and LLVM's."""

    name: str
    name_2: str
    triple: str
    processor: str
    library: str  # ending of a shared library


PLATFORMS = (
    Platform("x86_64-linux", "linux64", "x86_64-pc-linux-gnu", "x86-64", ".so"),
    Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu", "generic", ".so"),
    Platform("x86_64-windows", "win64", "x86_64-pc-windows-msvc", "x86-64", ".dll"),
    Platform("x86_64-darwin", "darwin64", "x86_64-apple-darwin", "x86-64", ".dylib"),
    Platform("aarch64-darwin", "aarch64-darwin", "arm64-apple-darwin", "apple-m1", ".dylib"),
)


def compiled(stepped: Stepped, constants_from: Any, parameters: int) -> Any:
    """An LLVM module with the steps of a kind as functions of pointers.

    ``ematwin_constants(p, c)``, ``ematwin_begin(c, u, x)``, ``ematwin_sample(c, x, u, n, y)`` and
    ``ematwin_advance(c, x, u)``, each with two pointers before: where numba puts a result and an
    exception. There is none of either. ``constants_from`` is ``(p, c)`` as of
    `ematwin.fmu.variables.followed`, ``parameters`` the number of values in ``p``.
    """
    sizes = {
        "p": parameters, "c": stepped.constant_count, "x": stepped.state_count,
        "y": len(stepped.outputs), "u": 2,  # whether the kind takes a load or not
    }  # fmt: skip
    followed = njit(inline="always", error_model="numpy")(constants_from)
    module = _module("constants", followed, "pc", sizes)
    module.link_in(_module("begin", stepped.begin, "cux", sizes))
    module.link_in(_module("advance", stepped.advance, "cxu", sizes))
    module.link_in(_module("sample", stepped.sample, "cxuny", sizes))
    return module


def object_file(module: Any, platform: Platform) -> bytes:
    """Machine code of a module, position-independent."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    text = "\n".join(
        line for line in str(module).splitlines()
        if not line.startswith(("target triple", "target datalayout"))
    )  # fmt: skip
    own = llvm.parse_assembly(text)
    own.triple = platform.triple
    machine = llvm.Target.from_triple(platform.triple).create_target_machine(
        cpu=platform.processor, opt=3, reloc="pic", codemodel="small"
    )
    own.data_layout = str(machine.target_data)
    return bytes(machine.emit_object(own))


def _module(name: str, step: Any, arguments: str, sizes: dict[str, int]) -> Any:
    """The module of one function; its Python wrapper is gone, and what that alone needed.

    ``arguments`` are letters of arrays, whose lengths are ``sizes``, and of the sample ``n``.
    """
    given = [one if one == "n" else f"carray({one}, ({sizes[one]}, 1))" for one in arguments]
    source = f"def function({', '.join(arguments)}): step({', '.join(given)})"
    names = {"carray": carray, "step": step}
    exec(source, names)  # as `typing.NamedTuple` makes its classes
    values = types.CPointer(types.float64)
    signature = types.void(*(types.int64 if one == "n" else values for one in arguments))
    made = cfunc(signature, error_model="numpy", fastmath=RELAXED)(names["function"])
    module = llvm.parse_assembly(made.inspect_llvm())
    wrapper = made.native_name
    module.get_function(wrapper).linkage = "internal"
    module.get_function(wrapper.removeprefix("cfunc.")).name = f"ematwin_{name}"
    builder = llvm.create_pass_builder(
        llvm.Target.from_default_triple().create_target_machine(),
        llvm.PipelineTuningOptions(speed_level=0),
    )
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, builder)
    return module
