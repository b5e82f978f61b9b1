"""What names stand for in a run: a variable, parameter or state by its dotted name, whole arrays spread over their entries.

Reports      BG618 no such variable
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bgdsl.diagnostics import Code, Reporter, did_you_mean
from bgdsl.expr import TIME, Expr, param
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import Program
from bgdsl.source import said

NO_VARIABLE = Code("BG618", "no such variable")


@dataclass(frozen=True, slots=True)
class Column:
    """A scalar to record."""

    name: str
    value: Expr
    unit: str = ""


def output_columns(program: Program) -> tuple[Column, ...]:
    """The model's outputs; its states where it has none."""
    if program.outputs:
        return tuple(Column(record.name, value, record.unit) for record, value in program.outputs)
    return tuple(Column(record.name, program.values[record.name], record.unit) for record in program.states)


def find_columns(program: Program, names: Iterable[str], report: Reporter) -> tuple[Column, ...]:
    """The columns for the names, in their order, each scalar once. Unknown names are reported, all of them."""
    columns: dict[str, Column] = {}
    units = {record.name: record.unit for record in (*program.states, *program.inputs, *(record for record, _ in program.outputs))}
    parameters = frozenset(parameter_names(program))
    for name in names:
        found = _entries(name, program.values, parameters)
        if not found:
            helps = did_you_mean(name, _near(name, (*program.values, *parameters)))
            report.add(NO_VARIABLE, f"model `{program.model}` has no variable `{name}`", said(name), helps=helps)
        for scalar, value in found.items():
            if scalar != "time":
                columns[scalar] = Column(scalar, value, units.get(scalar, ""))
    report.stop_if_errors()
    return tuple(columns.values())


def _near(name: str, known: Iterable[str]) -> list[str]:
    """The names worth comparing: a large model has so many that comparing all would take seconds."""
    everything = list(known)
    if len(everything) <= 3000:
        return everything
    last = name.rpartition(".")[2]
    return [other for other in everything if (other[:3] == name[:3] and abs(len(other) - len(name)) <= 3) or other.endswith(last)][:3000]


def _entries(name: str, values: Mapping[str, Expr], parameters: frozenset[str]) -> dict[str, Expr]:
    """The scalars of a name: itself, or the entries `name[1]`, ... or `name[1,1]`, ... row-major."""

    def scalar(candidate: str) -> Expr | None:
        if candidate in values:
            return values[candidate]
        return param(candidate) if candidate in parameters else None

    if name == "time":
        return {name: TIME}
    value = scalar(name)
    if value is not None:
        return {name: value}
    found: dict[str, Expr] = {}
    for i in _counting():
        entry = scalar(f"{name}[{i}]")
        if entry is not None:
            found[f"{name}[{i}]"] = entry
            continue
        row = {}
        for j in _counting():
            entry = scalar(f"{name}[{i},{j}]")
            if entry is None:
                break
            row[f"{name}[{i},{j}]"] = entry
        if not row:
            return found
        found.update(row)
    return found


def _counting() -> Iterable[int]:
    from itertools import count

    return count(1)
