"""A program as the text of a Python module that needs NumPy only.

Input        Program, the name of its source
Output       text: the same program and version give the same bytes
Establishes  what the user wrote reaches the text through `repr` or, with nothing but printable characters, in comments

The template `templates/module.py.j2` only places what is made ready here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

from bgdsl.backends.initial import parameter_values, start_values
from bgdsl.backends.numpy.names import printable
from bgdsl.backends.numpy.spell import Names, Speller
from bgdsl.collecting import uncollected
from bgdsl.expr import Expr, Table
from bgdsl.ir.program import Assign, Program, Record, Step

_TAKEN = frozenset(
    (
        *("np", "MODEL", "SOURCE", "DIGEST", "TOOL", "STATES", "OUTPUTS", "INPUTS", "BONDS", "PARAMETERS", "Record"),
        *("parameters", "initial_state", "rhs", "jacobian", "outputs", "bonds"),
        *("t", "x", "p", "u", "shape", "x0", "dx", "y", "J", "effort", "flow", "changed"),
    )
)


@dataclass(frozen=True, slots=True)
class Context:
    """What the template places: each field is ready-made text."""

    heading: str
    model: str
    source: str
    digest: str
    tool: str
    states: str
    outputs: str
    inputs: str
    bonds: str
    parameters: str
    fixed: str
    tables: str
    parameter_lines: str
    size: str
    initial_lines: str
    rhs_lines: str
    jacobian_shape: str
    jacobian_lines: str
    jacobian_result: str
    output_count: str
    output_lines: str
    bond_count: str
    bond_lines: str
    elimination: str


@uncollected()
def write_module(program: Program, *, source_name: str) -> str:
    """The module's text. `source_name` is shown as SOURCE."""
    return str(_template().render(**asdict(context(program, source_name))))


def context(program: Program, source_name: str) -> Context:
    """The ready-made parts of the module."""
    from bgdsl.version import VERSION

    names = Names.of(program, _TAKEN)
    defaults = parameter_values(program)
    starts = start_values(program, defaults)
    return Context(
        heading=_heading(program, source_name, VERSION),
        model=repr(program.model),
        source=repr(source_name),
        digest=repr(program.digest),
        tool=repr(f"bgdsl {VERSION}"),
        states=_records(program.states, starts),
        outputs=_records(record for record, _ in program.outputs),
        inputs=_records(program.inputs),
        bonds=_records(record for record, _, _ in program.bonds),
        parameters=_defaults(program, defaults),
        fixed=repr(tuple(p.name for p in program.parameters if p.structural or p.constant)),
        tables=_tables(program, names),
        parameter_lines=_indented(_parameter_lines(program, names), 12),
        size=str(len(program.states)),
        initial_lines=_indented(_initial_lines(program, names), 8),
        rhs_lines=_indented(_rhs_lines(program, names), 8),
        output_count=str(len(program.outputs)),
        output_lines=_indented(_output_lines(program, names), 8),
        bond_count=str(len(program.bonds)),
        bond_lines=_indented(_bond_lines(program, names), 8),
        **_jacobian(program, names),
    )


@cache
def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("bgdsl.backends.numpy"), undefined=StrictUndefined, keep_trailing_newline=False)
    return environment.get_template("module.py.j2")


# ----------------------------------------------------------------------------------------------------------------- data


def _heading(program: Program, source_name: str, version: str) -> str:
    lines = [
        f"# model   {printable(program.model)}{f': {printable(program.comment, 160)}' if program.comment else ''}",
        f"# source  {printable(source_name, 160)}",
        f"# digest  {printable(program.digest)}",
        f"# tool    bgdsl {version}",
    ]
    return "\n".join(lines) + "\n"


def _records(records: Iterable[Record], starts: Sequence[float] | None = None) -> str:
    fields: list[tuple[str | float, ...]] = [(record.name, record.unit, record.comment) for record in records]
    if starts is not None:
        fields = [(*known, start) for known, start in zip(fields, starts, strict=True)]
    return "".join(f"    Record(({', '.join(_literal(value) for value in known)})),\n" for known in fields)


