"""Which model is meant, and whether a model is made to be used by others.

Input        Library, the name of a model, or None
Output       the model's tree
Reports      BG609 which model
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bgdsl.diagnostics import Code, Reporter, did_you_mean, listed
from bgdsl.passes.names import Member, Names, Resolved, head
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library
from bgdsl.syntax.mentions import classes_mentioned

WHICH_MODEL = Code("BG609", "it is not clear which model is meant")


def choose_model(library: Library, name: str | None, report: Reporter) -> ast.Model:
    """The model of that name, or the only one, or the one that no other model of the file uses."""
    models = list(library.models())
    source = library.main.source
    if name is not None:
        for model in models:
            if model.name == name:
                return model
        known = [model.name for model in models]
        where = library.main.tree.items[0].span if library.main.tree.items else Span(source, 0, 0)
        report.fail(
            WHICH_MODEL,
            f"`{source.name}` has no model `{name}`",
            Span(source, where.start, where.start),
            "",
            helps=did_you_mean(name, known),
            notes=_models(known),
        )
    if len(models) == 1:
        return models[0]
    used = {part for item in library.main.tree.items if isinstance(item, ast.Model) for part in _classes_used(item)}
    free = [model for model in models if model.name not in used]
    if len(free) == 1:
        return free[0]
    if not models:
        report.fail(WHICH_MODEL, f"`{source.name}` has no model", Span(source, 0, 0), "", helps=("a model begins with `model Name`",))
    chosen = free or models
    report.fail(
        WHICH_MODEL,
        f"`{source.name}` has {len(chosen)} models that no other uses" if free else f"every model of `{source.name}` is used by another",
        head(chosen[0].span),
        "one of them",
        others=[(head(other.span), "another") for other in chosen[1:6]],
        notes=_models([model.name for model in chosen]),
        helps=("say which one with `--model`",),
    )


def _models(names: Sequence[str]) -> tuple[str, ...]:
    return (f"the models are {listed(names, 12)}",) if names else ()


def _classes_used(model: ast.Model) -> Iterator[str]:
    """The names of classes that the text of a model and of those nested in it mentions."""
    stack = [model]
    while stack:
        inner = stack.pop()
        yield from (reference.parts[0].name for reference in classes_mentioned(inner))
        stack += (item for item in inner.items if isinstance(item, ast.Model))


def is_part(library: Library, name: str) -> bool:
    """Whether a model is made to be used by others: it has ports, or parameters without a value; or it has no experiment and is a
    part of others of its file, for whom it is to say what its inputs, open junctions and sources get."""
    names = Names(library, Reporter())
    node = next((model for model in library.models() if model.name == name), None)
    cls = names.make(Resolved(name, node, names.file_scope(library.main))) if node is not None else None
    if node is None or cls is None:
        return False
    runs = any(isinstance(item, ast.Experiment) for item in node.items)
    return any(_is_open(member) for member in cls.members.values()) or (not runs and _is_component(library, name))


def _is_component(library: Library, name: str) -> bool:
    """Whether a model of the main file has parts of this class."""
    models = [item for item in library.main.tree.items if isinstance(item, ast.Model)]
    bases = (item.base for model in models for item in model.items if isinstance(item, ast.Extends))
    mentioned = [used for model in models for used in _classes_used(model)]
    return mentioned.count(name) > sum(base.parts[0].name == name for base in bases)


def _is_open(member: Member) -> bool:
    if member.prefixes & {"port in", "port out"}:
        return True
    given = member.entry.value is not None or any(entry.value is not None for entry, _ in member.claims)
    return bool(member.prefixes & {"parameter"}) and not given
