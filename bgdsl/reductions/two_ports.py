"""Transformers, gyrators and Euler structures split, in the text, into what stays two-way and what acts one way.

A scalar two-port that lost one end becomes the source at its other end, under the same name:

    a -> lever -> b   term at a dropped   becomes   MSf lever(f = m*a.f);  lever -> b
                      term at b dropped             MSe lever(e = -(m*b.e));  lever -> a

A matrix becomes at most three: itself with the two-way entries, a source at port 2 with those that lost their term at port 1,
a source at port 1 with those that lost their term at port 2 (M a mask of ones and zeros):

    a => arm => b     becomes   MTF[3,3] arm(T = M .* T);             a => arm => b
                                MSf[3] arm_forth(f = (M .* T)*a.f);   arm_forth => b
                                MSe[3] arm_back(e = -(transpose(M .* T)*b.e));   arm_back => a

Where a port does not lead to a junction of the right kind named here, one is put before it, and read and bonded instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from bgdsl.ir.graph import Bond, Element
from bgdsl.reductions.cuts import PortBonds, Side, Spot, Writer, sides
from bgdsl.reductions.plan import Entry, Split
from bgdsl.reductions.source_map import ClassText, SourceMap, UnwritableError
from bgdsl.source import Span
from bgdsl.syntax import ast

_PARAMETERS = {"TF": ("m", "T"), "MTF": ("m", "T"), "GY": ("r", "G"), "MGY": ("r", "G"), "EJS": ("G",)}


@dataclass(slots=True)
class _Port:
    """A port of a two-port in the text: its link, the bond, the neighbour, and the junction at which the port's terms meet."""

    spot: Spot
    bond: Bond
    inward: bool
    neighbour: Side
    own: Side
    kind: int
    arrow: str
    dims: str


def write_split(
    writer: Writer, split: Split, bonds: PortBonds, kinds: Mapping[int, int], comment: Mapping[int, str], read: frozenset[str]
) -> None:
    """Split one element. kinds: of the junction of every term; read: owners of variables that something reads."""
    element = split.element
    terms = tuple(t for entry in split.entries for t, gone in zip(entry.terms, entry.dropped, strict=True) if gone)
    path, _, name = element.name.rpartition(".")
    found = writer.texts.member(path, name.partition("[")[0])
    if found is None or "[" in name:
        raise UnwritableError(terms, f"`{element.name}` is one of an array")
    if element.name in read and not any(entry.two_way for entry in split.entries):
        raise UnwritableError(terms, f"the variables of `{element.name}` are read")
    unit, declaration, declarator = found
    modulus = _argument(declarator, _PARAMETERS[element.kind])
    outer = outer_modulus(writer.texts, path, name, _PARAMETERS[element.kind]) if modulus is None else None
    if modulus is None and (outer is None or element.kind not in ("TF", "MTF") or all(entry.gone for entry in split.entries)):
        raise UnwritableError(terms, f"the modulus of `{element.name}` is not given where it is declared")
    ports = [_port(writer, element, k, bonds, split, kinds, terms) for k in range(len(element.ports))]
    for port in ports:
        if port.spot.path != path:
            raise UnwritableError(terms, f"`{element.name}` is bonded outside its class")
    told = list(dict.fromkeys(comment[t] for t in terms))
    task = _Task(writer, split, name, path, unit.model, declaration, declarator, modulus or "", ports, told)
    if outer is not None:
        _write_outer(task, outer)
    elif all(port.size is None for port in element.ports):
        _write_scalar(task)
    else:
        _write_matrix(task)


@dataclass(slots=True)
class _Task:
    writer: Writer
    split: Split
    name: str
    path: str
    model: ast.Model
    declaration: ast.Declaration
    declarator: ast.Declarator
    modulus: str
    ports: list[_Port]
    told: list[str]

    @property
    def edits(self):  # type: ignore[no-untyped-def]
        found = self.writer.texts.member(self.path, self.name)
        assert found is not None
        return self.writer.of(self.path, found[0])


