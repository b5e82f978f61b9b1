"""The integration methods as data: what `--method` can name, which engine runs it, what it is good for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Engine = Literal["cvode", "vode", "scipy"]


@dataclass(frozen=True, slots=True)
class Method:
    """One row of the table.

    engine: the module that integrates; key: the name there. jacobian: whether the exact Jacobian is used. order: the highest.
    """

    name: str
    engine: Engine
    key: str
    stiff: bool
    jacobian: bool
    order: int
    comment: str


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("cvode-bdf", "cvode", "bdf", True, True, 5, "SUNDIALS CVODE, backward differences, sparse exact Jacobian"),
        Method("cvode-bdf3", "cvode", "bdf", True, True, 3, "the same to order 3, for what rings: orders 4 and 5 are unstable there"),
        Method("cvode-adams", "cvode", "adams", False, False, 12, "SUNDIALS CVODE, Adams-Moulton by functional iteration"),
        Method("lsoda", "scipy", "LSODA", True, True, 12, "ODEPACK LSODA: switches between Adams and backward differences"),
        Method("radau", "scipy", "Radau", True, True, 5, "implicit Runge-Kutta, Radau IIA of order 5"),
        Method("rk45", "scipy", "RK45", False, False, 5, "explicit Runge-Kutta, Dormand and Prince"),
        Method("vode-adams", "vode", "adams", False, False, 12, "VODE, Adams-Moulton by functional iteration"),
    )
}

DEFAULT = "cvode-bdf"
