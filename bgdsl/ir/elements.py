"""The table of primitive kinds: their ports, their parameters, their causality and their default laws.

A new kind is a new row of `KINDS`. Vector forms use the same rows: laws are written per component.
Power flows into I, C, R and EJS and out of Se and Sf; a two-port takes power at port 1 and gives it at port 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Rule = Literal["effort out", "flow out", "preferred", "free", "through", "across"]
"""Causality of a kind: a source's fixed output, a storage's integral preference, a resistor's freedom, a transformer
(flow in at one port, flow out at the other: `through`), a gyrator (flow in at both or out of both: `across`)."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One primitive class of the language.

    `ports` is how many bonds it takes; `inward` says that power is counted into the element at a one-port.
    `parameters` are the names of which the user sets one (`k` or `C`); the first is used where neither is said.
    `own` are the variables its law may read beside parameters: the conjugate pair and, for storage, the state.
    """

    name: str
    ports: int
    inward: bool
    rule: Rule
    parameters: tuple[str, ...]
    own: tuple[str, ...]
    state: Literal["p", "q"] | None = None
    modulated: bool = False
    dual: str = ""

    @property
    def article(self) -> str:
        """The indefinite article as the name is spoken: a C, an R."""
        return "an" if self.name[0] in "EIMRS" else "a"


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("Se", 1, False, "effort out", ("e",), ("e", "f"), dual="Sf"),
        Kind("Sf", 1, False, "flow out", ("f",), ("e", "f"), dual="Se"),
        Kind("MSe", 1, False, "effort out", ("e",), ("e", "f"), modulated=True, dual="MSf"),
        Kind("MSf", 1, False, "flow out", ("f",), ("e", "f"), modulated=True, dual="MSe"),
        Kind("I", 1, True, "preferred", ("I",), ("e", "f", "p"), state="p", dual="C"),
        Kind("C", 1, True, "preferred", ("C", "k"), ("e", "f", "q"), state="q", dual="I"),
        Kind("R", 1, True, "free", ("R", "G"), ("e", "f"), dual="R"),
        Kind("TF", 2, True, "through", ("m", "T"), (), dual="TF"),
        Kind("MTF", 2, True, "through", ("m", "T"), (), modulated=True, dual="MTF"),
        Kind("GY", 2, True, "across", ("r", "G"), (), dual="GY"),
        Kind("MGY", 2, True, "across", ("r", "G"), (), modulated=True, dual="MGY"),
        Kind("EJS", 1, True, "across", ("G",), ("e", "f"), modulated=True, dual="EJS"),
    )
}

JUNCTIONS: Mapping[str, Literal[0, 1]] = {"J0": 0, "J1": 1}


def component(base: str, *indices: int | None) -> str:
    """The scalar name of a component, indices counted from 0: `component("v.f", 2)` is `v.f[3]`; None adds nothing."""
    shown = [str(i + 1) for i in indices if i is not None]
    return f"{base}[{','.join(shown)}]" if shown else base
