"""What the compiler made of a model, as lines of text: the views of `bgc show`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bgdsl.expr import to_text
from bgdsl.ir.program import Assign, SolveLinear, SolveNewton, Step, defined
from bgdsl.passes.strokes import strokes_text
from bgdsl.pipeline import Model


def tree(model: Model) -> list[str]:
    """The instances, each under its parent, with class and description."""
    lines = []
    for instance in model.graph.instances:
        depth = instance.path.count(".") + 1 if instance.path else 0
        name = instance.path.rpartition(".")[2] or model.name
        what = f"{name}: {instance.class_name}" if instance.path else instance.class_name
        lines.append("  " * depth + what + (f'  "{instance.comment}"' if instance.comment else ""))
    return lines


def bonds(model: Model) -> list[str]:
    """The flat bonds: name, ends, domain."""
    lines = []
    for bond in model.graph.bonds:
        sign = "->" if bond.size is None else "=>"
        size = "" if bond.size is None else f"[{bond.size}]"
        domain = "" if bond.domain == "Generic" else f"  // {bond.domain}"
        lines.append(f"{bond.name}{size}: {bond.tail.node} {sign} {bond.head.node}{domain}")
    return lines


def causality(model: Model) -> list[str]:
    """The bonds with their strokes, then what causality found: dependent storages, constraints, loops."""
    return strokes_text(model.causal).splitlines()


def equations(model: Model) -> list[str]:
    """The sorted equations, in evaluation order, each with its place."""
    program = model.program
    last = {f"der({record.name})" for record in program.states}
    lines = [line for step in program.steps if not last & set(defined(step)) for line in _step(step)]
    for record, value, origin in zip(program.states, program.derivatives, program.derivative_origins, strict=True):
        lines.append(_placed(f"der({record.name}) = {to_text(value)}", origin.span.place))
    return lines


def _step(step: Step) -> list[str]:
    place = step.origin.span.place
    match step:
        case Assign():
            return [_placed(f"{step.variable} = {to_text(step.value)}", place)]
        case SolveLinear():
            rows: list[list[str]] = [[] for _ in step.right]
            for row, column, value in step.entries:
                rows[row].append(f"({to_text(value)})*{step.variables[column]}")
            head = [_placed(f"solve for {', '.join(step.variables)}:", place)]
            return head + [f"  {' + '.join(row)} = {to_text(right)}" for row, right in zip(rows, step.right, strict=True)]
        case SolveNewton():
            head = [_placed(f"iterate for {', '.join(step.variables)}:", place)]
            inner = [f"  {assign.variable} = {to_text(assign.value)}" for assign in step.inner]
            return head + inner + [f"  0 = {to_text(residual)}" for residual in step.residuals]


def _placed(text: str, place: str) -> str:
    return f"{text}  // {place}"


def states(model: Model) -> list[str]:
    """The states with start value, unit and description."""
    program = model.program
    lines = []
    for record, start in zip(program.states, program.starts, strict=True):
        unit = f" {record.unit}" if record.unit else ""
        comment = f'  "{record.comment}"' if record.comment else ""
        lines.append(f"{record.name} = {to_text(start)}{unit}{comment}")
    return lines


VIEWS: Mapping[str, Callable[[Model], list[str]]] = {
    "tree": tree,
    "bonds": bonds,
    "causality": causality,
    "equations": equations,
    "states": states,
}
