"""Make the parts of instances: apply modifications, decide sizes and conditions, name everything by its flat path.

Input        Class, the modifications from outside
Output       Instance with its parts
Establishes  every part has its shape; every modification's target exists
Reports      BG212 wrong kind, BG214 recursive model, BG220 unknown target, BG225 size of a declaration; and what `claims` and
             `component_classes` report

A modification is looked up when its target is made: a part's `claims` are all that is said about it, the outermost first,
the declaration itself last. Nothing is copied, so an instance costs what its own parts cost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bgdsl.diagnostics import Code
from bgdsl.expr import param, var
from bgdsl.ir.elements import JUNCTIONS, KINDS, Kind
from bgdsl.ir.graph import Instance as FlatInstance
from bgdsl.ir.graph import Origin
from bgdsl.passes.claims import check_targets, claims_of, element_claims, refuse_subscripts
from bgdsl.passes.component_classes import REDECLARED, ComponentClass, class_of, redeclaration
from bgdsl.passes.elaborate import evaluate_integer, evaluate_now
from bgdsl.passes.modifications import Modification
from bgdsl.passes.names import BASIC, UNKNOWN_TARGET, WRONG_KIND, Class, Member, Resolved, describe, head
from bgdsl.passes.parts import (
    Absent,
    ArrayPart,
    Broken,
    Build,
    Claim,
    Context,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    ParameterPart,
    PortPart,
    Reported,
    SignalPart,
    Unfinished,
)
from bgdsl.passes.shapes import LARGEST_ARRAY, leaves_of
from bgdsl.syntax import ast

RECURSIVE = Code("BG214", "a model contains itself")
SIZE = Code("BG225", "a declaration has a wrong size")

ATTRIBUTES = frozenset({"unit", "displayUnit", "quantity", "min", "max", "start", "fixed", "nominal", "stateSelect"})
"""What can be said about a Real beside its value."""


def make_part(instance: Instance, member: Member) -> Any:
    """The part that `member` is in this instance; Broken after a report."""
    name = member.name
    instance.parts[name] = Unfinished(instance.child(name), member.span)
    try:
        part = _make(instance, member)
    except Fault as fault:
        instance.build.fault(fault, instance.path)
        part = Broken(name)
    except Reported:
        part = Broken(name)
    instance.parts[name] = part
    return part


# ---------------------------------------------------------------------------------------------------------------- parts


def _make(instance: Instance, member: Member) -> Any:
    claims = claims_of(instance, member)
    author = claims[-1][1]
    condition = member.declarator.condition
    if condition is not None and not evaluate_now(condition, author):
        return Absent(instance.child(member.name), member.span)
    if not member.type.name:
        raise Reported
    chosen = class_of(instance, member, claims)
    basic = _basic(chosen.type)
    if instance.cls.is_element and not (basic or chosen.is_domain):
        raise Fault(
            WRONG_KIND,
            f"an element has ports, parameters and variables; `{member.name}` is {describe(chosen.type)}",
            member.declaration.span,
            "not in an element",
            helps=(f"make `{instance.cls.name}` a `model`",),
        )
    if basic:
        return _value_part(instance, member, chosen.type, claims)
    return _components(instance, member, claims, chosen)


def _components(instance: Instance, member: Member, claims: tuple[Claim, ...], chosen: ComponentClass) -> Any:
    """One component, or an array of them where the declaration has dimensions; its elements may be redeclared one by one."""
    path = instance.child(member.name)
    make = _maker(instance, member, chosen)
    if not member.declarator.dims:
        refuse_subscripts(claims)
        return make(path, claims)
    shape = tuple(_extent(dim, claims[-1][1], member) for dim in member.declarator.dims)
    own = any(part.redeclared is not None for entry, _, _ in claims for _, part in entry.parts)
    makers: dict[int, _Maker] = {}
    items = []
    for spot, said in element_claims(claims, shape):
        if own:
            key = id(redeclaration(said))
            if key not in makers:
                makers[key] = _maker(instance, member, class_of(instance, member, said))
            make = makers[key]
        items.append(make(f"{path}[{','.join(str(i + 1) for i in spot)}]", said))
    return ArrayPart(path, shape, tuple(items))


_Maker = Callable[[str, tuple[Claim, ...]], Any]
"""What makes a component with a path from what is said about it."""


def _maker(instance: Instance, member: Member, chosen: ComponentClass) -> _Maker:
    """What makes components of a class."""
    resolved = chosen.type
    match resolved.node:
        case ast.Model():
            return lambda path, claims: _instance(instance, member, chosen, path, claims)
        case None if resolved.name in KINDS:
            _allow(member, {"final", "replaceable", "protected"}, "an element")
            kind = KINDS[resolved.name]
            sizes = _port_sizes(kind, chosen, member)
            origin = Origin(instance.path, member.span)
            return lambda path, claims: ElementPart(path, kind, sizes, member, claims, origin, chosen.node.span, chosen.comment)
        case None if resolved.name in JUNCTIONS:
            _allow(member, {"open", "final", "replaceable", "protected"}, "a junction")
            size = _one_size(chosen, member)
            return lambda path, claims: _junction(instance, member, chosen, size, path, claims)
        case _ if chosen.is_domain:
            size = _one_size(chosen, member)
            return lambda path, claims: _port(instance, member, resolved.name, size, path)
        case _:
            what = describe(resolved)
            raise Fault(WRONG_KIND, f"`{resolved.name}` is {what}; nothing can be declared with it", chosen.node.span, what)


def _allow(member: Member, prefixes: set[str], what: str) -> None:
    wrong = member.prefixes - prefixes
    if wrong:
        raise Fault(WRONG_KIND, f"{what} cannot be `{min(wrong)}`", member.declaration.span, f"`{member.name}` is {what}")


def _extent(dim: ast.Expression, author: Context, member: Member) -> int:
    if isinstance(dim, ast.Colon):
        raise Fault(SIZE, f"the size of `{member.name}` is not given", dim.span, "an array of components has a size")
    size = evaluate_integer(dim, author)
    if size < 0:
        raise Fault(SIZE, f"`{member.name}` cannot have {size} elements", dim.span, "negative")
    if size > LARGEST_ARRAY:
        raise Fault(SIZE, f"`{member.name}` cannot have {size} elements", dim.span, f"more than {LARGEST_ARRAY}")
    return size


def _instance(outer: Instance, member: Member, chosen: ComponentClass, path: str, claims: tuple[Claim, ...]) -> Instance:
    build = outer.build
    _allow(member, {"final", "replaceable", "protected"}, "an instance of a model")
    cls = build.names.make(chosen.type)
    if cls is None:
        raise Reported
    chain: Instance | None = outer
    while chain is not None:
        if chain.cls is cls:
            raise Fault(
                RECURSIVE,
                f"model `{cls.name}` contains itself",
                member.span,
                "an instance of it, inside it",
                others=[(head(cls.node.span), "the model")],
            )
        chain = chain.outer
    if chosen.node.dims:
        what = describe(chosen.type)
        raise Fault(SIZE, f"`{cls.name}` is {what}, it has no dimensions", chosen.node.span, "put the size after the name")
    others = chosen.others(member, path)
    check_targets(build, claims, cls.members, lambda: f"`{cls.name}`", head(cls.node.span), others)
    _check_protected(build, claims, cls)
    layers = tuple((entry.nested, author, index) for entry, author, index in claims if entry.nested)
    return Instance(path, cls, layers, build, Origin(outer.path, member.span), chosen.comment, outer)


def _check_protected(build: Build, claims: Sequence[Claim], cls: Class) -> None:
    for entry, _, _ in claims:
        for name, change in entry.nested.items():
            member = cls.members.get(name)
            if member is not None and member.hidden:
                build.fault(
                    Fault(
                        UNKNOWN_TARGET,
                        f"`{name}` of `{cls.name}` is protected",
                        change.span,
                        "modified here",
                        others=[(member.span, "declared here")],
                    )
                )


NOTHING: frozenset[str] = frozenset()


def _junction(
    instance: Instance, member: Member, chosen: ComponentClass, size: int | None, path: str, claims: tuple[Claim, ...]
) -> JunctionPart:
    check_targets(instance.build, claims, NOTHING, lambda: "a junction", member.span)
    kind, origin = JUNCTIONS[chosen.type.name], Origin(instance.path, member.span)
    return JunctionPart(path, kind, size, "open" in member.prefixes, origin, chosen.comment)


def _port(instance: Instance, member: Member, domain: str, size: int | None, path: str) -> PortPart:
    role = member.prefixes & {"port in", "port out"}
    if not role:
        raise Fault(
            WRONG_KIND,
            f"`{domain}` is a domain: only ports can be declared with it",
            member.declaration.type.span,
            "a domain",
            helps=(f"write `port in {domain} {member.name};` or `port out ...`",),
        )
    return PortPart(path, "port out" in role, domain, size, instance, member, Origin(instance.path, member.span))


def _port_sizes(kind: Kind, chosen: ComponentClass, member: Member) -> tuple[int | None, ...]:
    """The sizes of an element's ports; a two-port is declared [n2, n1], or [n] where both are n."""
    if kind.ports == 1:
        return (_one_size(chosen, member),)
    sizes = [_size_of(dim, chosen.author, member) for dim in chosen.node.dims]
    if len(sizes) > 2:
        raise Fault(SIZE, f"a {kind.name} has two dimensions, not {len(sizes)}", chosen.node.span, "rows (port 2), columns (port 1)")
    return (None, None) if not sizes else (sizes[-1], sizes[0])


