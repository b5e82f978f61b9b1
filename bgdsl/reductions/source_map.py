"""Where flat things stand in the text: classes by their span, members by name, statements by span.

Nothing is decided here; a reduction asks, and edits what it is shown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NoReturn

from bgdsl.diagnostics import Code, Reporter
from bgdsl.ir.graph import BondGraph, Origin
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library, Module

NOT_WRITTEN = Code("BG703", "a reduced model cannot be written")


def refuse(graph: BondGraph, reason: str) -> NoReturn:
    """End the work: the reduced model cannot be written."""
    Reporter().fail(NOT_WRITTEN, f"the reduced model cannot be written: {reason}", Span(graph.sources[0], 0, 0))


class UnwritableError(Exception):
    """The change to these terms cannot be written as text at this place; the reason is for people."""

    def __init__(self, terms: tuple[int, ...], reason: str):
        self.terms = terms
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True, eq=False)
class ClassText:
    """A model or element definition, the file it stands in and the definitions around it, outermost first."""

    module: Module
    model: ast.Model
    outer: tuple[ast.Model, ...] = ()

    @property
    def key(self) -> tuple[int, int]:
        return id(self.module.source), self.model.span.start

    def holds(self, span: Span) -> bool:
        own = self.model.span
        return span.source is own.source and own.start <= span.start and span.end <= own.end


@dataclass(frozen=True, slots=True)
class Site:
    """Where the class of an instance (or the kind of an element) is named: in the text `unit` of the instance `owner`, by a
    declarator or a redeclaration. index: among the elements that this declares, () if there is one.

    afar: the redeclaration is a modification of the part `owner` has, not of its own component: it cannot be split by index.
    """

    owner: str
    unit: ClassText
    node: ast.Declarator | ast.Redeclaration
    index: tuple[int, ...]
    afar: bool = False


@dataclass(frozen=True, slots=True)
class Place:
    """A bond statement and the `for` loops around it, outermost first."""

    statement: ast.BondChain
    loops: tuple[ast.For, ...]


class SourceMap:
    """The classes of a library and the instances of one flat model made from it."""

    def __init__(self, library: Library, graph: BondGraph):
        self.library = library
        self.graph = graph
        self.classes = {cls.key: cls for module in library.modules.values() for cls in _classes(module)}
        self.instances = {instance.path: instance for instance in graph.instances}
        self._places: dict[tuple[int, int], dict[tuple[int, int], Place]] = {}
        self._statements: dict[tuple[int, int], tuple[Place, ...]] = {}
        self._units: dict[tuple[int, int], tuple[ClassText, ...]] = {}
        self._members: dict[tuple[int, int], dict[str, tuple[ast.Declaration, ast.Declarator]]] = {}
        self._redeclares = any(isinstance(node, ast.Redeclaration) for cls in self.classes.values() for node in walk(cls.model))

    def class_of(self, path: str) -> ClassText:
        """The class of the instance at a path ("" is the model itself)."""
        span = self.instances[path].class_span
        return self.classes[id(span.source), span.start]

    def units(self, cls: ClassText) -> tuple[ClassText, ...]:
        """The class and everything it extends, itself first."""
        found = self._units.get(cls.key)
        if found is None:
            stack, seen = [cls], dict[tuple[int, int], ClassText]()
            while stack:
                one = stack.pop()
                if one.key not in seen:
                    seen[one.key] = one
                    stack += [base for _, base in self.bases(one)]
            found = self._units[cls.key] = tuple(seen.values())
        return found

    def bases(self, cls: ClassText) -> Iterator[tuple[ast.Extends, ClassText]]:
        """The `extends` clauses of a class with the classes they name."""
        for item in cls.model.items:
            if isinstance(item, ast.Extends):
                base = self.named(cls, item.base.text)
                if base is not None:
                    yield item, base

    def named(self, cls: ClassText, name: str) -> ClassText | None:
        """The class that a name means inside another class's text."""
        first, *rest = name.split(".")
        found = self._first(cls, first)
        for part in rest:
            if found is None:
                return self._qualified(cls, name)
            found = next((inner for inner in self._nested(found) if inner.model.name == part), None)
        return found or self._qualified(cls, name)

    def _first(self, cls: ClassText, name: str) -> ClassText | None:
        for around in (cls.model, *reversed(cls.outer)):
            for item in around.items:
                if isinstance(item, ast.Model) and item.name == name:
                    return self.classes[id(cls.module.source), item.span.start]
        definition = cls.module.definitions.get(name)
        if isinstance(definition, ast.Model):
            return self.classes[id(cls.module.source), definition.span.start]
        for around in (cls.model, *reversed(cls.outer)):
            target = cls.module.nested.get(id(around), {}).get(name)
            if target is not None:
                return self._imported(target.module, target.name)
        target = cls.module.imports.get(name)
        return self._imported(target.module, target.name) if target else None

    def _qualified(self, cls: ClassText, name: str) -> ClassText | None:
        target = cls.module.qualified.get(name)
        return self._imported(target.module, target.name) if target else None

    def _imported(self, key: str, name: str) -> ClassText | None:
        module = self.library.modules[key]
        definition = module.definitions.get(name)
        return self.classes[id(module.source), definition.span.start] if isinstance(definition, ast.Model) else None

    def _nested(self, cls: ClassText) -> Iterator[ClassText]:
        for item in cls.model.items:
            if isinstance(item, ast.Model):
                yield self.classes[id(cls.module.source), item.span.start]

    def unit_at(self, origin: Origin) -> ClassText | None:
        """The class text, own or inherited, of the origin's instance in which its span stands."""
        holding = [unit for unit in self.units(self.class_of(origin.path)) if unit.holds(origin.span)]
        return max(holding, key=lambda unit: unit.model.span.start, default=None)

    def statements(self, unit: ClassText) -> tuple[Place, ...]:
        """The bond statements of a class's own text."""
        found = self._statements.get(unit.key)
        if found is None:
            found = self._statements[unit.key] = tuple(bond_statements(unit.model))
        return found

    def place(self, unit: ClassText, span: Span) -> Place | None:
        """The bond statement at (or around) a span."""
        places = self._places.get(unit.key)
        if places is None:
            places = {(p.statement.span.start, p.statement.span.end): p for p in self.statements(unit)}
            self._places[unit.key] = places
        exact = places.get((span.start, span.end))
        return exact or next((p for (start, end), p in places.items() if start <= span.start and span.end <= end), None)

    def member(self, path: str, name: str) -> tuple[ClassText, ast.Declaration, ast.Declarator] | None:
        """The declaration of a component of an instance, in its own or an inherited text."""
        for unit in self.units(self.class_of(path)):
            found = self._declared(unit).get(name)
            if found is not None:
                return unit, *found
        return None

    def _declared(self, unit: ClassText) -> dict[str, tuple[ast.Declaration, ast.Declarator]]:
        declared = self._members.get(unit.key)
        if declared is None:
            items = [item for item in unit.model.items if isinstance(item, ast.Declaration)]
            declared = self._members[unit.key] = {d.name: (item, d) for item in items for d in item.declarators}
        return declared

    def site(self, path: str) -> Site:
        """Where the class of a component (an instance or an element) is named: outside in, as modifications win."""
        parent, _, last = path.rpartition(".")
        name, index = indexed(last)
        if self._redeclares:
            steps = path.split(".")
            for k in range(len(steps)):
                found = self._redeclared(".".join(steps[:k]), [indexed(step)[0] for step in steps[k:]], index)
                if found is not None:
                    return found
        member = self.member(parent, name)
        assert member is not None, path
        return Site(parent, member[0], member[2], index)

    def _redeclared(self, owner: str, steps: list[str], index: tuple[int, ...]) -> Site | None:
        """A redeclaration, in the text of the instance `owner`, of what the steps lead to."""
        for unit in self.units(self.class_of(owner)):
            for item in unit.model.items:
                match item:
                    case ast.Redeclaration(name=name) if steps == [name] and covers(item, index):
                        return Site(owner, unit, item, index)
                    case ast.Extends():
                        found = _in_arguments(item.arguments, steps, index)
                        if found is not None:
                            return Site(owner, unit, found, index, afar=len(steps) > 1)
                    case ast.Declaration() if len(steps) > 1:
                        for declarator in item.declarators:
                            found = _in_arguments(declarator.arguments, steps[1:], index) if declarator.name == steps[0] else None
                            if found is not None:
                                return Site(owner, unit, found, index, afar=True)
        return None


