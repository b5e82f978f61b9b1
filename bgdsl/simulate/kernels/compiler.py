"""A small compiler from a restricted Python to machine code, for the loops between an integrator and a model.

What is called a million times a run (callbacks of CVODE, factorisations, quadrature) is written once, as plain functions under
`@kernel`, and compiled through LLVM when the first run needs it. The subset: parameters with annotated types; locals typed by
their first assignment; `while`, `for ... in range`, `if`, `return`, `break`, `continue`; arithmetic, comparisons, `and or not`;
`p[i]` on pointers; `p + i` moves a pointer; `s.field` of a `Struct`; calls of other kernels, of `Callee`s (C functions by address),
and of `sqrt`, `fabs`, `real`, `whole`. Integers are 64 bits, `ints` point to 32 bits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from bgdsl import cache
from bgdsl.simulate.kernels import kinds, translate
from bgdsl.simulate.kernels.kinds import SCALARS
from bgdsl.simulate.kernels.translate import annotation, definition, ir_of, returns_of


@dataclass
class Module:
    """Kernels compiled together; `functions` fills as modules of kernels are imported."""

    functions: dict[str, Callable[..., Any]] = field(default_factory=dict)
    _engine: Any = None
    _addresses: dict[str, int] = field(default_factory=dict)
    _callables: dict[str, Any] = field(default_factory=dict)

    def kernel(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Mark a function as a kernel."""
        assert self._engine is None, "kernels are declared before the first is used"
        self.functions[function.__name__] = function
        return function

    def address(self, name: str) -> int:
        """Where the machine code of a kernel is; compiles all of them the first time."""
        if self._engine is None:
            self._engine = _compile(self.functions)
        if name not in self._addresses:
            self._addresses[name] = self._engine.get_function_address(name)
        return self._addresses[name]

    def function(self, name: str) -> Any:
        """A kernel as a ctypes function; pointers are passed as integers."""
        if name not in self._callables:
            self._callables[name] = self._callable(name)
        return self._callables[name]

    def _callable(self, name: str) -> Any:
        tree = definition(self.functions[name])
        types: list[Any] = [SCALARS.get(annotation(arg.annotation), ctypes.c_void_p) for arg in tree.args.args]
        result = {"none": None, "real": ctypes.c_double, "int": ctypes.c_int32}[returns_of(tree)]
        return ctypes.CFUNCTYPE(result, *types)(self.address(name))


KERNELS = Module()
kernel = KERNELS.kernel


def _compile(functions: Mapping[str, Callable[..., Any]]) -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    made = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(), str(llvm.llvm_version_info), llvm.get_default_triple()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=made[0], features=made[1], opt=2, codemodel="jitdefault", jit=True
    )
    key = sha256("\n".join((*made, *_sources(functions))).encode()).hexdigest()
    content = cache.recall(key)
    if content is None:
        module = llvm.parse_assembly(ir_of(functions))
        module.verify()
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        options.loop_vectorization = True
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
        content = bytes(machine.emit_object(module))
        cache.keep(key, content)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return engine


def _sources(functions: Mapping[str, Callable[..., Any]]) -> list[str]:
    """The text of everything that decides about the machine code: this compiler, and the modules of the kernels."""
    compiler = (__file__, kinds.__file__, translate.__file__)
    files = {*compiler, *(function.__code__.co_filename for function in functions.values())}
    return [Path(file).read_text("utf-8") for file in sorted(files)]
