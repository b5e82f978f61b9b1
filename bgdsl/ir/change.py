"""Changed copies of frozen records, several times faster than `dataclasses.replace`, which matters where every node is copied."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")

_set = object.__setattr__


def changed(record: T, name: str, value: object) -> T:
    """A copy of a frozen dataclass with slots, one field set to another value; nothing is checked."""
    copy = object.__new__(type(record))
    for slot in record.__slots__:  # type: ignore[attr-defined]
        _set(copy, slot, getattr(record, slot))
    _set(copy, name, value)
    return copy