def indexed(step: str) -> tuple[str, tuple[int, ...]]:
    """Name and subscripts of a step of a path: `cyl[2]`."""
    name, _, subscripts = step.partition("[")
    return name, tuple(int(i) for i in subscripts.rstrip("]").split(",")) if subscripts else ()


def covers(redeclaration: ast.Redeclaration, index: tuple[int, ...]) -> bool:
    """Is the element among those redeclared? What is not written in numbers is taken to cover it."""
    return all(_covers(subscript, i) for subscript, i in zip(redeclaration.subscripts, index, strict=False))


def _covers(subscript: ast.Expression, i: int) -> bool:
    match subscript:
        case ast.Number(value=value):
            return int(float(value)) == i
        case ast.Range(start=ast.Number(value=first), step=None, stop=ast.Number(value=last)):
            return int(float(first)) <= i <= int(float(last))
        case ast.Array():
            return any(_covers(item, i) for item in subscript.items)
    return True


def _in_arguments(arguments: Sequence[ast.Argument], steps: Sequence[str], index: tuple[int, ...]) -> ast.Redeclaration | None:
    for step in steps[:-1]:
        found = next((a for a in arguments if isinstance(a, ast.Modifier) and a.name.text == step), None)
        if found is None:
            return None
        arguments = found.nested
    last = steps[-1]
    return next((a for a in arguments if isinstance(a, ast.Redeclaration) and a.name == last and covers(a, index)), None)


