"""What numba compiles, and how it is kept; loaded only where something is to be compiled.

numba has no public way to most of this (checked with numba 0.61 to 0.68).
"""

import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba.core import sigutils, types
from numba.core.caching import FunctionCache
from numba.core.environment import Environment, lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.serialize import dumps
from numba.core.typing.templates import Signature
from numba.core.typing.typeof import Purpose, typeof
from numba.extending import intrinsic
from numba.np.numpy_support import from_dtype, map_layout

from ematwin.numerics.cache import NamedByContent
from ematwin.numerics.claim import Claim
from ematwin.numerics.compile import Compiled, key_of
from ematwin.numerics.kinds import kind_of_type
from ematwin.numerics.machine_code import MachineCode, add_symbols
from ematwin.numerics.notice import compiling

# LLVM gives up the vectors of a loop that would have to check more pairs of arrays for overlap. The
# lanes of loops of shorted turns with power have more, and were 8 times slower without vectors.
_OVERLAPS, _USUAL_OVERLAPS, _MOST_OVERLAPS = "vectorize-memory-check-threshold", 128, 4096

# Nor does it take vectors for a loop of fewer than 16 passes that has to be checked so.
_PASSES, _USUAL_PASSES, _FEWEST_PASSES = "vectorizer-min-trip-count", 16, 4

_OF_NUMBA = 1  # the part of a file


def dispatcher_of(compiled: Compiled) -> Any:
    """The dispatcher that numba makes of a function; itself where NUMBA_DISABLE_JIT is set."""
    options = dict(compiled.targetoptions)
    if compiled.single:
        from ematwin.numerics.single import InSingle

        options["pipeline_class"] = InSingle
    made = numba.njit(**options)(compiled.py_func)
    if not hasattr(made, "py_func"):
        return made
    if compiled.interleave:
        made._compiler.compile = _in_lanes(made._compiler.compile, compiled.interleave)
    if compiled.kept:
        vars(made)["typeof_pyval"] = _type_of
        if compiled.files is not None:
            with suppress(RuntimeError):  # numba finds no folder
                made._cache = _Cache(made, compiled.files)
    return made


def _type_of(value: Any) -> types.Type:
    """numba's type of an argument.

    numba asks whether an array is a masked one, and loads `numpy.ma` for that: a seventh of what
    it takes to load numpy and numba.
    """
    if type(value) is np.ndarray:
        return types.Array(
            from_dtype(value.dtype), value.ndim, map_layout(value),
            readonly=not value.flags.writeable,
        )  # fmt: skip
    if isinstance(value, tuple):
        return types.BaseTuple.from_types([_type_of(each) for each in value], type(value))
    return typeof(value, Purpose.argument)


def _in_lanes(compile_it: Callable[..., Any], interleave: int) -> Callable[..., Any]:
    """LLVM takes these as options of the process; numba compiles one function at a time."""
    ours = (
        f"-force-vector-interleave={interleave}",
        f"-{_OVERLAPS}={_MOST_OVERLAPS}",
        f"-{_PASSES}={_FEWEST_PASSES}",
    )
    usual = (
        "-force-vector-interleave=0",
        f"-{_OVERLAPS}={_USUAL_OVERLAPS}",
        f"-{_PASSES}={_USUAL_PASSES}",
    )

    def compile_with_options(*arguments: Any) -> Any:
        for option in ours:
            llvmlite.binding.set_option("ematwin", option)
        try:
            return compile_it(*arguments)
        finally:
            for option in usual:
                llvmlite.binding.set_option("ematwin", option)

    return compile_with_options


@intrinsic
def _wide_vectors(typing_context: Any) -> tuple[Signature, Callable[..., Any]]:
    """A function attribute; see `ematwin.numerics.compile`."""

    def generate(context: Any, builder: Any, signature: Signature, arguments: Any) -> Any:
        # llvmlite refuses attributes with values by name; they are legal LLVM all the same.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), generate


@cache
def wide_vectors() -> types.Type:
    """The type by which numba calls the intrinsic."""
    cpu_target.typing_context.refresh()
    found: types.Type = cpu_target.typing_context.resolve_value_type(_wide_vectors)
    return found