def _argument(declarator: ast.Declarator, names: Sequence[str]) -> str | None:
    """The text of the modulus where the element is declared, None if it is not given there."""
    for argument in declarator.arguments:
        if isinstance(argument, ast.Modifier) and argument.name.text in names and argument.value is not None:
            return argument.value.span.text
    return None


@dataclass(frozen=True, slots=True)
class OuterModulus:
    """A modulus given from outside: `axes(T = value)` in the declaration of a part of the instance `path`."""

    path: str
    unit: ClassText
    modifier: ast.Modifier
    value: ast.Expression


def outer_modulus(texts: SourceMap, path: str, name: str, parameters: Sequence[str]) -> OuterModulus | None:
    """Where the modulus of element `name` of the instance `path` is given in a declaration further out, if that is no array."""
    wanted, here = [name], path
    while here and not here.endswith("]"):
        parent, _, child = here.rpartition(".")
        found = texts.member(parent, child)
        if found is None:
            return None
        arguments: Sequence[ast.Argument] = found[2].arguments
        modifier: ast.Modifier | None = None
        for step in wanted:
            modifier = next((a for a in arguments if isinstance(a, ast.Modifier) and a.name.text == step), None)
            if modifier is None:
                break
            arguments = modifier.nested
        if modifier is not None:
            for inner in modifier.nested:
                if isinstance(inner, ast.Modifier) and inner.name.text in parameters and inner.value is not None:
                    return OuterModulus(parent, found[0], modifier, inner.value)
        wanted, here = [child, *wanted], parent
    return None


def _port(
    writer: Writer, element: Element, k: int, bonds: PortBonds, split: Split, kinds: Mapping[int, int], terms: tuple[int, ...]
) -> _Port:
    port = element.ports[k]
    bond = bonds[element.name, k, 0][0]
    at_head = bond.head.node == element.name and bond.head.port == k
    spot = writer.spot(bond.origins[-1 if at_head else 0], bond, terms)
    if writer.widths[spot.key] != port.width:
        raise UnwritableError(terms, f"the parts of a port of `{element.name}` are bonded apart")
    tail, head = sides(writer, spot, bond, terms)
    own, neighbour = (head, tail) if at_head else (tail, head)
    side_terms = [entry.terms[k] if len(element.ports) == 2 else entry.terms[0] for entry in split.entries]
    kind = kinds[side_terms[0]]
    vector = spot.vector
    return _Port(spot, bond, at_head, neighbour, own, kind, "=>" if vector else "->", f"[{port.width}]" if vector else "")


def _readable(port: _Port) -> bool:
    """Does the port lead straight to a whole junction of its kind that can be named here?"""
    return port.neighbour.kind == port.kind and port.neighbour.own is None


def _explicit(task: _Task, port: _Port, number: int) -> str:
    """Put a junction before a port: its name. The link's element end becomes the junction."""
    name: str = task.edits.fresh(f"{task.name}_{number}")
    task.edits.declare(f"J{port.kind}{port.dims} {name};")
    edit = task.writer.edit(port.spot)
    if port.inward:
        edit.head, edit.head_kind = name, port.kind
    else:
        edit.tail, edit.tail_kind = name, port.kind
    return name


def _joined(port: _Port, junction: str, element: str) -> str:
    """The bond between the junction before a port and the element."""
    return f"{junction} {port.arrow} {element}" if port.inward else f"{element} {port.arrow} {junction}"


# --------------------------------------------------------------------------------------------------------------- scalar


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


# --------------------------------------------------------------------------------------------------------------- matrix


