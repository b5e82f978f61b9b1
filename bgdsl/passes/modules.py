"""Find and read every file that a model reaches through its imports.

Input        Source    the main file, and the folders where imports are looked for after the importing file's own
Output       Library   every file read, once each; what each import points to
Establishes  every import of a listed module names a module of the library and a class defined in it; imports make no cycle
Reports      BG201 file not found or not readable, BG202 import cycle, BG203 no such class in the file
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from bgdsl.diagnostics import Code, Reporter, did_you_mean, listed
from bgdsl.source import Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax.library import Imported, Library, Module
from bgdsl.syntax.mentions import classes_mentioned

NOT_FOUND = Code("BG201", "an imported file cannot be read")
CYCLE = Code("BG202", "files import each other in a circle")
NO_SUCH_CLASS = Code("BG203", "an imported class does not exist")

Parse = Callable[[Source, Reporter], ast.File]

SHIPPED = Path(__file__).parent.parent / "library"
"""The library that comes with the package, searched last."""


def load_modules(source: Source, search: tuple[Path, ...], parse: Parse, report: Reporter) -> Library:
    """The library of `source` and everything it imports, looked for beside the importing file, in `search`, then in the shipped library."""
    loader = _Loader(search, parse, report)
    loader.load_all(source)
    loader.check_names()
    return Library(loader.modules[_key(source)], loader.modules)


def _key(source: Source) -> str:
    return str(source.path.resolve()) if source.path is not None else source.name


@dataclass
class _Loader:
    search: tuple[Path, ...]
    parse: Parse
    report: Reporter
    modules: dict[str, Module] = field(default_factory=dict)
    pending: dict[str, list[tuple[str, Span]]] = field(default_factory=dict)
    found: dict[tuple[Path, tuple[str, ...]], Path | None] = field(default_factory=dict)

    def load_all(self, source: Source) -> None:
        """Depth first with an explicit stack: a file on the stack that is imported again closes a circle."""
        self.modules[_key(source)] = self.load(source)
        stack = [(_key(source), iter(self.pending[_key(source)]))]
        via: dict[str, Span] = {}
        while stack:
            _, targets = stack[-1]
            target = next(targets, None)
            if target is None:
                stack.pop()
                continue
            key, span = target
            open_keys = [entry[0] for entry in stack]
            if key in open_keys:
                self.report_cycle(open_keys[open_keys.index(key) :], span, via)
            elif key not in self.modules and (text := self.read(Path(key), span)) is not None:
                self.modules[key] = self.load(text)
                via[key] = span
                stack.append((key, iter(self.pending[key])))

    def report_cycle(self, circle: list[str], span: Span, via: dict[str, Span]) -> None:
        names = " -> ".join(Path(key).name for key in [*circle, circle[0]])
        others = [(via[key], f"which imports `{Path(key).name}` here") for key in circle[1:]]
        self.report.add(
            CYCLE,
            f"files import each other in a circle: {names}",
            span,
            "this import closes the circle" if others else "a file does not import itself",
            others=others,
            helps=("move what both need into a third file, or name the class without import inside its own file",),
        )

    def read(self, path: Path, span: Span) -> Source | None:
        try:
            return Source(_shown(path), path.read_bytes().decode("utf-8"), path)
        except (OSError, UnicodeDecodeError) as problem:
            self.report.add(NOT_FOUND, f"`{_shown(path)}` cannot be read: {problem}", span, "imported here")
            return None

    def load(self, source: Source) -> Module:
        tree = self.parse(source, self.report)
        key = _key(source)
        targets = self.pending.setdefault(key, [])
        imports = self.resolve(source, [item for item in tree.items if isinstance(item, ast.Import)], targets)
        nested: dict[int, dict[str, Imported]] = {}
        names: dict[str, ast.Reference] = {}
        for model in _models(tree):
            inside = [item for item in model.items if isinstance(item, ast.Import)]
            if inside:
                nested[id(model)] = self.resolve(source, inside, targets)
            for name in (name for name in classes_mentioned(model) if len(name.parts) > 1):
                names.setdefault(name.text, name)
        qualified: dict[str, Imported] = {}
        for text, name in names.items():
            *path, last = (part.name for part in name.parts)
            place = self.find(source, tuple(path))
            if place is not None:
                qualified[text] = Imported(str(place), last, name.span)
                targets.append((str(place), name.span))
        return Module(key, source, tree, imports, nested, qualified)

    def resolve(self, source: Source, imports: list[ast.Import], targets: list[tuple[str, Span]]) -> dict[str, Imported]:
        found: dict[str, Imported] = {}
        for item in imports:
            place = self.find(source, item.path)
            if place is None:
                self.report_missing(source, item)
                continue
            targets.append((str(place), item.span))
            for name, local in item.names:
                if local in found:
                    self.report.add(
                        NO_SUCH_CLASS,
                        f"`{local}` is imported twice",
                        item.span,
                        "again here",
                        others=[(found[local].span, "first imported here")],
                        helps=(f"give one of them another name: `import Other = ...{name};`",),
                    )
                found.setdefault(local, Imported(str(place), name, item.span))
        return found

    def find(self, source: Source, path: tuple[str, ...]) -> Path | None:
        """The file of a dotted module path, or None."""
        if not path:
            return None
        beside = (source.path.resolve().parent if source.path is not None else Path.cwd(),)
        key = (beside[0], path)
        if key not in self.found:
            relative = Path(*path).with_suffix(".bg")
            places = (folder / relative for folder in (*beside, *self.search, SHIPPED))
            self.found[key] = next((place.resolve() for place in places if place.is_file()), None)
        return self.found[key]

    def report_missing(self, source: Source, item: ast.Import) -> None:
        if not item.path:
            names = ", ".join(name for name, _ in item.names)
            self.report.add(
                NOT_FOUND, f"this import names no file, only `{names}`", item.span, "", helps=(f"write `import file.{names};`",)
            )
            return
        wanted = "/".join(item.path) + ".bg"
        folders = [source.path.parent if source.path is not None else Path(), *self.search]
        helps = []
        for name, _ in item.names:
            if self.find(source, (*item.path, name)) is not None:
                dotted = ".".join((*item.path, name))
                helps.append(f"`{dotted}` is a file; name one of its classes: `import {dotted}.Name;`")
        known = [place.stem for folder in (*folders, SHIPPED) for place in (folder / Path(*item.path[:-1])).glob("*.bg")]
        helps += did_you_mean(item.path[-1], known)
        self.report.add(
            NOT_FOUND,
            f"`{wanted}` is not found",
            item.span,
            "imported here",
            notes=(f"looked in {listed(map(_shown, folders))} and in the library shipped with bgdsl",),
            helps=helps or ("give the folder that holds it with `--path`",),
        )

    def check_names(self) -> None:
        """Every imported class has to be there."""
        for module in self.modules.values():
            tables = [module.imports, *module.nested.values(), module.qualified]
            for imported in (imported for table in tables for imported in table.values()):
                target = self.modules.get(imported.module)
                if target is None or imported.name in target.definitions:
                    continue
                if target.tree.items or not self.report.errors:
                    self.report_no_class(imported, target)

    def report_no_class(self, imported: Imported, target: Module) -> None:
        first = target.tree.items[0].span if target.tree.items else Span(target.source, 0, 0)
        known = list(target.definitions)
        self.report.add(
            NO_SUCH_CLASS,
            f"`{target.source.name}` has no class `{imported.name}`",
            imported.span,
            "imported here",
            others=[(Span(first.source, first.start, first.start), "this is the file")],
            notes=(f"it defines {listed(known, 12)}",) if known else ("it defines no class",),
            helps=did_you_mean(imported.name, known),
        )


def _shown(path: Path) -> str:
    """A path as messages show it: relative to the working folder if it lies in there."""
    try:
        return str(path.resolve().relative_to(Path.cwd())) or "."
    except ValueError:
        return str(path)


def _models(tree: ast.File) -> Iterator[ast.Model]:
    """Every model and element of a file, nested ones included."""
    stack: list[object] = list(reversed(tree.items))
    while stack:
        item = stack.pop()
        if isinstance(item, ast.Model):
            yield item
            stack.extend(reversed(item.items))