def _one_size(chosen: ComponentClass, member: Member) -> int | None:
    dims = chosen.node.dims
    if len(dims) > 1:
        raise Fault(SIZE, f"`{member.name}` has one dimension, not {len(dims)}", chosen.node.span, "one size is wanted")
    return _size_of(dims[0], chosen.author, member) if dims else None


def _size_of(dim: ast.Expression, author: Context, member: Member) -> int:
    size = _extent(dim, author, member)
    if size == 0:
        raise Fault(SIZE, f"`{member.name}` cannot have no components", dim.span, "at least 1")
    return size


# --------------------------------------------------------------------------------------------------------------- values


def _value_part(instance: Instance, member: Member, resolved: Resolved, claims: tuple[Claim, ...]) -> ParameterPart | SignalPart:
    author = claims[-1][1]
    for entry, _, _ in claims:
        for _, piece in entry.parts:
            if piece.redeclared is not None:
                raise Fault(REDECLARED, f"the entries of `{member.name}` are all of one type", piece.span, "only one of them is redeclared")
    basic, more, type_dims = _basic_type(instance.build, resolved)
    claims = (*claims, *more)
    check_targets(instance.build, claims, ATTRIBUTES, lambda: f"a {basic}", member.span)
    dims = (*member.declarator.dims, *member.declaration.type.dims)
    shape: tuple[int, ...] | None = None
    if not any(isinstance(dim, ast.Colon) for dim in dims):
        shape = (*(_extent(dim, author, member) for dim in dims), *type_dims)
    path = instance.child(member.name)
    origin = Origin(instance.path, member.span)
    if member.prefixes & {"parameter", "constant"}:
        return _parameter(instance.build, member, basic, shape, claims, path, origin)
    if member.prefixes & {"port in", "port out", "open"}:
        _allow(member, {"parameter", "constant", "input", "output", "final", "protected", "replaceable"}, f"a {basic}")
    if basic != "Real":
        raise Fault(
            WRONG_KIND,
            f"a variable is a Real, not a {basic}",
            member.declaration.type.span,
            basic,
            helps=(f"write `parameter {basic} {member.name}` or `constant {basic} {member.name}`",),
        )
    if shape is None:
        raise Fault(SIZE, f"the size of variable `{member.name}` is not given", member.span, "`:` is for parameters")
    part = SignalPart(path, shape, member, claims, origin, leaves_of(var, path, shape))
    part.output = "output" in member.prefixes
    part.role = "input" if "input" in member.prefixes else "algebraic"
    return part