def _write_matrix(task: _Task) -> None:
    entries, element = task.split.entries, task.split.element
    structure = element.kind == "EJS"
    assert element.modulus is not None
    shape = (len(element.modulus), len(element.modulus[0]))
    present = {(entry.row, entry.column) for entry in entries}
    both = _mask(shape, entries, lambda e: e.two_way, structure, default=present)
    forth = _mask(shape, entries, lambda e: e.dropped[0] and not e.gone, structure=False)
    back = _mask(shape, entries, lambda e: e.dropped[1] and not e.gone, structure=False)
    if structure:  # one port: the source gives each component what its row still takes
        rows = [[forth[j][i] or back[i][j] for j in range(shape[1])] for i in range(shape[0])]
        forth, back = [[False] * shape[1] for _ in range(shape[0])], rows
    stays = any(entry.two_way for entry in entries)
    wants = (_any(back), _any(forth))
    junctions: list[str] = []
    for k, port in enumerate(task.ports):
        natural = _natural(element.kind, k)
        if port.neighbour.kind == natural and port.neighbour.own is None:
            junctions.append(port.neighbour.text)
        else:
            port.kind = natural
            junctions.append(_explicit(task, port, k + 1))
    _write_two_way(task, both, present, stays, junctions)
    single = not stays and not all(wants)
    if wants[1]:
        name = task.name if single else task.edits.fresh(f"{task.name}_forth")
        kind, letter = ("MSf", "f") if element.kind in ("TF", "MTF") else ("MSe", "e")
        value = f"{_masked(forth, task.modulus, present, factor=True)}*{junctions[0]}.f"
        _source_at(task, task.ports[1], name, kind, letter, value, junctions[1])
    if wants[0]:
        name = task.name if single else task.edits.fresh(f"{task.name}_back")
        turned = _masked(back, task.modulus, present, factor=structure)
        read = f"{junctions[-1]}.{'f' if structure or element.kind in ('GY', 'MGY') else 'e'}"
        value = f"-({turned}*{read})" if structure else f"-(transpose({turned})*{read})"
        _source_at(task, task.ports[0], name, "MSe", "e", value, junctions[0])


def _write_outer(task: _Task, outer: OuterModulus) -> None:
    """A transformer whose modulus is given from outside: each one-way part is a transformer too, driven by a source, so that its
    modulus can be given at the same place. What it gives back to the source has no effect.

        MSf[3] axes_tap(f = a.f);  axes_tap => axes_forth => b          MSe[3] axes_push(e = b.e);  a => axes_back => end_;  push => end_
    """
    entries, edits, name = task.split.entries, task.edits, task.name
    modulus = task.split.element.modulus
    assert modulus is not None
    shape = (len(modulus), len(modulus[0]))
    present = {(entry.row, entry.column) for entry in entries}
    masks = {
        "": _mask(shape, entries, lambda e: e.two_way, False, default=present),
        "_forth": _mask(shape, entries, lambda e: e.dropped[0] and not e.gone, False),
        "_back": _mask(shape, entries, lambda e: e.dropped[1] and not e.gone, False),
    }
    roles = [role for role, mask in masks.items() if (role and _any(mask)) or (not role and any(e.two_way for e in entries))]
    named = {role: name if i == 0 else edits.fresh(f"{name}{role}") for i, role in enumerate(roles)}
    junctions = []
    for k, port in enumerate(task.ports):
        natural = _natural("MTF", k)
        if port.neighbour.kind == natural and port.neighbour.own is None:
            junctions.append(port.neighbour.text)
        else:
            port.kind = natural
            junctions.append(_explicit(task, port, k + 1))
    first, second = task.ports
    task.writer.edit(first.spot).comments += task.told
    for k, port in enumerate(task.ports):
        edit = task.writer.edit(port.spot)
        explicit = (edit.head if port.inward else edit.tail) is not None
        if explicit and "" in roles:
            edit.extra.append(_joined(port, junctions[k], name))
        elif not explicit and "" not in roles:
            edit.pieces = []
    kind = task.declaration.type.span.text
    for role in roles[1:]:
        edits.declare(f"{kind} {named[role]};", task.declaration)
    if "_forth" in roles:
        tap = edits.fresh(f"{name}_tap")
        edits.declare(f"MSf{first.dims} {tap}(f = {junctions[0]}.f);", task.declaration)
        task.writer.edit(second.spot).extra.append(f"{tap} {first.arrow} {named['_forth']} {second.arrow} {junctions[1]}")
    if "_back" in roles:
        push, end = edits.fresh(f"{name}_push"), edits.fresh(f"{name}_end")
        edits.declare(f"MSe{second.dims} {push}(e = {junctions[1]}.e);", task.declaration)
        edits.declare(f"J0{second.dims} {end};", task.declaration)
        statements = [f"{junctions[0]} {first.arrow} {named['_back']} {second.arrow} {end}", f"{push} {second.arrow} {end}"]
        task.writer.edit(first.spot).extra += statements
    _modify_outer(task, outer, [(named[role], masks[role]) for role in roles], present)