def _literal(value: Any) -> str:
    """A float, a text or nested tuples of floats as Python."""
    if isinstance(value, tuple):
        return "(" + ", ".join(_literal(one) for one in value) + ("," if len(value) == 1 else "") + ")"
    if isinstance(value, float) and not math.isfinite(value):
        return f"float({str(value)!r})"
    return repr(value)


def _shaped(values: Sequence[Any], shape: Sequence[int]) -> Any:
    """Row-major values as nested tuples of this shape."""
    if not shape:
        return values[0]
    width = len(values) // shape[0] if shape[0] else 0
    return tuple(_shaped(values[i * width : (i + 1) * width], shape[1:]) for i in range(shape[0]))


def _defaults(program: Program, values: Sequence[float]) -> str:
    lines, k = [], 0
    for parameter in program.parameters:
        count = len(parameter.values)
        note = printable(" ".join(part for part in (parameter.unit and f"[{parameter.unit}]", parameter.comment) if part))
        lines.append(
            f"    {parameter.name!r}: {_literal(_shaped(values[k : k + count], parameter.shape))},{f'  # {note}' if note else ''}\n"
        )
        k += count
    return "".join(lines)


def _tables(program: Program, names: Names) -> str:
    first = {python: program.tables[name] for name, python in reversed(list(names.tables.items()))}
    return "".join(line for python, table in reversed(list(first.items())) for line in _table_lines(python, table))


def _table_lines(python: str, table: Table) -> Iterator[str]:
    """grid, coefficients, period"""
    yield f"\n# table {printable(table.name)}\n{python} = (\n"
    yield f"    np.array([\n{_wrapped(table.x)}    ]),\n    np.array([\n"
    for row in table.c:
        yield f"    [\n{_wrapped(row)}    ],\n"
    yield f"    ]),\n    {_literal(table.x[-1] - table.x[0]) if table.periodic else None},\n)\n"


def _wrapped(values: Sequence[float]) -> str:
    """Numbers, a few to a line."""
    rows = (values[i : i + 5] for i in range(0, len(values), 5))
    return "".join(f"        {', '.join(_literal(value) for value in row)},\n" for row in rows)


# ------------------------------------------------------------------------------------------------------------ functions


def _indented(lines: Iterable[str], width: int) -> str:
    found = [f"{' ' * width}{line}" if line else "" for line in lines]
    while found and not found[0]:
        found.pop(0)
    return "\n".join(found) if found else f"{' ' * width}pass"


def _parameter_lines(program: Program, names: Names) -> Iterator[str]:
    """One line a parameter, in the order of their dependence; what later ones read gets a name."""
    speller = Speller(program, names, (), [value for parameter in program.parameters for value in parameter.values])
    used = {node.data for node in speller.seen if node.op == "param"}
    for parameter in program.parameters:
        default = f"PARAMETERS[{parameter.name!r}]"
        if not all(value.is_const for value in parameter.values):
            texts = tuple(_Text(speller.text(value)) for value in parameter.values)
            default = _literal(_shaped(texts, parameter.shape))
        speller.lines.append(f"p[{parameter.name!r}] = _chosen(changed, {parameter.name!r}, {default})")
        speller.lines += (f"{names.parameters[name]} = {names.fetches[name]}" for name in parameter.scalars() if name in used)
    return iter(speller.lines)