def _basic(resolved: Resolved) -> bool:
    return resolved.name in BASIC if resolved.node is None else isinstance(resolved.node, ast.TypeDefinition)


def _basic_type(build: Build, resolved: Resolved) -> tuple[str, tuple[Claim, ...], tuple[int, ...]]:
    """The basic type behind a `type`, what the definitions on the way say about it, and their dimensions."""
    claims: tuple[Claim, ...] = ()
    dims: tuple[int, ...] = ()
    seen: list[ast.TypeDefinition] = []
    while isinstance(resolved.node, ast.TypeDefinition):
        node, scope = resolved.node, resolved.scope
        assert scope is not None
        if any(node is other for other in seen):
            raise Fault(WRONG_KIND, f"type `{node.name}` is defined by itself", node.span, "")
        seen.append(node)
        author = Context(build, None, scope)
        claims += ((Modification(node.name, node.span, None, build.names.table(node.arguments)), author, ()),)
        dims += tuple(evaluate_integer(dim, author) for dim in node.type.dims)
        base = build.names.resolve(node.type.name, scope)
        if base is None:
            raise Reported
        if not _basic(base):
            raise Fault(WRONG_KIND, f"a type is made of a basic type, `{base.name}` is {describe(base)}", node.type.span, "")
        resolved = base
    return resolved.name, claims, dims


def _parameter(
    build: Build, member: Member, basic: str, shape: tuple[int, ...] | None, claims: tuple[Claim, ...], path: str, origin: Origin
) -> ParameterPart:
    part = ParameterPart(path, basic, shape or (), member, claims, origin, "constant" in member.prefixes)
    part.comment = member.declarator.comment or ""
    build.parameters[path] = part
    if shape is None:
        part.open_shape = True
        build.evaluate_parameter(part)
        if part.state == "failed":
            raise Reported
    elif not part.fixed and basic not in ("String", "Table"):
        part.value = leaves_of(param, path, shape) if shape else param(path)
    return part


# ------------------------------------------------------------------------------------------------------------- the walk


def expand(root: Instance) -> None:
    """Make every part of every instance, depth first in the order of declaration, and note them in `build`."""
    build = root.build
    stack: list[tuple[Any, Instance]] = [(root, root)]
    while stack:
        part, owner = stack.pop()
        match part:
            case Instance():
                _note(build, part)
                if part.cls.is_element:
                    build.parts.append((part, owner))
                members = [(part.part(name), part) for name in part.cls.members]
                stack.extend(reversed(members))
            case ArrayPart():
                stack.extend((item, owner) for item in reversed(part.items))
            case Absent() | Broken() | Unfinished():
                pass
            case _:
                build.parts.append((part, owner))
                if isinstance(part, SignalPart | ElementPart):
                    build.nodes[part.name] = part


def _note(build: Build, instance: Instance) -> None:
    build.instances.append(instance)
    cls = instance.cls
    build.flat_instances.append(FlatInstance(instance.path, cls.name, cls.node.span, instance.declared, instance.comment))
