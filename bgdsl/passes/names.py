"""What names of classes mean, and what each class consists of once its bases are merged in.

Input        Library
Output       `Class`: a model's or element's members, statements and experiments, made once for each definition
Establishes  every member knows its kind, the scope its text was written in and all modifications that its class's text makes
Reports      BG210 unknown class, BG211 duplicate name, BG212 wrong kind of class, BG213 cyclic `extends`,
             BG220 unknown target of a modification or redeclaration

Modifications stay as written; their values are evaluated when an instance asks for them, in the scope of the one who wrote them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from bgdsl.diagnostics import Code, Reporter, did_you_mean
from bgdsl.ir.domains import DOMAINS
from bgdsl.ir.elements import JUNCTIONS, KINDS
from bgdsl.passes.modifications import Modification, modifications, same
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library, Module

UNKNOWN_CLASS = Code("BG210", "unknown class")
DUPLICATE = Code("BG211", "a name is declared twice")
WRONG_KIND = Code("BG212", "a class is of another kind than wanted here")
CYCLIC_EXTENDS = Code("BG213", "a class extends itself")
UNKNOWN_TARGET = Code("BG220", "unknown modification target")

BASIC = ("Real", "Integer", "Boolean", "String", "Table")
BUILT_IN = frozenset((*BASIC, *KINDS, *JUNCTIONS, *DOMAINS))
"""Class names that the language gives; a user's class cannot take one."""


# --------------------------------------------------------------------------------------------------------------- scopes


@dataclass(slots=True, eq=False)
class Scope:
    """Where names of classes are looked up: a class's body, then the class around it, then the file."""

    module: Module
    outer: Scope | None
    own: Mapping[str, tuple[ast.Definition, Scope]]
    imports: Mapping[str, tuple[str, str]]
    place: str


@dataclass(frozen=True, slots=True)
class Resolved:
    """What a class name stands for: a built-in name, or a definition and the scope it was written in."""

    name: str
    node: ast.Definition | None
    scope: Scope | None


@dataclass(slots=True, eq=False)
class Member:
    """One declared component of a class. `entry` is what the declaration itself says (value and arguments); `claims` are the
    modifications by `extends` clauses, outermost first, each with the scope it was written in."""

    name: str
    declaration: ast.Declaration
    declarator: ast.Declarator
    scope: Scope
    type: Resolved
    entry: Modification
    claims: tuple[tuple[Modification, Scope], ...]
    prefixes: frozenset[str]
    hidden: bool

    @property
    def span(self) -> Span:
        return self.declarator.span


@dataclass(slots=True, eq=False)
class Class:
    """A model or element with everything it inherits. `own` are the classes that its body defines or inherits."""

    name: str
    node: ast.Model
    scope: Scope
    members: dict[str, Member]
    statements: tuple[tuple[ast.Statement, Scope], ...]
    initial: tuple[tuple[ast.Statement, Scope], ...]
    experiments: dict[str, tuple[ast.Experiment, Scope]]
    own: dict[str, tuple[ast.Definition, Scope]]
    checked: set[int] = field(default_factory=set)

    @property
    def is_element(self) -> bool:
        return self.node.kind == "element"


