"""What kernels are written with: kinds of values as annotations, records shared with Python, C functions known by address."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

real = float
whole = int
place: Any = None
places: Any = None
reals: Any = None
sole: Any = None
ints: Any = None
octets: Any = None
"""The kinds, as annotations: 64-bit floats and integers; an address; pointers to addresses, floats, 32-bit integers, bytes; a
parameter that is `sole` points to floats at which no other of its kernel does."""


def sqrt(x: float) -> float:
    """The square root, in kernels."""
    raise NotImplementedError


fabs = sqrt

SCALARS = {"real": ctypes.c_double, "whole": ctypes.c_int64}


class Struct:
    """A record of 8-byte fields shared by Python and kernels: `Struct("Name", "real t, whole n, place f")`.

    Calling it makes a zeroed ctypes instance. A field may have another struct's name as type: a pointer to one.
    """

    def __init__(self, name: str, fields: str):
        self.name = name
        self.fields: dict[str, str] = {}
        for entry in fields.replace("\n", " ").split(","):
            if entry.strip():
                kind, field_name = entry.split()
                self.fields[field_name] = kind
        layout = [(field_name, SCALARS.get(kind, ctypes.c_void_p)) for field_name, kind in self.fields.items()]
        self.ctype = type(name, (ctypes.Structure,), {"_fields_": layout})
        STRUCTS[name] = self

    def __call__(self, **values: Any) -> Any:
        return self.ctype(**values)


STRUCTS: dict[str, Struct] = {}


@dataclass(frozen=True)
class Callee:
    """The C type of a function known only by its address. `result` is `int` (32 bits) or `none`; the address comes first in a call."""

    result: str
    parameters: tuple[str, ...]
