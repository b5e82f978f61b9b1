"""Signals, parameters, inputs and outputs of a part: each in the instance that declares it.

Input        the bodies as `contents` has begun them, with the elements and what they are given
Output       the same bodies, with everything that these read
Establishes  what is read and not there is an `input` of the model; laws and equations read nothing from outside of their instance
Reports      nothing; UnwritableError where an equation has no place
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from bgdsl.expr import Expr, const, leaves, param, substitute, var
from bgdsl.ir.graph import Parameter, Signal
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.part import Part
from bgdsl.reductions.places import (
    COMPONENT_INDEX,
    INPUT,
    OUTPUT,
    PARAMETER,
    SIGNAL,
    Contents,
    LocalNames,
    Piece,
    Spot,
    Value,
    body_values,
    common,
    flat_name,
    indices,
    split,
    within,
)
from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.wording import Wording


class Quantities:
    """Writes what is no bond into the bodies of `found`."""

    def __init__(self, scalar: ScalarGraph, part: Part, found: Contents, names: LocalNames, wording: Wording):
        self.scalar, self.part, self.graph = scalar, part, scalar.graph
        self.found, self.names, self.wording = found, names, wording
        self.signal_of = {name: s for s in self.graph.signals for name in s.scalars()}

    def write(self) -> None:
        """All of it."""
        self.write_signals()
        self.write_checks()
        self.read_all()
        self.write_outputs()
        self.localise()

    # ------------------------------------------------------------------------------------------------------- signals

    def signal_place(self, signal: Signal) -> Spot:
        """Where a signal is; what a user's element declares is written beside it."""
        base = split(signal.name)
        if base.owner in self.wording.elements:
            element = split(base.owner)
            return Spot(element.owner, self.names.fresh(element.owner, f"{element.name}_{base.name}", signal.name), element.index)
        return base

    def write_signals(self) -> None:
        right = self.equations()
        for signal in self.graph.signals:
            mine = [name for name in signal.scalars() if name in self.part.signals]
            whole = len(mine) == len(signal.scalars())
            for group in [mine] if whole and mine else [[name] for name in mine]:
                self.write_signal(signal, group, right, whole=whole)

    def write_signal(self, signal: Signal, group: Sequence[str], right: dict[str, Value], *, whole: bool) -> None:
        """A signal that is there whole, or one entry of it, with its start and its equations."""
        base = self.signal_place(signal)
        here = base if whole else self.names.piece(base, f"_{flat_name(group[0][len(signal.name) :])}")
        shape = signal.shape if whole else ()
        for name in group:
            component = indices(name[len(signal.name) + 1 : -1]) if shape else ()
            spot = Spot(here.owner, here.name, here.index, "", component, shape)
            self.found.read(name, spot)
            self.found.readings[f"der({name})"] = (Spot(here.owner, here.name, here.index, "", component, shape, rate=True),)
        prefix = "input " if signal.role == "input" else "output " if signal.output else ""
        dims = f"[{', '.join(map(str, shape))}]" if shape else ""
        piece = Piece(
            here, OUTPUT if signal.output else SIGNAL, "Real", dims, _unit(signal.unit, shape), comment=signal.comment, prefix=prefix
        )
        if signal.starts is not None:
            by_name = dict(zip(signal.scalars(), signal.starts, strict=True))
            piece.values["start",] = Value(tuple(self.wording.short(by_name[name]) for name in group), shape)
        if all(name in right for name in group):
            piece.values[()] = Value(tuple(right[name].roots[0] for name in group), shape)
        else:
            for name in group:
                for variable in (name, f"der({name})"):
                    if variable in right:
                        self.found.body(here.owner).equations.append((self.found.readings[variable][0], right[variable]))
        self.found.add(piece)

    def equations(self) -> dict[str, Value]:
        """The right sides of the wanted signals' equations, by the variable they are for."""
        found: dict[str, Value] = {}
        for equation in self.graph.equations:
            left = equation.left.data if equation.left.op == "var" else None
            target = left[4:-1] if left and left.startswith("der(") else left
            if target is None or target not in self.signal_of:
                raise UnwritableError((), "an equation that is not solved for a variable has no place in a part")
            if target in self.part.signals:
                assert left is not None
                found[left] = Value(self.wording.prepared((equation.right,), (left,)))
        return found

    def write_checks(self) -> None:
        """Checks and initial equations of which everything is there."""
        for check in self.graph.checks:
            (condition,) = self.wording.prepared((check.condition,))
            if self.all_here((condition,)):
                self.found.body("").lines.append((check.message, Value((condition,))))
        for equation in self.graph.initial_equations:
            left, right = self.wording.prepared((equation.left, equation.right))
            if self.all_here((left, right)):
                self.found.body("").starts.append((Value((left,)), Value((right,))))

    def all_here(self, roots: Iterable[Expr]) -> bool:
        return all(leaf.data in self.found.readings for leaf in leaves(roots))

    # --------------------------------------------------------------------------------------------- what is read

    def all_values(self) -> Iterator[Value]:
        for body in self.found.bodies.values():
            yield from body_values(body)

    def read_all(self) -> None:
        """Inputs for what is not there, and the parameters that are read, with those that they read."""
        readers = self.readers()
        own = {self.scalar.junctions[j].variable for j in self.part.junctions}
        for variable, paths in readers.items():
            if variable in own:
                raise UnwritableError((), f"`{variable}` is read, and nothing is left of its junction")
            self.input(variable)
            self.hand_in(variable, paths)
        roots = [root for value in self.all_values() for root in value.roots]
        for v in self.part.outputs:
            roots += self.wording.prepared((var(v),))
        pieces: dict[str, Piece] = {}
        self.read_parameters(roots, pieces)
        for experiment in self.graph.experiments:
            self.read_parameters([value for name, value in experiment.changes.items() if name in self.found.readings], pieces)
        for parameter in self.graph.parameters:
            if parameter.name in pieces:
                self.found.add(pieces[parameter.name])

    def read_parameters(self, roots: Iterable[Expr], pieces: dict[str, Piece]) -> None:
        """The parameters that these expressions read, with those that they read."""
        waiting = [leaf.data for leaf in leaves(roots, "param")]
        while waiting:
            parameter = self.wording.parameter_of[waiting.pop()]
            if parameter.name not in pieces:
                pieces[parameter.name] = piece = self.parameter(parameter)
                waiting += [leaf.data for leaf in leaves(piece.values[()].roots, "param")]

    def readers(self) -> dict[str, list[str]]:
        """The variables that are not there, and the instances that read them."""
        found: dict[str, list[str]] = {}
        for path, body in self.found.bodies.items():
            for value in body_values(body):
                for leaf in leaves(value.roots):
                    if leaf.data not in self.found.readings and leaf.data not in value.letters:
                        found.setdefault(leaf.data, []).append(path)
        return found

    def input(self, variable: str) -> None:
        """An input of the model."""
        spot = self.part.passed.get(variable) or Spot("", self.names.fresh("", flat_name(variable), variable))
        self.found.inputs[variable] = f"{spot.name}[{spot.component[0]}]" if spot.component else spot.name
        self.found.readings[variable] = (spot,)
        dims = f"[{spot.shape[0]}]" if spot.shape else ""
        self.found.add(Piece(Spot("", spot.name), INPUT, "Real", dims, prefix="input "))

    def hand_in(self, variable: str, readers: Sequence[str]) -> None:
        """An input of the instance whose variable it is, where things in that instance read it."""
        home = split(variable).owner
        while home and (home not in self.found.bodies or self.found.bodies[home].empty):
            home = home.rpartition(".")[0]
        if not home or not any(within(path, home) for path in readers):
            return
        outer = f"{variable}@"
        rest = variable[len(home) + 1 :]
        name = rest if rest.isidentifier() else self.names.fresh(home, flat_name(COMPONENT_INDEX.sub("", rest)), ("passed", variable))
        self.found.readings[outer] = self.found.readings[variable]
        self.found.readings[variable] = (Spot(home, name), *self.found.readings[variable])
        self.found.add(Piece(Spot(home, name), INPUT, "Real", values={(): Value((var(outer),))}, prefix="input "))

    def parameter(self, parameter: Parameter) -> Piece:
        here = split(parameter.name)
        for name in parameter.scalars():
            component = indices(name[len(parameter.name) + 1 : -1])
            self.found.readings[name] = (Spot(here.owner, here.name, (), "", component, parameter.shape),)
            if parameter.constant:
                self.found.fixed[name] = self.wording.values[name]
        changed = self.part.changed
        values = tuple(
            const(changed[name]) if name in changed else self.wording.short(value)
            for name, value in zip(parameter.scalars(), parameter.values, strict=True)
        )
        dims = f"[{', '.join(map(str, parameter.shape))}]" if parameter.shape else ""
        constant = parameter.constant and _is_constant(parameter)
        return Piece(
            here,
            PARAMETER,
            "Integer" if parameter.integer else "Real",
            dims,
            _unit(parameter.unit, parameter.shape),
            {(): Value(values, parameter.shape)},
            comment=parameter.comment,
            prefix="constant " if constant else "parameter ",
            default=_has_default(parameter),
            final=parameter.constant and not constant,
        )

    def write_outputs(self) -> None:
        """What other parts read, under the names by which it passes."""
        given: dict[str, list[tuple[Spot, Expr]]] = {}
        for variable in self.part.outputs:
            spot = self.part.passed[variable]
            self.found.outputs[variable] = f"{spot.name}[{spot.component[0]}]" if spot.component else spot.name
            (root,) = self.wording.prepared((var(variable),))
            given.setdefault(spot.name, []).append((spot, root))
        for name, rows in given.items():
            if (name, ()) in self.found.body("").pieces:  # a variable of the model itself
                self.found.body("").pieces[name, ()].prefix = "output "
                continue
            shape = rows[0][0].shape
            value = Value(tuple(root for _, root in sorted(rows, key=lambda row: row[0].component)), shape)
            dims = f"[{shape[0]}]" if shape else ""
            self.found.add(Piece(Spot("", name), OUTPUT, "Real", dims, values={(): value}, prefix="output "))

    # ---------------------------------------------------------------------------------------------- what is elsewhere

    def localise(self) -> None:
        """Laws and equations stay in their class: what they read of elsewhere gets there as an input or parameter of it."""
        for path, body in self.found.bodies.items():
            if path:
                for piece in list(body.pieces.values()):
                    if piece.law is not None:
                        piece.law = piece.law[0], self.localised(path, piece.law[1])
                    if piece.prefix == "output " and () in piece.values:
                        piece.values[()] = self.localised(path, piece.values[()])
                body.equations = [(left, self.localised(path, value)) for left, value in body.equations]

    def localised(self, path: str, value: Value) -> Value:
        moved: dict[Expr, Expr] = {}
        for op in ("var", "param"):
            for leaf in leaves(value.roots, op):
                if leaf.data not in value.letters and not any(within(s.owner, path) for s in self.found.readings[leaf.data]):
                    moved[leaf] = self.local(path, leaf)
        return Value(substitute(value.roots, moved), value.shape, value.letters) if moved else value

    def local(self, path: str, leaf: Expr) -> Expr:
        """The name in an instance of what it reads of elsewhere."""
        spot = self.found.readings[leaf.data][0]
        shared = common(path, spot.owner)
        seen = flat_name(COMPONENT_INDEX.sub("", leaf.data.removeprefix(f"{shared}.") if shared else leaf.data))
        name = self.names.fresh(path, seen, ("elsewhere", leaf.data))
        given = f"{path}.{name}"
        here = Spot(path, name)
        if given not in self.found.readings:
            self.found.readings[given] = (here,)
            prefix, rank = ("parameter ", PARAMETER) if leaf.op == "param" else ("input ", INPUT)
            self.found.add(Piece(here, rank, "Real", values={(): Value((leaf,))}, prefix=prefix))
        return param(given) if leaf.op == "param" else var(given)


def _is_constant(parameter: Parameter) -> bool:
    """Is it declared as a constant? (A parameter with a final value counts as one, too.)"""
    span = parameter.origin.span
    words = re.findall(r"\b(parameter|constant)\b", span.source.text[: span.start].rpartition(";")[2])
    return bool(words) and words[-1] == "constant"


def _has_default(parameter: Parameter) -> bool:
    """Does the declaration say a value? (Strings and what is in parentheses say none.)"""
    text = re.sub(r'"(?:[^"\\]|\\.)*"', "", parameter.origin.span.text)
    while "(" in text:
        shorter = re.sub(r"\([^()]*\)", "", text)
        if shorter == text:
            break
        text = shorter
    return "=" in text


def _unit(unit: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    return (f'{"each " if shape else ""}unit = "{unit}"',) if unit else ()
