"""What the names in a text stand for, and which could be written: where they are declared, and what is said of them there.

The text is one that somebody is typing, so it may be broken anywhere: places are found in its tokens, declarations in what the
parser could read of it, and what cannot be resolved has no meaning instead of an error. Modifications are not followed: a member has
the class of its declaration, not one redeclared for it (but within the brackets of a redeclaration its new class is meant).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from bgdsl.diagnostics import Reporter
from bgdsl.ir.elements import JUNCTIONS, KINDS
from bgdsl.passes.functions import BUILT_INS, CONSTANTS
from bgdsl.passes.modules import SHIPPED, load_modules
from bgdsl.passes.names import BUILT_IN, Class, Member, Names, Resolved, Scope
from bgdsl.source import Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax.lexer import Tokens, lexer, tokenize
from bgdsl.syntax.library import Imported, Library, Module
from bgdsl.syntax.parser import parse

Role = Literal["module", "class", "function", "type", "parameter", "component", "experiment", "bond", "run", "variable", "keyword"]

ATTRIBUTES = ("unit", "min", "max", "start", "fixed", "description")
"""What may be said in brackets of a number."""


@dataclass(frozen=True, slots=True)
class Named:
    """Something with a name. `shown` is its declaration as written, `span` where that stands (None: the language gives it)."""

    name: str
    role: Role
    shown: str
    comment: str | None = None
    span: Span | None = None
    type: Resolved | None = None
    """The class whose members may follow after a dot."""


@dataclass(frozen=True, eq=False)
class Text:
    """A text with all that it imports. The methods take offsets into it."""

    source: Source
    tokens: Tokens
    module: Module
    names: Names

    def at(self, offset: int) -> tuple[Named, Span] | None:
        """What the name at a place stands for, and the place of that name; None where no known name stands."""
        i = self._token(offset)
        if i is None:
            return None
        path = _chain(self.tokens, i)
        argument = self._argument(_start(self.tokens, i), offset) if self.tokens.texts[i + 1] in ("=", "(", "[") else {}
        found = _follow(path, argument, self) or _follow(path, self.visible(offset), self) or self._imported(path)
        start = self.tokens.starts[i]
        return None if found is None else (found, Span(self.source, start, start + len(path[-1])))

    def uses(self, offset: int) -> list[Span]:
        """Every place in this text where the name at a place stands for the same."""
        found = self.at(offset)
        if found is None:
            return []
        wanted, here = found
        same = (start for start, text in zip(self.tokens.starts, self.tokens.texts, strict=True) if text == here.text)
        return [use[1] for start in same if (use := self.at(start)) and (use[0].span, use[0].shown) == (wanted.span, wanted.shown)]

    def completions(self, offset: int) -> list[Named]:
        """What could be written at a place: files and their classes in an import, members after a dot, what can be modified within
        brackets, else all that is visible."""
        i = bisect_right(self.tokens.starts, offset - 1) - 1
        if i >= 0 and self.tokens.texts[i].isidentifier() and offset <= self.tokens.starts[i] + len(self.tokens.texts[i]):
            i -= 1  # the word that is being typed
        if i < 0:
            return list(_KEYWORDS.values())
        if (path := _import_path(self.tokens, i)) is not None:
            return list(self._importable(path))
        if self.tokens.texts[i] == ".":
            owner = _follow(_chain(self.tokens, _before_subscripts(self.tokens, i - 1)), self.visible(offset), self)
            return list(self.inside(owner).values()) if owner else []
        return list({**_KEYWORDS, **self.visible(offset), **self._argument(i + 1, offset)}.values())

    # ----------------------------------------------------------------------------------------------------------- places

    def _token(self, offset: int) -> int | None:
        """The word at a place, or just before it."""
        i = bisect_right(self.tokens.starts, offset) - 1
        for j in (i, i - 1):
            if j >= 0 and self.tokens.texts[j].isidentifier() and offset <= self.tokens.starts[j] + len(self.tokens.texts[j]):
                return j
        return None

    def _argument(self, i: int, offset: int) -> Mapping[str, Named]:
        """The names that may be modified where token i stands, if that is in the brackets after a name: `spring(` i `= ...)`."""
        if i < 1 or self.tokens.texts[i - 1] not in ("(", ",", "each", "final"):
            return {}
        owners: list[list[str]] = []
        while (bracket := _opening(self.tokens, i)) is not None and bracket > 0:
            i = _before_subscripts(self.tokens, bracket - 1)
            if not self.tokens.texts[i].isidentifier():
                return {}
            redeclared = _redeclared(self.tokens, i)
            owners.append(redeclared or _chain(self.tokens, i))
            if redeclared:
                break
            i = _start(self.tokens, i)
        if not owners:
            return {}
        known = self.visible(offset)
        owner = _follow(owners.pop(), known, self)
        while owner is not None and owners:
            owner = _follow(owners.pop(), self.inside(owner), self)
        if owner is None or owner.role in ("function", "run"):
            return {}
        if owner.role == "experiment":
            return {name: found for name, found in known.items() if found.role == "parameter"}
        return self.inside(owner) or {name: Named(name, "variable", name) for name in ATTRIBUTES}

    def _imported(self, path: Sequence[str]) -> Named | None:
        """The class that an import names, or a dotted name used without import."""
        scope = self.names.file_scope(self.module)
        reference = _reference(path)
        found = self.names.find_dotted(reference, scope)
        if found is None:
            local = next((local for local, target in self.module.imports.items() if target.name == path[-1]), None)
            found = self.names.find(local, scope) if local else None
        return _class(found) if found else None

    # ---------------------------------------------------------------------------------------------------------- meaning

    def visible(self, offset: int) -> dict[str, Named]:
        """Every name that can be used at a place, the innermost meaning of each."""
        scope, around = self.names.file_scope(self.module), list[Class]()
        item = _last(self.module.tree.items, offset)
        while isinstance(item, ast.Model):
            made = self.names.make(Resolved(item.name, item, scope))
            if made is None:
                break
            around.append(made)
            scope = made.scope
            item = next((inner for inner in item.items if inner.span.start <= offset < inner.span.end), None)
        found = {name: Named(name, "function", name) for name in BUILT_INS} | {name: Named(name, "variable", name) for name in CONSTANTS}
        found |= {name: _class(Resolved(name, None, None)) for name in BUILT_IN}
        found |= {name: kept for name, kept in self._classes(scope) if kept is not None}
        for made in around:
            found |= {bond.name: bond for bond in _bonds(made)}
            found |= {name: _experiment(experiment) for name, (experiment, _) in made.experiments.items()}
            found |= {name: _member(member) for name, member in made.members.items()}
        test = _last(self.module.tree.items, offset)
        if isinstance(test, ast.Test):
            found |= {run.name: run for run in self._runs(test)}
        return found

    def inside(self, owner: Named) -> dict[str, Named]:
        """What may follow after a dot."""
        of = owner.type
        if of is None:
            return {}
        if isinstance(of.node, ast.Model):
            made = self.names.make(of)
            if made is None:
                return {}
            classes = {name: _class(Resolved(name, node, scope)) for name, (node, scope) in made.own.items()}
            members = {name: _member(member) for name, member in made.members.items() if not member.hidden}
            return {**classes, **members, **({"time": _variable("time", owner)} if owner.role == "run" else {})}
        if of.name in KINDS:
            kind = KINDS[of.name]
            names = (*kind.parameters, *kind.own, *(("power", "energy") if kind.state else ("power",) if kind.ports == 1 else ()))
        else:
            names = ("e", "f") if of.name in JUNCTIONS else ()
        return {name: _variable(name, owner) for name in names}

    def _classes(self, scope: Scope) -> Iterator[tuple[str, Named | None]]:
        """The classes that can be named in a scope, the outermost first."""
        if scope.outer is not None:
            yield from self._classes(scope.outer)
        for name in (*scope.imports, *scope.own):
            found = self.names.find(name, scope)
            yield name, None if found is None else _class(found)

    def _importable(self, path: Sequence[str]) -> Iterator[Named]:
        """What may follow in an import: folders and files beside this one and in the library, the classes of a file."""
        beside = self.source.path.resolve().parent if self.source.path else Path.cwd()
        for folder in (beside, SHIPPED):
            place = folder.joinpath(*path)
            for child in sorted(place.iterdir()) if place.is_dir() else ():
                if child.suffix == ".bg" or (child.is_dir() and any(child.glob("*.bg"))):
                    yield Named(child.stem, "module", child.name)
            file = place.with_suffix(".bg")
            if path and file.is_file():
                text = file.read_text("utf-8", errors="replace")
                tree = parse(Source(file.name, text, file), Reporter())
                items = (item for item in tree.items if not isinstance(item, ast.Import | ast.Test))
                yield from (_class(Resolved(item.name, item, None)) for item in items)

    def _runs(self, test: ast.Test) -> Iterator[Named]:
        scope = self.names.file_scope(self.module)
        for statement in test.statements:
            if isinstance(statement, ast.RunStatement):
                of = None if statement.file else self.names.find_dotted(statement.model, scope)
                yield Named(statement.name, "run", statement.span.text, None, statement.span, of)


def read(source: Source) -> Text:
    """A text with all that it imports, as far as that can be read."""
    library = _whole(load_modules(source, (), parse, Reporter()))
    return Text(source, tokenize(source.text), library.main, Names(library, Reporter()))


def _whole(library: Library) -> Library:
    """The library without the imports that lead nowhere."""

    def leads(target: Imported) -> bool:
        return target.module in library.modules and target.name in library.modules[target.module].definitions

    def kept(imports: Mapping[str, Imported]) -> dict[str, Imported]:
        return {name: target for name, target in imports.items() if leads(target)}

    modules = {
        key: replace(
            module,
            imports=kept(module.imports),
            nested={which: kept(imports) for which, imports in module.nested.items()},
            qualified=kept(module.qualified),
        )
        for key, module in library.modules.items()
    }
    return Library(modules[library.main.key], modules)


# --------------------------------------------------------------------------------------------------------------- tokens


def _before_subscripts(tokens: Tokens, i: int) -> int:
    """The token before the subscripts that end at token i; i itself where there are none."""
    if tokens.texts[i] != "]":
        return i
    opening = _opening(tokens, i)
    return i if opening is None or opening == 0 else opening - 1


def _opening(tokens: Tokens, i: int) -> int | None:
    """The bracket that is open before token i."""
    depth = 1
    while i > 0:
        i -= 1
        text = tokens.texts[i]
        depth += (text in _CLOSING) - (text in _OPENING)
        if depth == 0:
            return i
        if text == ";":
            return None
    return None


def _redeclared(tokens: Tokens, i: int) -> list[str] | None:
    """The class that the component named by token i is redeclared with; None where it is not."""
    end = _before_subscripts(tokens, i - 1)
    if i < 2 or not tokens.texts[end].isidentifier():
        return None
    before = _start(tokens, end) - 1
    while before > 0 and tokens.texts[before] in ("final", "each", "replaceable"):
        before -= 1
    return _chain(tokens, end) if tokens.texts[before] == "redeclare" else None


_OPENING, _CLOSING = frozenset("([{"), frozenset(")]}")


def _chain(tokens: Tokens, i: int) -> list[str]:
    """The dotted name that ends with token i, without subscripts."""
    names = [tokens.texts[i]]
    while i >= 2 and tokens.texts[i - 1] == ".":
        i = _before_subscripts(tokens, i - 2)
        names.append(tokens.texts[i])
    return names[::-1]


def _start(tokens: Tokens, i: int) -> int:
    """The first token of the dotted name that ends with token i."""
    while i >= 2 and tokens.texts[i - 1] == ".":
        i = _before_subscripts(tokens, i - 2)
    return i


def _import_path(tokens: Tokens, i: int) -> list[str] | None:
    """The dotted path before a place in an import, token i being the last before it; None elsewhere."""
    names: list[str] = []
    while i > 0 and tokens.texts[i] == ".":
        names.append(tokens.texts[i - 1])
        i -= 2
    if i > 1 and tokens.texts[i] == "=":  # `import Name = path`
        i -= 2
    return names[::-1] if i >= 0 and tokens.texts[i] == "import" else None


def _last(items: Iterable[ast.Node], offset: int) -> ast.Node | None:
    """The last item that begins before a place: it may have lost its end."""
    return next((item for item in reversed(tuple(items)) if item.span.start <= offset), None)


# --------------------------------------------------------------------------------------------------------------- names


def _follow(path: Sequence[str], known: Mapping[str, Named], text: Text) -> Named | None:
    """What a dotted name stands for, from the names known at its beginning."""
    found = known.get(path[0])
    for name in path[1:]:
        found = text.inside(found).get(name) if found else None
    return found


def _reference(path: Sequence[str]) -> ast.Reference:
    nowhere = Span(Source("", ""), 0, 0)
    return ast.Reference(tuple(ast.Part(name, span=nowhere) for name in path), span=nowhere)


def _member(member: Member) -> Named:
    declaration, declarator = member.declaration, member.declarator
    prefixes = "".join(f"{prefix} " for prefix in declaration.prefixes)
    role: Role = "parameter" if {"parameter", "constant"} & member.prefixes else "component"
    shown = f"{prefixes}{declaration.type.span.text} {declarator.span.text}"
    return Named(member.name, role, shown, declarator.comment, declarator.span, member.type)


def _class(of: Resolved) -> Named:
    match of.node:
        case None:
            return Named(of.name, "class", _SENTENCES.get(of.name, of.name), None, None, of)
        case ast.Model(kind=kind, comment=comment):
            return Named(of.name, "class", f"{kind} {of.name}", comment, of.node.span, of)
        case ast.ShortFunction(comment=comment):
            return Named(of.name, "function", of.node.span.text, comment, of.node.span)
        case ast.LongFunction(declarations=declarations, comment=comment):
            inputs = " ".join(item.span.text for item in declarations if "protected" not in item.prefixes)
            return Named(of.name, "function", f"function {of.name} {inputs}", comment, of.node.span)
        case ast.TypeDefinition(comment=comment) | ast.Domain(comment=comment):
            return Named(of.name, "type", of.node.span.text, comment, of.node.span)
        case _:
            return Named(of.name, "class", of.name, None, of.node.span)


def _experiment(item: ast.Experiment) -> Named:
    return Named(item.name, "experiment", item.span.text, item.comment, item.span)


def _variable(name: str, owner: Named) -> Named:
    """A variable of a primitive element: it is declared with it."""
    return Named(name, "variable", f"{owner.shown}\n// its {_VARIABLES.get(name, name)}", owner.comment, owner.span)


def _bonds(of: Class) -> Iterator[Named]:
    """The bonds that have names."""
    stack: list[ast.Statement] = [statement for statement, _ in reversed(of.statements)]
    while stack:
        match stack.pop():
            case ast.BondChain(name=str(name), span=span, comment=comment):
                yield Named(name, "bond", span.text, comment, span)
            case ast.For(body=body):
                stack += reversed(body)
            case ast.IfStatement(branches=branches, otherwise=otherwise):
                stack += [inner for _, body in branches for inner in body] + list(otherwise)
            case _:
                pass


_VARIABLES = {"e": "effort", "f": "flow", "p": "momentum", "q": "displacement", "power": "power", "energy": "stored energy"}

_SENTENCES = {
    "Se": "Se  // source of effort",
    "Sf": "Sf  // source of flow",
    "MSe": "MSe  // source of effort, modulated",
    "MSf": "MSf  // source of flow, modulated",
    "I": "I  // inertia: f = p/I",
    "C": "C  // spring, capacitor: e = k*q = q/C",
    "R": "R  // damper, resistor: e = R*f",
    "TF": "TF  // transformer: f2 = m*f1, e1 = m*e2",
    "MTF": "MTF  // transformer, modulated: f2 = m*f1, e1 = m*e2",
    "GY": "GY  // gyrator: e2 = r*f1, e1 = r*f2",
    "MGY": "MGY  // gyrator, modulated: e2 = r*f1, e1 = r*f2",
    "J0": "J0  // 0-junction: one effort, flows add up to zero",
    "J1": "J1  // 1-junction: one flow, efforts add up to zero",
}
"""The primitive kinds in a sentence each."""

_KEYWORDS = {word: Named(word, "keyword", word) for word in sorted(lexer().words)}