def _classes(module: Module) -> Iterator[ClassText]:
    stack: list[ClassText] = [ClassText(module, item) for item in module.tree.items if isinstance(item, ast.Model)]
    while stack:
        cls = stack.pop()
        yield cls
        stack += [ClassText(module, item, (*cls.outer, cls.model)) for item in cls.model.items if isinstance(item, ast.Model)]


def bond_statements(model: ast.Model) -> Iterator[Place]:
    """Every bond statement of a class's own text."""
    stack: list[tuple[ast.Statement, tuple[ast.For, ...]]] = []
    for section in reversed(model.sections):
        stack += [(statement, ()) for statement in reversed(section.statements)]
    while stack:
        statement, loops = stack.pop()
        match statement:
            case ast.BondChain():
                yield Place(statement, loops)
            case ast.For():
                stack += [(inner, (*loops, statement)) for inner in reversed(statement.body)]
            case ast.IfStatement():
                bodies = [*(body for _, body in statement.branches), statement.otherwise]
                stack += [(inner, loops) for body in reversed(bodies) for inner in reversed(body)]


def walk(node: ast.Node) -> Iterator[ast.Node]:
    """The node and every node in it, in the order written."""
    stack: list[object] = [node]
    while stack:
        item = stack.pop()
        if isinstance(item, ast.Node):
            yield item
            stack += [getattr(item, f.name) for f in reversed(fields(item)) if f.name != "span"]
        elif isinstance(item, tuple):
            stack += reversed(item)


def written(node: ast.Node, env: Mapping[str, int]) -> str:
    """The text of an expression with the iterators of `env` replaced by their values."""
    text, start = node.span.text, node.span.start
    if not env:
        return text
    for inner in sorted(_names(node, env), key=lambda inner: -inner.span.start):
        value = env[inner.parts[0].name]
        text = text[: inner.span.start - start] + str(value) + text[inner.span.end - start :]
    return text


def _names(node: ast.Node, env: Mapping[str, int]) -> Iterator[ast.Reference]:
    for inner in walk(node):
        if isinstance(inner, ast.Reference) and len(inner.parts) == 1 and not inner.parts[0].subscripts and inner.parts[0].name in env:
            yield inner
