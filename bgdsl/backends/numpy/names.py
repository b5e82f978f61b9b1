"""Python names for what the model names: close to the model's own, never a keyword, a builtin, or taken."""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable

RESERVED = frozenset((*keyword.kwlist, *keyword.softkwlist, *dir(builtins)))
"""What no generated name may be."""

_OTHER = re.compile(r"[^0-9A-Za-z]+")


def mangled(name: str) -> str:
    """`cyl[2].rod.p[1]` as `cyl_2_rod_p_1`; letters outside ASCII go; never empty, never a digit or an underscore in front."""
    plain = _OTHER.sub("_", name).strip("_")
    return plain if plain and not plain[0].isdigit() else f"v_{plain}".rstrip("_")


class Namespace:
    """Hands out names, each once; the first to ask for a name gets it, later ones get it with a number."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = {*RESERVED, *taken}
        self._next: dict[str, int] = {}

    def take(self, name: str) -> str:
        """A free Python name close to this one."""
        plain = mangled(name)
        found = plain
        while found in self._taken:
            number = self._next.get(plain, 2)
            self._next[plain] = number + 1
            found = f"{plain}_{number}"
        self._taken.add(found)
        return found

    def copy(self) -> Namespace:
        """A namespace of its own in which the same names are taken."""
        made = Namespace()
        made._taken = set(self._taken)
        made._next = dict(self._next)
        return made


def printable(text: str, limit: int = 100) -> str:
    """The text as it may stand in a comment: on one line, with nothing that is not shown, not too long."""
    shown = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return shown if len(shown) <= limit else f"{shown[:limit]} ..."