def _modify_outer(task: _Task, outer: OuterModulus, wanted: list[tuple[str, list[list[bool]]]], present: set[tuple[int, int]]) -> None:
    """Give each part its share of the modulus, beside where it was given."""
    edits = task.writer.of(outer.path, outer.unit)
    text, whole = outer.value.span.text, outer.modifier.span
    parameter = next(inner for inner in outer.modifier.nested if isinstance(inner, ast.Modifier) and inner.value is outer.value)
    (_, own), *more = wanted
    if any(not own[i][j] for i, j in present):
        edits.replace(outer.value.span, _masked(own, text, present, factor=False))
    new = "".join(f", {name}({parameter.name.text} = {_masked(mask, text, present, factor=False)})" for name, mask in more)
    if new:
        edits.replace(Span(whole.source, whole.end, whole.end), new)


def _natural(kind: str, k: int) -> int:
    return 0 if kind in ("TF", "MTF") and k == 1 else 1


def _write_two_way(task: _Task, both: list[list[bool]], present: set[tuple[int, int]], stays: bool, junctions: list[str]) -> None:
    edits = task.edits
    task.writer.edit(task.ports[0].spot).comments += task.told
    for k, port in enumerate(task.ports):
        edit = task.writer.edit(port.spot)
        explicit = (edit.head if port.inward else edit.tail) is not None
        if explicit and stays:
            edit.extra.append(_joined(port, junctions[k], task.name))
        elif not explicit and not stays:
            edit.pieces = []
    if not stays:
        edits.remove(task.declarator)
    elif any(not both[i][j] for i, j in present):
        argument = next(
            a
            for a in task.declarator.arguments
            if isinstance(a, ast.Modifier) and a.value is not None and a.value.span.text == task.modulus
        )
        assert argument.value is not None
        edits.replace(argument.value.span, _masked(both, task.modulus, present, factor=False))


def _source_at(task: _Task, port: _Port, name: str, kind: str, letter: str, value: str, junction: str) -> None:
    dims = port.dims or ""
    task.edits.declare(f"{kind}{dims} {name}({letter} = {value});", task.declaration)
    task.writer.edit(port.spot).extra.append(f"{name} {port.arrow} {junction}")


def _mask(
    shape: tuple[int, int],
    entries: Sequence[Entry],
    chosen: Callable[[Entry], bool],
    structure: bool,
    default: set[tuple[int, int]] | None = None,
) -> list[list[bool]]:
    """Which entries are chosen; those that are no terms at all count as chosen where there is a default."""
    mask = [[default is not None and (i, j) not in default for j in range(shape[1])] for i in range(shape[0])]
    for entry in entries:
        if chosen(entry):
            mask[entry.row][entry.column] = True
            if structure:
                mask[entry.column][entry.row] = True
        elif structure:
            mask[entry.column][entry.row] = False
    return mask


def _any(mask: list[list[bool]]) -> bool:
    return any(any(row) for row in mask)


def _masked(mask: list[list[bool]], modulus: str, present: set[tuple[int, int]], *, factor: bool) -> str:
    """The matrix with the entries outside the mask set to zero; the matrix itself where that changes nothing."""
    if all(mask[i][j] for i, j in present):
        return _factor(modulus) if factor else modulus
    rows = "; ".join(", ".join(str(int(value)) for value in row) for row in mask)
    text = f"[{rows}] .* {_factor(modulus)}"
    return f"({text})" if factor else text


def _factor(text: str) -> str:
    """An expression's text as it can stand in a product."""
    simple = all(c.isalnum() or c in "_.[],(): " for c in text) and "if " not in text and " " not in text.strip()
    return text if simple else _wrapped(text)


def _wrapped(text: str) -> str:
    return text if text.startswith("(") and text.endswith(")") and text.count("(") == 1 else f"({text})"
