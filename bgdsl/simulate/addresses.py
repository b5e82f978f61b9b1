"""What kernels are given: addresses of arrays and of a model's functions, with what has to stay alive behind them."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

from bgdsl.ir.native import CompiledModel, Kernel
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.kernels.link import Link

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Addresses:
    """Hands out addresses and keeps what they point to for as long as it lives itself."""

    def __init__(self, model: CompiledModel):
        self._model = model
        self._kept: list[Any] = []

    def keep(self, array: Any) -> int:
        """The address of an array's data."""
        assert array.flags["C_CONTIGUOUS"]
        self._kept.append(array)
        return int(array.ctypes.data)

    def call(self, kernel: Kernel) -> int:
        """The address of a model's function; one that is only Python gets a C face."""
        self._kept.append(kernel)
        if kernel.address:
            return kernel.address
        face = _c_face(kernel, len(self._model.program.states), len(self._model.program.inputs))
        self._kept.append(face)
        return ctypes.cast(face, ctypes.c_void_p).value or 0

    def link(self, inputs: InputSignals) -> Any:
        """A fresh link for the model: sizes, context, right-hand side, inputs."""
        import numpy as np

        n = len(self._model.program.states)
        link = Link(n=n, context=self._model.context, rhs=self.call(self._model.rhs), trouble_state=self.keep(np.zeros(n)))
        link.signals, link.with_rates, link.constants = inputs.signals, inputs.with_rates, len(inputs.settings)
        link.pieces = max(0, len(inputs.breaks) - 1)
        link.breaks, link.values, link.slopes = (self.keep(array) for array in (inputs.breaks, inputs.values, inputs.slopes))
        link.settings, link.u = self.keep(inputs.settings), self.keep(np.zeros(max(1, inputs.count)))
        self._kept.append(link)
        return link


def array_at(address: int | None, size: int) -> Floats:
    """Memory as an array (no copy)."""
    import numpy as np

    if not size or not address:
        return np.zeros(0)
    memory: Any = (ctypes.c_double * size).from_address(address)
    return np.frombuffer(memory, dtype=np.float64)


def _c_face(kernel: Kernel, n: int, m: int) -> Any:
    """A C function that calls a kernel which is only Python."""
    signature = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_double, *[ctypes.c_void_p] * 4)

    def face(t: float, x: int, u: int, out: int, context: int) -> int:
        return kernel(t, array_at(x, n), array_at(u, m), array_at(out, kernel.size))

    return signature(face)
