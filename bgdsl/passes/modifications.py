"""Modifications as they stand in the text: a tree of names.

Input        the arguments of one modification
Output       `Modification`s by name, made once from the text; values are expressions still
Establishes  each name is said once in one place, but for what is said of single elements of arrays
Reports      BG223 modified twice
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from bgdsl.diagnostics import Code, Reporter
from bgdsl.source import Span
from bgdsl.syntax import ast

MODIFIED_TWICE = Code("BG223", "one thing is modified twice in one place")


@dataclass(slots=True, eq=False)
class Modification:
    """What one place says about one name: a value, nested modifications, a redeclaration. A declaration is one of itself."""

    name: str
    span: Span
    value: ast.Expression | None = None
    nested: dict[str, Modification] = field(default_factory=dict)
    each: bool = False
    final: bool = False
    redeclared: ast.Redeclaration | None = None
    parts: list[tuple[tuple[ast.Expression, ...], Modification]] = field(default_factory=list)

    @property
    def says_something(self) -> bool:
        """Whether it changes more than single elements."""
        return self.value is not None or bool(self.nested) or self.redeclared is not None


def modifications(arguments: Iterable[ast.Argument], report: Reporter) -> dict[str, Modification]:
    """The arguments of a modification by name; `a.b = 1` nests, `a[2] = 1` goes to the parts of `a`."""
    table: dict[str, Modification] = {}
    for argument in arguments:
        match argument:
            case ast.Modifier(name=name):
                _insert(table, name.parts, argument, report)
            case ast.Redeclaration(name=name):
                nested = modifications(argument.arguments, report)
                new = Modification(name, argument.span, None, nested, argument.each, argument.final, argument)
                _add(table, argument.subscripts, new, report)
    return table


def _insert(table: dict[str, Modification], parts: tuple[ast.Part, ...], modifier: ast.Modifier, report: Reporter) -> None:
    part, rest = parts[0], parts[1:]
    new = Modification(part.name, modifier.span, each=modifier.each and not rest)
    if rest:
        _insert(new.nested, rest, modifier, report)
    else:
        new.value, new.final = modifier.value, modifier.final
        new.nested = modifications(modifier.nested, report)
    _add(table, part.subscripts, new, report)


def _add(table: dict[str, Modification], subscripts: tuple[ast.Expression, ...], new: Modification, report: Reporter) -> None:
    """Put a modification into its table; what is said of chosen elements of an array goes to the parts of what is said of all."""
    if not subscripts:
        _merge(table, new, report)
        return
    holder = table.setdefault(new.name, Modification(new.name, new.span))
    if holder.each and not new.each:
        _each_and_not(holder, new, report)
    else:
        holder.parts.append((subscripts, new))


def _merge(table: dict[str, Modification], new: Modification, report: Reporter) -> None:
    old = table.get(new.name)
    if old is None:
        table[new.name] = new
        return
    if (old.value is not None and new.value is not None) or (old.redeclared and new.redeclared):
        what = "redeclared" if old.redeclared and new.redeclared else "modified"
        report.add(
            MODIFIED_TWICE,
            f"`{new.name}` is {what} twice in one place",
            new.span,
            "again here",
            others=[(old.span, f"first {what} here")],
        )
        return
    if old.each != new.each and not _for_each(new if old.each else old):
        _each_and_not(old, new, report)
        return
    old.value = old.value if old.value is not None else new.value
    old.redeclared = old.redeclared or new.redeclared
    old.final = old.final or new.final
    old.each = old.each or new.each
    old.parts += new.parts
    for nested in new.nested.values():
        _merge(old.nested, nested, report)


def _for_each(entry: Modification) -> bool:
    """Whether all that it says is said with `each`."""
    if entry.each:
        return True
    here = entry.value is None and entry.redeclared is None
    return here and all(map(_for_each, entry.nested.values())) and all(_for_each(part) for _, part in entry.parts)


def _each_and_not(old: Modification, new: Modification, report: Reporter) -> None:
    """One place says of one thing what holds for each, and beside it what is indexed: it is not clear which entry is meant."""
    first, second = ("with", "without") if old.each else ("without", "with")
    report.add(
        MODIFIED_TWICE,
        f"`{new.name}` is modified {first} `each` and {second} it in one place",
        new.span,
        f"{second} `each`",
        others=[(old.span, f"{first} `each`")],
        helps=(f"put `each` inside, before what it is for: `{new.name}(each a = 1, b = {{1, 2}})`",),
    )


def same(a: Modification, b: Modification) -> bool:
    """Whether two modifications say the same, wherever they stand."""
    if a is b:
        return True
    if (a.value, a.each, a.final, a.redeclared) != (b.value, b.each, b.final, b.redeclared) or a.nested.keys() != b.nested.keys():
        return False
    if len(a.parts) != len(b.parts) or any(
        one != other or not same(part, twin) for (one, part), (other, twin) in zip(a.parts, b.parts, strict=True)
    ):
        return False
    return all(same(inner, b.nested[name]) for name, inner in a.nested.items())
