"""Structural parameters whose default no instance has: what acts in a class is said for the structure that it has by itself.

Input        Writer with what acts in each instance
Output       the instances of another structure than their class has by itself; defaults changed where no instance has them
Establishes  every class of the reduced file is right by itself, too: its matrices have the sizes that its defaults give them
"""

from __future__ import annotations

from bgdsl.ir.graph import Parameter
from bgdsl.reductions.acts import registry
from bgdsl.reductions.source_map import ClassText
from bgdsl.reductions.writer import Writer
from bgdsl.syntax import ast


def settle_defaults(writer: Writer) -> frozenset[str]:
    """The odd instances, with their insides. A default that every instance overrides becomes the value of the first."""
    whole = registry(writer.edits)
    found: dict[tuple[tuple[int, int], str], list[tuple[str, float]]] = {}
    places: dict[tuple[tuple[int, int], str], tuple[ClassText, ast.Declarator]] = {}
    for parameter in writer.graph.parameters:
        path, _, name = parameter.name.rpartition(".")
        place = _place(writer, parameter, path, name) if path in whole and parameter.structural and not parameter.shape else None
        if place is not None and parameter.name in writer.numbers:
            key = (place[0].key, name)
            places[key] = place
            found.setdefault(key, []).append((path, writer.numbers[parameter.name]))
    odd: set[str] = set()
    for key, values in found.items():
        unit, declarator = places[key]
        literal = declarator.value
        assert isinstance(literal, ast.Number | ast.Boolean)
        default = float(literal.value)
        if all(value != default for _, value in values):
            default = values[0][1]
            shown = ("false", "true")[int(default)] if isinstance(literal, ast.Boolean) else f"{default:g}"
            for path, _ in values:
                writer.of(path, unit).replace(literal.span, shown)
        odd |= {path for path, value in values if value != default}
    return frozenset(path for path in writer.texts.instances if path in odd)


def _place(writer: Writer, parameter: Parameter, path: str, name: str) -> tuple[ClassText, ast.Declarator] | None:
    """Where a parameter is declared, with a number or truth value as its default."""
    member = writer.texts.member(path, name)
    if member is None or not isinstance(member[2].value, ast.Number | ast.Boolean) or parameter.constant:
        return None
    return member[0], member[2]
