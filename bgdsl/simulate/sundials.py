"""SUNDIALS' CVODE as shared libraries, called directly: those that come with scikit-sundae, or with the system.

Only what is needed is declared. Objects are addresses; `check` turns a failed set-up call into an OSError (ours, not the user's).
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.util
from collections.abc import Iterator
from functools import cache, cached_property
from pathlib import Path
from typing import Any

POINTER = ctypes.c_void_p
REAL = ctypes.c_double
INT = ctypes.c_int

ADAMS, BDF = 1, 2
FLAGS = {
    -1: "too many steps within one step of the run",
    -2: "more accuracy is asked for than double precision gives",
    -3: "the error test fails again and again, or the step size collapsed",
    -4: "the corrector does not converge, or the step size collapsed",
    -6: "the iteration matrix cannot be factorised",
    -7: "the iteration matrix cannot be solved",
    -8: "the right-hand side cannot be evaluated",
    -9: "the right-hand side cannot be evaluated at the start",
    -10: "the right-hand side fails however small the step is made",
    -11: "the right-hand side cannot be evaluated",
    -12: "the event functions cannot be evaluated",
    -27: "the stop time is too close to the start",
}
COLLAPSED = (-3, -4, -10)


class Sundials:
    """The libraries' functions, each with its C types set."""

    def __init__(self, core: ctypes.CDLL, vectors: ctypes.CDLL, cvode: ctypes.CDLL, dense: ctypes.CDLL, matrices: ctypes.CDLL):
        self._libraries = (cvode, core, vectors, dense, matrices)

    def __getattr__(self, name: str) -> Any:
        function: Any = None
        for library in self._libraries:
            try:
                function = getattr(library, name)
                break
            except AttributeError:
                continue
        if function is None:
            raise AttributeError(name)
        result, *types = _SIGNATURES[name]
        function.restype, function.argtypes = result, types
        setattr(self, name, function)
        return function

    def address(self, name: str) -> int:
        """Where a function is."""
        return ctypes.cast(getattr(self, name), POINTER).value or 0

    @cached_property
    def context(self) -> int:
        """A SUNContext without error printing: what goes wrong is said by the run."""
        made = POINTER()
        self.check(self.SUNContext_Create(0, ctypes.byref(made)), "SUNContext_Create")
        assert made.value is not None
        self.SUNContext_ClearErrHandlers(made)
        return made.value

    @cached_property
    def slots(self) -> dict[str, tuple[int, int]]:
        """Where operations stand, found by looking at the dense solver and matrix: in which word of the object the address of the
        table of operations is, and in which word of that table the operation."""
        vector = self.N_VNew_Serial(1, self.context)
        matrix = self.SUNDenseMatrix(1, 1, self.context)
        solver = self.SUNLinSol_Dense(vector, matrix, self.context)
        wanted = {name: self.address(f"SUNLinSol{name}_Dense") for name in ("GetType", "Setup", "Solve")}
        found = {name: self._slot(solver, place) for name, place in wanted.items()}
        return {**found, "GetID": self._slot(matrix, self.address("SUNMatGetID_Dense"))}

    def _slot(self, thing: int, place: int) -> tuple[int, int]:
        for i in (1, 2, 3):
            table = words(thing)[i]
            if table and table != self.context:
                for k in range(20):
                    if words(table)[k] == place:
                        return i, k
        raise OSError("this SUNDIALS keeps its operations elsewhere than expected")

    def set_operation(self, thing: int, name: str, place: int) -> None:
        """Put a function into an object's table of operations."""
        i, k = self.slots[name]
        words(words(thing)[i])[k] = place

    @staticmethod
    def check(flag: int, what: str) -> None:
        if flag < 0:
            raise OSError(f"{what} says {flag}")


def words(address: int) -> Any:
    """Memory as an array of addresses."""
    return ctypes.cast(address, ctypes.POINTER(POINTER))


