"""Numbers as LLVM reads them."""

from __future__ import annotations

import struct


def literal(value: float) -> str:
    """A double, exactly."""
    return "0x" + struct.pack(">d", value).hex().upper()