class _Text(str):
    """Text of an expression, shown as it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"float({self})"


def _initial_lines(program: Program, names: Names) -> Iterator[str]:
    """Initial equations, states, and a check of starts that other states decide."""
    speller = Speller(program, names, program.initial_steps, program.starts)
    speller.fetch()
    speller.run()
    for i, (record, start) in enumerate(zip(program.states, program.starts, strict=True)):
        speller.set(f"x0[{i}]", start, record.name)
    yield from speller.lines
    checked = [(name, value, start) for name, value, start in program.dependent if start is not None]
    if checked:
        yield from _dependent_lines(program, names, checked)


def _dependent_lines(program: Program, names: Names, checked: Sequence[tuple[str, Expr, Expr]]) -> Iterator[str]:
    speller = Speller(program, names, program.steps, [part for _, value, start in checked for part in (value, start)])
    inputs = {record.name for record in program.inputs}
    if inputs and any(node.op == "var" and node.data in inputs for node in speller.seen):
        return
    yield "x = x0"
    speller.fetch()
    speller.run()
    yield from speller.lines
    for name, value, start in checked:
        yield f"_agree({name!r}, {speller.text(value)}, {speller.text(start)})"


def _rhs_lines(program: Program, names: Names) -> Iterator[str]:
    speller = Speller(program, names, program.steps, program.derivatives)
    speller.fetch()
    speller.run()
    speller.lines.append("")
    for i, (record, value) in enumerate(zip(program.states, program.derivatives, strict=True)):
        speller.set(f"dx[{i}]", value, record.name)
    return iter(speller.lines)


def _output_lines(program: Program, names: Names) -> Iterator[str]:
    speller = Speller(program, names, program.steps, [value for _, value in program.outputs], comments=False)
    speller.fetch()
    speller.run()
    for i, (record, value) in enumerate(program.outputs):
        speller.set(f"y[{i}]", value, record.name)
    return iter(speller.lines)


def _bond_lines(program: Program, names: Names) -> Iterator[str]:
    roots = [value for _, effort, flow in program.bonds for value in (effort, flow)]
    speller = Speller(program, names, program.steps, roots, comments=False)
    speller.fetch()
    speller.run()
    for i, (record, effort, flow) in enumerate(program.bonds):
        speller.set(f"effort[{i}]", effort, record.name)
        speller.set(f"flow[{i}]", flow)
    return iter(speller.lines)


def _jacobian(program: Program, names: Names) -> dict[str, str]:
    """The function's parts: entries, and the elimination of solved blocks where there are any."""
    matrix, n = program.jacobian.matrix, len(program.states)
    speller = Speller(program, names, program.steps, [value for _, _, value in matrix.entries], comments=False)
    speller.fetch()
    speller.run()
    for i, j, value in matrix.entries:
        speller.set(f"J[{i}, {j}]", value)
    solved = [step for step in program.needed(program.derivatives) if not isinstance(step, Assign)]
    blocks = _blocks(program, solved)
    return {
        "jacobian_shape": str(tuple(matrix.shape)),
        "jacobian_lines": _indented(speller.lines, 8),
        "jacobian_result": f"_eliminated(J, {n}, {blocks!r}, t)" if solved else "J",
        "elimination": (_ELIMINATION if solved else "") + (_AGREE if any(start is not None for _, _, start in program.dependent) else ""),
    }


def _blocks(program: Program, solved: Sequence[Step]) -> list[tuple[int, int, list[int], str]]:
    """Of each solved block: its first column, the one after its last, the rows outside it that read it, and its name."""
    position = len(program.states)
    column_of: dict[int, int] = {}
    found: list[tuple[int, int, list[int], str]] = []
    for k, step in enumerate(solved):
        assert not isinstance(step, Assign)
        size = len(step.variables)
        column_of |= dict.fromkeys(range(position, position + size), k)
        found.append((position, position + size, [], step.name))
        position += size
    readers: list[set[int]] = [set() for _ in found]
    for i, j, _ in program.jacobian.matrix.entries:
        if j in column_of and column_of.get(i) != column_of[j]:
            readers[column_of[j]].add(i)
    return [(start, end, sorted(rows), name) for (start, end, _, name), rows in zip(found, readers, strict=True)]


_ELIMINATION = '''

def _eliminated(J, n, blocks, t):
    """The derivatives by the n states alone: the unknowns of each solved block put in terms of the states, block by block."""
    J = np.moveaxis(J, (0, 1), (-2, -1))
    for start, end, readers, name in blocks:
        try:
            slope = np.linalg.solve(J[..., start:end, start:end], J[..., start:end, :n])
        except np.linalg.LinAlgError:
            raise ArithmeticError("the loop through %s is singular at t = %g" % (name, t)) from None
        J[..., readers, :n] -= J[..., readers, start:end] @ slope
    return np.moveaxis(J[..., :n, :n], (-2, -1), (0, 1))
'''

_AGREE = '''

def _agree(name, value, start):
    """Complain where a start that was given is not what the other states make of it."""
    if not abs(value - start) <= 1e-9 * max(1.0, abs(value)):
        raise ArithmeticError("the start of %s is given as %g, but the other states make it %g" % (name, start, value))
'''