_SIGNATURES: dict[str, tuple[Any, ...]] = {
    "SUNContext_Create": (INT, INT, POINTER),
    "SUNContext_ClearErrHandlers": (INT, POINTER),
    "N_VNew_Serial": (POINTER, INT, POINTER),
    "N_VMake_Serial": (POINTER, INT, POINTER, POINTER),
    "N_VClone_Serial": (POINTER, POINTER),
    "N_VGetArrayPointer": (POINTER, POINTER),
    "N_VDestroy": (None, POINTER),
    "CVodeCreate": (POINTER, INT, POINTER),
    "CVodeInit": (INT, POINTER, POINTER, REAL, POINTER),
    "CVodeReInit": (INT, POINTER, REAL, POINTER),
    "CVodeSStolerances": (INT, POINTER, REAL, REAL),
    "CVodeSetUserData": (INT, POINTER, POINTER),
    "CVodeSetMaxOrd": (INT, POINTER, INT),
    "CVodeSetMaxStep": (INT, POINTER, REAL),
    "CVodeSetLSetupFrequency": (INT, POINTER, ctypes.c_long),
    "CVodeSetJacEvalFrequency": (INT, POINTER, ctypes.c_long),
    "CVodeSetStopTime": (INT, POINTER, REAL),
    "CVodeSetMaxErrTestFails": (INT, POINTER, INT),
    "CVodeSetMaxConvFails": (INT, POINTER, INT),
    "CVodeSetMaxHnilWarns": (INT, POINTER, INT),
    "CVodeSetNoInactiveRootWarn": (INT, POINTER),
    "CVodeRootInit": (INT, POINTER, INT, POINTER),
    "CVodeGetRootInfo": (INT, POINTER, POINTER),
    "CVode": (INT, POINTER, REAL, POINTER, POINTER, INT),
    "CVodeGetDky": (INT, POINTER, REAL, INT, POINTER),
    "CVodeGetNumErrTestFails": (INT, POINTER, POINTER),
    "CVodeGetNumNonlinSolvConvFails": (INT, POINTER, POINTER),
    "CVodeGetLastStep": (INT, POINTER, POINTER),
    "CVodeSetNonlinearSolver": (INT, POINTER, POINTER),
    "CVodeSetLinearSolver": (INT, POINTER, POINTER, POINTER),
    "CVodeSetLinSysFn": (INT, POINTER, POINTER),
    "CVodeFree": (None, POINTER),
    "SUNNonlinSol_FixedPoint": (POINTER, POINTER, INT, POINTER),
    "SUNNonlinSolFree": (INT, POINTER),
    "SUNLinSolNewEmpty": (POINTER, POINTER),
    "SUNLinSolFreeEmpty": (None, POINTER),
    "SUNMatNewEmpty": (POINTER, POINTER),
    "SUNMatFreeEmpty": (None, POINTER),
    "SUNDenseMatrix": (POINTER, INT, INT, POINTER),
    "SUNMatGetID_Dense": (INT, POINTER),
    "SUNLinSol_Dense": (POINTER, POINTER, POINTER, POINTER),
    "SUNLinSolGetType_Dense": (INT, POINTER),
    "SUNLinSolSetup_Dense": (INT, POINTER, POINTER),
    "SUNLinSolSolve_Dense": (INT, POINTER, POINTER, POINTER, POINTER, REAL),
}


def _places() -> Iterator[Path]:
    """Folders where wheels keep the libraries they bring along."""
    spec = importlib.util.find_spec("sksundae")
    if spec is None or spec.origin is None:
        return
    package = Path(spec.origin).parent
    for folder in (package.parent / "scikit_sundae.libs", package / ".dylibs", package / "lib", package):
        if folder.is_dir():
            yield folder


def _library(name: str) -> ctypes.CDLL:
    for folder in _places():
        for pattern in (f"libsundials_{name}[-.]*so*", f"libsundials_{name}[-.]*dylib", f"*sundials_{name}-*.dll"):
            for path in sorted(folder.glob(pattern)):
                return ctypes.CDLL(str(path))
    system = ctypes.util.find_library(f"sundials_{name}")
    if system is None:
        raise OSError(f"there is no library sundials_{name}")
    return ctypes.CDLL(system)


@cache
def libraries() -> Sundials:
    """The libraries, loaded once. OSError where they are not there, or lay out an N_Vector otherwise than the kernels read it."""
    names = ("core", "nvecserial", "cvode", "sunlinsoldense", "sunmatrixdense")
    core, vectors, cvode, dense, matrices = (_library(name) for name in names)
    found = Sundials(core, vectors, cvode, dense, matrices)
    vector = found.N_VNew_Serial(3, found.context)
    data = found.N_VGetArrayPointer(vector)
    if words(words(vector)[0])[1] != data:
        raise OSError("this SUNDIALS lays out its vectors in another way than expected (32-bit indices are needed)")
    found.N_VDestroy(vector)
    return found
