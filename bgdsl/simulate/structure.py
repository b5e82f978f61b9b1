"""What a run changes of a model's structure: the parameters that decide sizes and conditions, with the values they shall have.

Input        the flat model's parameters, the experiment, the caller's changes
Output       the changed structural parameters by name: entries of arrays one by one, unless the caller gives an array whole
Establishes  a value that an experiment gives by others is taken with these as the run changes them
Reports      what `options` reports of values
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bgdsl.diagnostics import Reporter
from bgdsl.expr import Expr
from bgdsl.ir.graph import Experiment, Parameter, array_of_entry, scalar_names
from bgdsl.simulate.options import evaluated


def structural_changes(
    parameters: Sequence[Parameter], experiments: Iterable[Experiment], experiment: str | None, changes: Mapping[str, Any]
) -> dict[str, Any]:
    """The structural parameters that the run changes, each with its value. Empty where the model has been flattened with these."""
    owner = {name: parameter for parameter in parameters for name in parameter.scalars()}
    whole = {parameter.name: parameter for parameter in parameters if parameter.shape}
    chosen = _chosen(experiments, experiment)
    given: dict[str, Any] = {name: value for name, value in changes.items() if name in whole and whole[name].structural}
    said = {name: value for name, value in (chosen.changes if chosen else {}).items() if array_of_entry(name) not in given}
    resized = {name: found for name, found in (chosen.resized if chosen else {}).items() if name not in given}
    wanted = [name for name in {**said, **changes} if name in owner and owner[name].structural and array_of_entry(name) not in resized]
    if not wanted and not resized:
        return given
    formulas: dict[str, Expr | float] = {}
    for parameter in parameters:
        formulas |= zip(parameter.scalars(), parameter.values, strict=True)
    formulas |= said
    for name, (shape, items) in resized.items():
        formulas |= zip(scalar_names(name, shape), items, strict=True)
        owner |= dict.fromkeys(scalar_names(name, shape), whole[name])
    formulas |= {name: float(value) for name, value in _scalars(changes, whole) if name in owner}
    report = Reporter()
    values = evaluated({name: _plain(value) for name, value in formulas.items()}, {}, owner, report)
    report.stop_if_errors()
    given |= {name: values[name] for name in wanted if not _stands(owner[name], name, values[name])}
    return given | {name: _nested([values[entry] for entry in scalar_names(name, shape)], shape) for name, (shape, _) in resized.items()}


def _nested(numbers: Sequence[float], shape: Sequence[int]) -> tuple[Any, ...]:
    """An array as tuples in tuples, from its entries row-major."""
    if len(shape) == 1:
        return tuple(numbers)
    step = len(numbers) // shape[0] if shape[0] else 0
    return tuple(_nested(numbers[i * step : (i + 1) * step], shape[1:]) for i in range(shape[0]))


def _stands(parameter: Parameter, name: str, value: float) -> bool:
    """Whether the model has been flattened with this value."""
    default = parameter.values[parameter.scalars().index(name)]
    return default.op == "const" and default.data == value


def _chosen(experiments: Iterable[Experiment], name: str | None) -> Experiment | None:
    """The experiment of that name, without a name the only one."""
    known = list(experiments)
    alone = name is None and len(known) == 1
    return next((item for item in known if alone or item.name == name), None)


def _scalars(changes: Mapping[str, Any], whole: Mapping[str, Parameter]) -> Iterable[tuple[str, float]]:
    """The caller's numbers by scalar name; arrays are opened where they have their parameter's size."""
    for name, value in changes.items():
        if isinstance(value, float | int):
            yield from ((scalar, value) for scalar in (whole[name].scalars() if name in whole else (name,)))
        elif name in whole and isinstance(value, Sequence) and len(value) == len(whole[name].scalars()):
            yield from ((scalar, item) for scalar, item in zip(whole[name].scalars(), value, strict=True) if isinstance(item, float | int))


def _plain(value: Expr | float) -> Expr | float:
    return float(value.data) if isinstance(value, Expr) and value.op == "const" else value
