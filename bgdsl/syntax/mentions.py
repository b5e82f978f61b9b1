"""The class names that the text of a model mentions: of components, bases and redeclarations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bgdsl.syntax import ast


def classes_mentioned(model: ast.Model) -> Iterator[ast.Reference]:
    """The references to classes among the items of a model, those of its modifications too; nested classes are left out."""
    for item in model.items:
        match item:
            case ast.Declaration(type=of, declarators=declarators):
                yield of.name
                for declarator in declarators:
                    yield from _redeclared(declarator.arguments)
            case ast.Extends(base=base, arguments=arguments):
                yield base
                yield from _redeclared(arguments)
            case ast.Redeclaration():
                yield from _redeclared((item,))
            case _:
                pass


def _redeclared(arguments: Sequence[ast.Argument]) -> Iterator[ast.Reference]:
    for argument in arguments:
        if isinstance(argument, ast.Redeclaration):
            yield argument.type.name
            yield from _redeclared(argument.arguments)
        else:
            yield from _redeclared(argument.nested)
