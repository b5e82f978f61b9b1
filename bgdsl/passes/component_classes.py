"""Which class a component has: its declaration's, or that of the outermost redeclaration.

Input        the claims about a component, or about one element of an array of components
Output       `ComponentClass`
Establishes  a redeclared component has the kind, the ports and the open junctions of what it replaces
Reports      BG224 redeclaration does not fit
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bgdsl.diagnostics import Code
from bgdsl.ir.domains import DOMAINS
from bgdsl.ir.elements import KINDS
from bgdsl.passes.names import Member, Resolved, describe
from bgdsl.passes.parts import Build, Claim, Context, Fault, Instance, Reported
from bgdsl.source import Span
from bgdsl.syntax import ast

REDECLARED = Code("BG224", "a redeclaration does not fit")


@dataclass(frozen=True, slots=True)
class ComponentClass:
    """The class that a component has: the declaration's, or that of the outermost redeclaration; who wrote it, and what it says."""

    type: Resolved
    node: ast.TypeName
    author: Context
    comment: str

    def others(self, member: Member, path: str) -> tuple[tuple[Span, str], ...]:
        """What to show beside a finding about a component: where it is redeclared, if it is."""
        return () if self.node is member.declaration.type else ((self.node.span, f"`{path}` is redeclared here"),)

    @property
    def is_domain(self) -> bool:
        return self.type.name in DOMAINS if self.type.node is None else isinstance(self.type.node, ast.Domain)


def redeclaration(claims: Sequence[Claim]) -> ast.Redeclaration | None:
    """The outermost redeclaration, which decides the class."""
    return next((entry.redeclared for entry, _, _ in claims if entry.redeclared is not None), None)


def class_of(instance: Instance, member: Member, claims: Sequence[Claim]) -> ComponentClass:
    for entry, author, _ in claims:
        if entry.redeclared is not None:
            node = entry.redeclared
            comment = node.comment or member.declarator.comment or ""
            return ComponentClass(_redeclared(instance.build, member, node, author), node.type, author, comment)
    return ComponentClass(member.type, member.declaration.type, claims[-1][1], member.declarator.comment or "")


def _redeclared(build: Build, member: Member, node: ast.Redeclaration, author: Context) -> Resolved:
    if id(node) not in build.redeclared:
        build.redeclared[id(node)] = (node, build.names.resolve(node.type.name, author.scope))
        new = build.redeclared[id(node)][1]
        if new is not None and not _check_redeclared(build, member, new, node):
            build.redeclared[id(node)] = (node, None)
    new = build.redeclared[id(node)][1]
    if new is None:
        raise Reported
    return new


def _check_redeclared(build: Build, member: Member, new: Resolved, node: ast.Redeclaration) -> bool:
    """Whether the new class is of the old one's kind, with its ports and open junctions."""

    def misfit(message: str, *others: tuple[Span, str]) -> Fault:
        return Fault(REDECLARED, message, node.type.span, "the new class", others=((member.span, "declared here"), *others))

    old = member.type
    if old.name in KINDS and new.name in KINDS and KINDS[old.name].ports != KINDS[new.name].ports:
        counts = {1: "one port", 2: "two ports"}
        build.fault(misfit(f"`{new.name}` has {counts[KINDS[new.name].ports]}, `{old.name}` has {counts[KINDS[old.name].ports]}"))
        return False
    if isinstance(old.node, ast.Model) != isinstance(new.node, ast.Model) or describe(old) != describe(new):
        build.fault(misfit(f"`{member.name}` is {describe(old)}, `{new.name}` is {describe(new)}"))
        return False
    before = build.names.make(old) if isinstance(old.node, ast.Model) else None
    after = build.names.make(new) if isinstance(new.node, ast.Model) else None
    if before is None or after is None:
        return True
    fits = True
    for name, part in before.members.items():
        role = part.prefixes & {"port in", "port out", "open"}
        there = after.members.get(name)
        if role and (there is None or not role <= there.prefixes):
            what = f"`{next(iter(role))}` `{name}`"
            build.fault(misfit(f"`{after.name}` lacks {what} of `{before.name}`", (part.span, "the old class has it")))
            fits = False
    return fits
