"""IR text to machine code at an address, by LLVM, by way of the cache."""

from __future__ import annotations

import ctypes
import sys
from ctypes.util import find_library
from functools import cache
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from bgdsl import cache as disk
from bgdsl.backends.native.runtime import runtime_text

if TYPE_CHECKING:
    from llvmlite.binding import TargetMachine

_LIBM = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "log10", "pow", "fmod")
_RUNTIME = ("bg_factor", "bg_substitute", "bg_newton", "bg_eliminate")


@cache
def _machine(level: int) -> TargetMachine:
    """The one to compile with at this level."""
    return _new_machine(level)


def _new_machine(level: int) -> TargetMachine:
    """The processor we run on, as a target of LLVM; level 0 compiles fast, 1 and more make fast code."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=level, reloc="default", codemodel="jitdefault", jit=True
    )


@cache
def _features() -> str:
    import llvmlite.binding as llvm

    try:
        return str(llvm.get_host_cpu_features().flatten())
    except RuntimeError:  # not known on this platform: the processor's name has to do
        return ""


@cache
def _signature() -> str:
    """What machine code depends on beside the IR."""
    import llvmlite
    import llvmlite.binding as llvm

    return "\n".join((llvmlite.__version__, str(llvm.llvm_version_info), llvm.get_default_triple(), llvm.get_host_cpu_name(), _features()))


def machine_code(text: str, level: int, *, passes: bool = False) -> bytes:
    """An object file of the IR; `passes` runs LLVM's optimiser over the IR first (worth its time for loops only)."""
    key = sha256(f"{_signature()}\n{level}\n{passes}\n{text}".encode()).hexdigest()
    found = disk.recall(key)
    if found is not None:
        return found
    import llvmlite.binding as llvm

    machine = _machine(level)
    module = llvm.parse_assembly(text)
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    if passes:
        _optimise(module, machine)
    made = bytes(machine.emit_object(module))
    disk.keep(key, made)
    return made


def _optimise(module: Any, machine: Any) -> None:
    import llvmlite.binding as llvm

    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.loop_vectorization = True
    options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


class Loaded:
    """Machine code in memory; it stays as long as this object does."""

    def __init__(self, content: bytes) -> None:
        import llvmlite.binding as llvm

        _bind_maths()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _new_machine(1))  # which the engine will own
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(content))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Where a function is."""
        found = int(self._engine.get_function_address(name))
        assert found, f"{name} is not in the machine code"
        return found


@cache
def runtime() -> Loaded:
    """The routines that kernels call, in memory and known by name to every later `Loaded`."""
    import llvmlite.binding as llvm

    loaded = Loaded(machine_code(runtime_text(), 1, passes=True))
    for name in _RUNTIME:
        llvm.add_symbol(name, loaded.address(name))
    return loaded


@cache
def _bind_maths() -> None:
    """Tell LLVM where the C library's functions are, whether or not this process exports them."""
    import llvmlite.binding as llvm

    if sys.platform == "win32":
        library = ctypes.CDLL("ucrtbase")
    elif sys.platform == "darwin":
        library = ctypes.CDLL(None)
    else:
        library = ctypes.CDLL(_libm())
    for name in _LIBM:
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        if address:
            llvm.add_symbol(name, address)


def _libm() -> str:
    """The C library's mathematics; asking the system where it is takes long, so its usual name comes first."""
    try:
        ctypes.CDLL("libm.so.6")
    except OSError:
        return find_library("m") or "libm.so"
    return "libm.so.6"