@dataclass
class Names:
    """Looks names of classes up and makes each class once."""

    library: Library
    report: Reporter
    classes: dict[int, Class | None] = field(default_factory=dict)
    bodies: dict[int, Class] = field(default_factory=dict)
    building: list[ast.Model] = field(default_factory=list)
    files: dict[str, Scope] = field(default_factory=dict)
    tables: dict[int, tuple[object, dict[str, Modification]]] = field(default_factory=dict)

    # -------------------------------------------------------------------------------------------------------- lookup

    def file_scope(self, module: Module) -> Scope:
        if module.key not in self.files:
            own: dict[str, tuple[ast.Definition, Scope]] = {}
            imports = {name: (target.module, target.name) for name, target in module.imports.items()}
            scope = Scope(module, None, own, imports, module.source.name)
            own.update((name, (node, scope)) for name, node in module.definitions.items())
            self.files[module.key] = scope
            self._check_file(module)
        return self.files[module.key]

    def _check_file(self, module: Module) -> None:
        first: dict[str, Span] = {name: target.span for name, target in module.imports.items()}
        for item in module.tree.items:
            if isinstance(item, ast.Import | ast.Test):
                continue
            if item.name in BUILT_IN:
                self._duplicate(item.name, head(item.span), "the language itself defines a class of this name", ())
            elif item.name in first:
                self._duplicate(item.name, head(item.span), "again here", ((head(first[item.name]), "first here"),))
            first.setdefault(item.name, item.span)

    def _duplicate(self, name: str, span: Span, label: str, others: Iterable[tuple[Span, str]]) -> None:
        self.report.add(DUPLICATE, f"`{name}` is declared twice", span, label, others=others, helps=("give one of them another name",))

    def find(self, name: str, scope: Scope) -> Resolved | None:
        """A class by simple name, from the inside out; built-in names come last."""
        here: Scope | None = scope
        while here is not None:
            if name in here.own:
                node, where = here.own[name]
                return Resolved(name, node, where)
            if name in here.imports:
                key, wanted = here.imports[name]
                other = self.file_scope(self.library.modules[key])
                node, where = other.own[wanted]
                return Resolved(wanted, node, where)
            here = here.outer
        return Resolved(name, None, None) if name in BUILT_IN else None

    def find_dotted(self, reference: ast.Reference, scope: Scope) -> Resolved | None:
        first = self.find(reference.parts[0].name, scope)
        if len(reference.parts) == 1:
            return first
        if first is None:
            imported = scope.module.qualified.get(reference.text)
            if imported is None:
                return None
            other = self.file_scope(self.library.modules[imported.module])
            node, where = other.own[imported.name]
            return Resolved(imported.name, node, where)
        found: Resolved | None = first
        for part in reference.parts[1:]:
            if found is None or not isinstance(found.node, ast.Model):
                return None
            inside = self.make(found)
            if inside is None or part.name not in inside.own:
                return None
            node, where = inside.own[part.name]
            found = Resolved(part.name, node, where)
        return found

    def resolve(self, reference: ast.Reference, scope: Scope) -> Resolved | None:
        """The class that a name stands for; None after a report."""
        found = self.find_dotted(reference, scope)
        if found is None:
            self.report.add(
                UNKNOWN_CLASS,
                f"unknown class `{reference.text}`",
                reference.span,
                "not found",
                helps=did_you_mean(reference.text, sorted(self.visible(scope))) or ("define it in this file, or import it",),
            )
        return found

    def visible(self, scope: Scope) -> Iterator[str]:
        here: Scope | None = scope
        while here is not None:
            yield from here.own
            yield from here.imports
            here = here.outer
        yield from BUILT_IN

    # ------------------------------------------------------------------------------------------------------- classes

    def table(self, arguments: tuple[ast.Argument, ...]) -> dict[str, Modification]:
        """The modifications of an argument list, made once."""
        known = self.tables.get(id(arguments))
        if known is None:
            known = self.tables[id(arguments)] = (arguments, modifications(arguments, self.report))
        return known[1]

    def make(self, resolved: Resolved) -> Class | None:
        """The class of a model or element; None where it is none or is broken (reported)."""
        node = resolved.node
        assert isinstance(node, ast.Model)
        assert resolved.scope is not None
        if id(node) in self.classes:
            return self.classes[id(node)]
        if any(node is other for other in self.building):
            return None
        self.building.append(node)
        made = self._build(node, resolved.scope)
        self.building.pop()
        self.classes[id(node)] = made
        self.bodies[id(made.scope)] = made
        return made

    def _build(self, node: ast.Model, outer: Scope) -> Class:
        nested = outer.module.nested.get(id(node), {})
        own: dict[str, tuple[ast.Definition, Scope]] = {}
        scope = Scope(outer.module, outer, own, {local: (t.module, t.name) for local, t in nested.items()}, node.name)
        for item in node.items:
            if isinstance(item, ast.Model | ast.ShortFunction | ast.LongFunction | ast.TypeDefinition | ast.Domain):
                if item.name in own:
                    self._duplicate(item.name, head(item.span), "again here", ((head(own[item.name][0].span), "first here"),))
                own.setdefault(item.name, (item, scope))
        made = Class(node.name, node, scope, {}, (), (), {}, own)
        whole = True
        redeclared: list[ast.Redeclaration] = []
        for item in node.items:
            match item:
                case ast.Extends():
                    whole &= self._inherit(made, item)
                case ast.Redeclaration():
                    redeclared.append(item)
                case ast.Declaration():
                    for declarator in item.declarators:
                        self._declare(made, item, declarator)
                case ast.Experiment():
                    self._add_experiment(made, item)
                case _:
                    pass
        if redeclared:
            self._redeclare(made, tuple(redeclared), whole)
        for section in node.sections:
            lines = tuple((statement, scope) for statement in section.statements)
            if section.initial:
                made.initial += lines
            else:
                made.statements += lines
        return made

    def _add_experiment(self, made: Class, item: ast.Experiment) -> None:
        old = made.experiments.get(item.name)
        if old is not None and old[1] is made.scope:
            self._duplicate(item.name, item.span, "again here", ((old[0].span, "first here"),))
        made.experiments[item.name] = (item, made.scope)

    def _declare(self, made: Class, declaration: ast.Declaration, declarator: ast.Declarator) -> None:
        old = made.members.get(declarator.name)
        if old is not None:
            label = "first declared here" if old.scope is made.scope else f"inherited from `{old.scope.place}`"
            self._duplicate(declarator.name, declarator.span, "again here", ((old.span, label),))
            return
        resolved = self.resolve(declaration.type.name, made.scope)
        if resolved is None:
            resolved = Resolved("", None, None)
        entry = Modification(
            declarator.name,
            declarator.span,
            declarator.value,
            self.table(declarator.arguments),
            final="final" in declaration.prefixes,
        )
        made.members[declarator.name] = Member(
            declarator.name,
            declaration,
            declarator,
            made.scope,
            resolved,
            entry,
            (),
            frozenset(declaration.prefixes),
            "protected" in declaration.prefixes,
        )

    def _redeclare(self, made: Class, items: tuple[ast.Redeclaration, ...], whole: bool) -> None:
        """`redeclare` among the items: it says more than the declaration and the bases, and less than those who use the class.
        What is not declared is reported if the class is `whole`: all its bases are known."""
        for name, entry in self.table(items).items():
            member = made.members.get(name)
            if member is not None:
                member.claims = ((entry, made.scope), *member.claims)
            elif whole:
                self.report.add(
                    UNKNOWN_TARGET,
                    f"`{made.name}` declares and inherits no `{name}` to redeclare",
                    entry.span,
                    "not found",
                    helps=did_you_mean(name, made.members),
                )

    def _inherit(self, made: Class, item: ast.Extends) -> bool:
        """Take over what a base has; False where there is no such base (reported)."""
        resolved = self.find_dotted(item.base, made.scope.outer or made.scope) or self.resolve(item.base, made.scope)
        if resolved is None:
            return False
        if not isinstance(resolved.node, ast.Model):
            what = describe(resolved)
            self.report.add(
                WRONG_KIND, f"`{item.base.text}` is {what}; only models and elements can be extended", item.base.span, f"{what}"
            )
            return False
        if any(resolved.node is other for other in self.building):
            circle = [*self.building[[o is resolved.node for o in self.building].index(True) :], resolved.node]
            self.report.add(
                CYCLIC_EXTENDS,
                f"`{resolved.name}` extends itself: {' -> '.join(node.name for node in circle)}",
                item.span,
                "this closes the circle",
                others=[(head(resolved.node.span), "the class begins here")],
            )
            return False
        base = self.make(resolved)
        if base is None:
            return False
        if resolved.node.kind != made.node.kind:
            self.report.add(
                WRONG_KIND,
                f"{made.node.kind} `{made.name}` cannot extend {resolved.node.kind} `{base.name}`",
                item.span,
                f"a {resolved.node.kind}",
            )
            return False
        self._take_over(made, base, item)
        return True

    def _take_over(self, made: Class, base: Class, item: ast.Extends) -> None:
        table = self.table(item.arguments)
        self._check_targets(table, base, item)
        for name, member in base.members.items():
            changed = table.get(name)
            claims = ((changed, made.scope), *member.claims) if changed is not None else member.claims
            old = made.members.get(name)
            if old is not None:
                same = old.declarator is member.declarator or (
                    old.declaration == member.declaration and old.declarator == member.declarator
                )
                if not (same and _alike(old.claims, claims)):
                    self._duplicate(
                        name, item.span, "inherited again here", ((old.span, f"first from `{old.scope.place}`"), (member.span, "and here"))
                    )
                continue
            made.members[name] = Member(
                name, member.declaration, member.declarator, member.scope, member.type, member.entry, claims, member.prefixes, member.hidden
            )
        seen = {id(statement) for statement, _ in (*made.statements, *made.initial)}
        made.statements += tuple(line for line in base.statements if id(line[0]) not in seen)
        made.initial += tuple(line for line in base.initial if id(line[0]) not in seen)
        for name, experiment in base.experiments.items():
            made.experiments.setdefault(name, experiment)
        for name, definition in base.own.items():
            made.own.setdefault(name, definition)

    def _check_targets(self, table: Mapping[str, Modification], base: Class, item: ast.Extends) -> None:
        for name, change in table.items():
            if name not in base.members:
                self.report.add(
                    UNKNOWN_TARGET,
                    f"`{base.name}` has no `{name}` to modify",
                    change.span,
                    "no such component or parameter",
                    others=[(head(base.node.span), f"`{base.name}` is defined here")],
                    helps=did_you_mean(name, base.members),
                )


def _alike(one: Sequence[tuple[Modification, Scope]], other: Sequence[tuple[Modification, Scope]]) -> bool:
    """Whether two ways to inherit a member modify it alike."""
    return len(one) == len(other) and all(same(a, b) for (a, _), (b, _) in zip(one, other, strict=True))


def describe(resolved: Resolved) -> str:
    """What kind of class this is, in words."""
    match resolved.node:
        case ast.Model(kind=kind):
            return "an element" if kind == "element" else "a model"
        case ast.ShortFunction() | ast.LongFunction():
            return "a function"
        case ast.TypeDefinition():
            return "a type"
        case ast.Domain():
            return "a domain"
        case _ if resolved.name in KINDS:
            return "a bond-graph element"
        case _ if resolved.name in JUNCTIONS:
            return "a junction"
        case _ if resolved.name in DOMAINS:
            return "a domain"
        case _:
            return "a basic type"


def head(span: Span) -> Span:
    """The first line of a definition."""
    end = span.source.text.find("\n", span.start)
    return Span(span.source, span.start, min(span.end, end if end >= 0 else span.end))
