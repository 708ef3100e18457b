"""Machine code that numba compiled in an earlier process, run without numba.

Loading numba takes twice as long as numpy, and a process that compiles nothing needs little of it:
the C functions by which machine code reads Python's arrays and numbers, which numba ships as three
extension modules, and LLVM to put it into memory. Those modules are loaded by themselves, under
their own names, so that numba finds them there if it is needed later on.

numba has no public way to this (checked with numba 0.68 on Linux; elsewhere numba is loaded).
"""

import ctypes
import hashlib
import importlib.machinery
import importlib.util
import os
import pickle
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

from ematwin.numerics.vectors import host_features

LOADING = threading.RLock()
"""Held while machine code or numba is loaded."""

_NEEDED = ("_helperlib", "_dynfunc", "core.runtime._nrt_python")


class CannotRunError(Exception):
    """Machine code that cannot be run without numba; caught within `ematwin.numerics`."""


class MachineCode(NamedTuple):
    """What a function was compiled to.

    Attributes
    ----------
    entry : name of the function that takes Python's arguments
    environment : name of the variable that points to the constants of the function
    constants : by the name of such a variable, of all functions in the code
    external : names of functions that it calls and that are not in it
    code : an object file
    """

    entry: str
    environment: str
    constants: dict[str, list[Any]]
    external: tuple[str, ...]
    code: bytes


def function_of(machine: MachineCode, module: str, name: str) -> Callable[..., Any]:
    """A function to call, said to be ``name`` of a module.

    Raises
    ------
    CannotRunError
        If not all that it calls is there.
    """
    import llvmlite.binding as llvm

    parts = _parts()
    process = ctypes.CDLL(None)
    missing = [
        name
        for name in machine.external
        if not (llvm.address_of_symbol(name) or hasattr(process, name))
    ]
    if missing:  # LLVM would end the process
        raise CannotRunError(f"Nobody knows where {missing[0]} is.")
    empty = llvm.parse_assembly(f'target triple = "{llvm.get_process_triple()}"')
    engine = llvm.create_mcjit_compiler(empty, _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(machine.code))
    engine.finalize_object()
    environments = {}
    for variable, constants in machine.constants.items():
        environments[variable] = made = parts["_dynfunc"].Environment({})
        made.consts.extend(constants)
        if address := engine.get_global_value_address(variable):
            ctypes.c_void_p.from_address(address).value = id(made)
    function: Callable[..., Any] = parts["_dynfunc"].make_function(
        sys.modules[module], name, "", engine.get_function_address(machine.entry),
        environments[machine.environment], (engine, environments),
    )  # fmt: skip
    return function


@cache
def processor() -> str:
    """What machine code is compiled for, and the settings of numba that it depends on."""
    import llvmlite.binding as llvm

    settings = sorted(
        f"{name}={value}"
        for name, value in os.environ.items()
        if name.startswith("NUMBA_") and name not in _WITHOUT_EFFECT
    )
    host = [llvm.get_process_triple(), llvm.get_host_cpu_name(), host_features()]
    return " ".join([*host, *settings])


_WITHOUT_EFFECT = {"NUMBA_CACHE_DIR", "NUMBA_DEBUG_CACHE", "NUMBA_NUM_THREADS"}


def is_possible() -> bool:
    """Whether this system runs machine code without numba."""
    return sys.platform == "linux" and not _is_set("NUMBA_DISABLE_JIT")


def _is_set(name: str) -> bool:
    return os.environ.get(name, "0") not in ("", "0")


def _target() -> Any:
    """A target machine, which belongs to one engine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(jit=True)


@cache
def _parts() -> dict[str, Any]:
    """The extension modules of numba by name; LLVM is told of the functions in them."""
    with LOADING:
        parts = {name: _part(name) for name in _NEEDED}
    add_symbols("numba_", parts["_helperlib"].c_helpers)
    add_symbols("NRT_", parts["core.runtime._nrt_python"].c_helpers)
    if "numba" not in sys.modules:
        _unpickle_alone(parts["_helperlib"].c_helpers["unpickle"])
    return parts


def add_symbols(prefix: str, functions: Mapping[str, int]) -> None:
    """Tell LLVM where C functions of numba are, by the names that numba gives them."""
    import llvmlite.binding as llvm

    for name, address in functions.items():
        llvm.add_symbol(name if name.startswith("_") else prefix + name, address)


def _unpickle_alone(address: int) -> None:
    """Let machine code unpickle the classes that it returns without numba's own module for that.

    Its first call looks for a function of that module, and keeps it.
    """
    known: dict[tuple[int, bytes], Any] = {}

    def unpickled(address: int, data: bytes, digest: bytes) -> Any:
        key = address, digest
        if key not in known:
            known[key] = pickle.loads(data)
        return known[key]

    names = ("numba", "numba.core.serialize")  # Python asks for the package as well
    stand_ins = {name: ModuleType(name) for name in names}
    stand_ins[names[1]]._numba_unpickle = unpickled  # type: ignore[attr-defined]
    data = pickle.dumps(None)
    call = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p)
    sys.modules.update(stand_ins)
    try:
        call(address)(data, len(data), hashlib.sha1(data).digest())
    finally:
        for name in names:
            del sys.modules[name]


def _part(name: str) -> Any:
    """An extension module of numba, without numba where that is not loaded yet."""
    full = f"numba.{name}"
    if "numba" in sys.modules:
        return importlib.import_module(full)
    if full in sys.modules:
        return sys.modules[full]
    where = os.path.join(_folder_of_numba(), *name.split(".")[:-1])
    spec = importlib.machinery.PathFinder.find_spec(full, [where])
    if spec is None or spec.loader is None:
        raise CannotRunError(f"numba has no {full}.")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[full] = module
    return module


def _folder_of_numba() -> str:
    spec = importlib.util.find_spec("numba")
    places: Iterable[str] = () if spec is None else spec.submodule_search_locations or ()
    for place in places:
        return place
    raise CannotRunError("numba is not installed.")
