"""Scalar transformers and gyrators that lost one end, in the text: the source at their other end, under the same name.

    a -> lever -> b   term at a dropped   becomes   MSf lever(f = m*a.f);  lever -> b
                      term at b dropped             MSe lever(e = -(m*b.e));  lever -> a

Where a port does not lead to a junction of the right kind named here, one is put before it, and read and bonded instead.
Matrices, elements of arrays, and what has its modulus from outside are written by `one_way.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bgdsl.ir.graph import Bond, Element, Origin
from bgdsl.reductions.plan import Split
from bgdsl.reductions.statements import ClassEdits
from bgdsl.reductions.writer import PortBonds, Side, Spot, Writer, sides
from bgdsl.syntax import ast

_PARAMETERS = {"TF": ("m", "T"), "MTF": ("m", "T"), "GY": ("r", "G"), "MGY": ("r", "G"), "EJS": ("G",)}


@dataclass(slots=True)
class _Port:
    """A port of a two-port in the text: its link, the bond, the neighbour, and the kind of the junction at which its term counts."""

    spot: Spot
    bond: Bond
    inward: bool
    neighbour: Side
    kind: int


@dataclass(slots=True)
class _Task:
    writer: Writer
    split: Split
    name: str
    edits: ClassEdits
    declaration: ast.Declaration
    declarator: ast.Declarator
    modulus: str
    ports: list[_Port]
    told: list[str]


def in_sources(writer: Writer, split: Split, bonds: PortBonds, read: frozenset[str]) -> bool:
    """Is this a scalar two-port that is declared with its modulus and bonded in the text of one class, outside loops, and of which
    nothing is read? read: owners of variables that something reads."""
    element = split.element
    if any(port.size is not None for port in element.ports) or element.name.endswith("]") or element.name in read:
        return False
    site = writer.texts.site(element.name)
    if not isinstance(site.node, ast.Declarator) or _argument(site.node, _PARAMETERS[element.kind]) is None:
        return False
    origins = [_origin(bonds[element.name, k, 0][0], element.name, k) for k in range(2)]
    return all(origin.path == site.owner and not origin.loop and writer.texts.unit_at(origin) is site.unit for origin in origins)


def _origin(bond: Bond, name: str, k: int) -> Origin:
    """Where a bond ends at a port of an element."""
    return bond.origins[-1 if bond.head.node == name and bond.head.port == k else 0]


def write_split(writer: Writer, split: Split, bonds: PortBonds, kinds: Mapping[int, int], comment: Mapping[int, str]) -> None:
    """Split one scalar two-port. kinds: of the junction of every term."""
    element = split.element
    terms = tuple(t for entry in split.entries for t, gone in zip(entry.terms, entry.dropped, strict=True) if gone)
    path, _, name = element.name.rpartition(".")
    found = writer.texts.member(path, name)
    assert found is not None
    unit, declaration, declarator = found
    modulus = _argument(declarator, _PARAMETERS[element.kind])
    assert modulus is not None
    ports = [_port(writer, element, k, bonds, split, kinds, terms) for k in range(len(element.ports))]
    told = list(dict.fromkeys(comment[t] for t in terms))
    _write_scalar(_Task(writer, split, name, writer.of(path, unit), declaration, declarator, modulus, ports, told))


def _argument(declarator: ast.Declarator, names: Sequence[str]) -> str | None:
    """The text of the modulus where the element is declared, None if it is not given there."""
    for argument in declarator.arguments:
        if isinstance(argument, ast.Modifier) and argument.name.text in names and argument.value is not None:
            return argument.value.span.text
    return None


def _port(
    writer: Writer, element: Element, k: int, bonds: PortBonds, split: Split, kinds: Mapping[int, int], terms: tuple[int, ...]
) -> _Port:
    bond = bonds[element.name, k, 0][0]
    at_head = bond.head.node == element.name and bond.head.port == k
    spot = writer.spot(_origin(bond, element.name, k), bond, terms)
    tail, head = sides(writer, spot, bond, terms)
    (entry,) = split.entries
    return _Port(spot, bond, at_head, tail if at_head else head, kinds[entry.terms[k]])


def _write_scalar(task: _Task) -> None:
    """One entry: the two-port goes, or becomes a source at the end where it still acts."""
    (entry,) = task.split.entries
    edits = task.edits
    edits.remove(task.declarator)
    if entry.gone:
        for k, port in enumerate(task.ports):
            _end(task, port, k + 1, read=False)
        task.writer.edit(task.ports[0].spot).comments += task.told
        return
    lost, alive = (0, 1) if entry.dropped[0] else (1, 0)
    lost_port, port = task.ports[lost], task.ports[alive]
    from_variable = _end(task, lost_port, lost + 1, read=True)
    kind, letter, value = _source(task.split.element.kind, lost, lost_port.kind, task.modulus, from_variable)
    edit = task.writer.edit(port.spot)
    edit.comments += task.told
    if port.inward:
        imposed = 1 if letter == "f" else 0
        if port.neighbour.kind is None:
            node = edits.fresh(f"{task.name}_{alive + 1}")
            edits.declare(f"J{imposed} {node};")
            edit.pieces = [f"{port.neighbour.text} -> {node}", f"{task.name} -> {node}"]
        else:
            if port.neighbour.kind != imposed:
                value = f"-{_wrapped(value)}"
            edit.pieces = [f"{task.name} -> {port.neighbour.text}"]
    else:
        edit.pieces = [f"{task.name} -> {port.neighbour.text}"]
    comment = f' "{task.declarator.comment}"' if task.declarator.comment else ""
    edits.declare(f"{kind} {task.name}({letter} = {value}){comment};", task.declaration)


def _end(task: _Task, port: _Port, number: int, *, read: bool) -> str:
    """Take the bond at a port away; the variable of the junction it led to, as it can be read here (if it is to be read)."""
    edit = task.writer.edit(port.spot)
    letter = "f" if port.kind == 1 else "e"
    if port.neighbour.kind == port.kind:
        edit.pieces = []
        whole = [0]
        return port.neighbour.variable(letter, whole)
    name: str = task.edits.fresh(f"{task.name}_{number}")
    task.edits.declare(f"J{port.kind} {name};")
    text = port.neighbour.text
    edit.pieces = [f"{text} -> {name}" if port.inward else f"{name} -> {text}"]
    return f"{name}.{letter}"


def _source(kind: str, lost: int, junction: int, modulus: str, variable: str) -> tuple[str, str, str]:
    """(class, parameter, value) of the source that carries a junction's variable through a two-port from port `lost` on."""
    if kind in ("TF", "MTF"):
        multiplies = (lost == 0) == (junction == 1)
        imposes = "f" if junction == 1 else "e"
    else:
        multiplies = junction == 1
        imposes = "e" if junction == 1 else "f"
    value = f"{_factor(modulus)}*{variable}" if multiplies else f"{variable}/{_factor(modulus)}"
    return ("MSf" if imposes == "f" else "MSe"), imposes, value


def _factor(text: str) -> str:
    """An expression's text as it can stand in a product."""
    simple = all(c.isalnum() or c in "_.[],(): " for c in text) and "if " not in text and " " not in text.strip()
    return text if simple else _wrapped(text)


def _wrapped(text: str) -> str:
    return text if text.startswith("(") and text.endswith(")") and text.count("(") == 1 else f"({text})"