class _Cache(FunctionCache):
    """numba's cache of a function, with files named by their content."""

    def __init__(self, made: Any, files: NamedByContent) -> None:
        super().__init__(made.py_func)
        self._cache_file = files
        self._claim: Claim | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled, without all that numba loads and compiles to compile anything.

        That is most of its start. What machine code needs of numba's runtime beyond C functions was
        linked into it when it was compiled.
        """
        key = self._index_key(sig, None)
        before = self._cache_file.stamp(key)
        found = self._loaded(key, target_context)
        if found is None:
            compiling()
            self._release()  # of what could not be compiled
            self._claim = self._cache_file.claim(key)
            if self._cache_file.stamp(key) != before:  # another process has kept it meanwhile
                found = self._loaded(key, target_context)
        if found is None:
            target_context.refresh()
        else:
            self._release()
        return found

    def _loaded(self, key: str, target_context: Any) -> Any:
        try:
            add_symbols("NRT_", _nrt_python.c_helpers)
            return self._load_kept(key, target_context)
        except Exception:
            target_context.refresh()
            with suppress(Exception):  # sound data that this process cannot use: compile again
                return self._load_kept(key, target_context)
            return None

    def _load_kept(self, key: str, target_context: Any) -> Any:
        """Machine code from disk, its bitcode parsed only where a loop that is compiled calls it.

        numba parses all of it and goes through its symbols, which takes longer than all else here.
        """
        kept = self._cache_file.load(key, _OF_NUMBA)
        if kept is None:
            return None
        (name, kind, (code, bitcode)), function, *rest = kept
        library = name, kind, (code, _defining(function))
        found = self._impl.rebuild(target_context, (library, function, *rest))
        found.library._get_module_for_linking = partial(llvmlite.binding.parse_bitcode, bitcode)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            with suppress(OSError):
                if self._impl.check_cachable(data):
                    kept = self._impl.reduce(data)
                    machine = pickle.dumps(_machine_code(data, kept))
                    self._cache_file.save(self._index_key(sig, None), machine, dumps(kept))
        finally:
            self._release()

    def _release(self) -> None:
        """Let other processes compile it, or load what was saved."""
        if self._claim is not None:
            self._claim.release()
            self._claim = None

    def _index_key(self, sig: Any, codegen: Any) -> str:
        arguments, _ = sigutils.normalize_signature(sig)
        return key_of(tuple(map(kind_of_type, arguments)))


def _machine_code(compiled: Any, kept: tuple[Any, ...]) -> tuple[Any, ...] | None:
    """What runs without numba (`MachineCode`, as a plain tuple), or None if it needs more."""
    (_, _, (code, _)), function, own, _, objectmode, lifted, _, reload_init, environments = kept
    constants = {one.env_name: list(one.consts) for one in (own, *environments)}
    if objectmode or lifted or reload_init or b"numba" in pickle.dumps([*constants.values()]):
        return None
    external = tuple(
        one.name
        for one in compiled.library._final_module.functions
        if one.is_declaration and not one.name.startswith("llvm.")
    )
    entry = function.llvm_cpython_wrapper_name
    return tuple(MachineCode(entry, own.env_name, constants, external, code))


def environment(module: str, constants: list[Any], name: str) -> Environment:
    """The environment that machine code asks for by its name.

    Of the module only code that runs in the interpreter would see more than the constants, and
    loops have none. numba imports it, for `numpy.empty` all that compiles arrays and strings.
    """
    found = lookup_environment(name)
    if found is None:
        found = Environment(vars(sys.modules[module]) if module in sys.modules else {})
        found.consts[:] = constants
        found.env_name = name
        Environment._memo[name] = found
    return found


def _defining(function: Any) -> bytes:
    """Bitcode that defines the names by which numba asks for a function, and does nothing."""
    names = (function.llvm_func_name, function.llvm_cpython_wrapper_name)
    empty = "\n".join(f'define void @"{name}"() {{ ret void }}' for name in names)
    return llvmlite.binding.parse_assembly(empty).as_bitcode()
