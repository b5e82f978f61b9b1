"""Going over expressions, operands before users, and making them anew with other leaves."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping

from bgdsl.expr.nodes import FUNCTIONS, RELATIONS, Expr, add, binary, div, if_else, mul, neg, not_, power, relation, table, unary


def topological(roots: Iterable[Expr], done: Container[Expr] = ()) -> Iterator[Expr]:
    """Every node under the roots once, operands before users, in an order fixed by the roots alone.

    Nodes in `done`, and what only they reach, are left out; the caller may add to it what was yielded.
    """
    seen: set[Expr] = set()
    for root in roots:
        if not root.args:  # a leaf, as very many roots are
            if root not in seen and root not in done:
                seen.add(root)
                yield root
            continue
        stack = [root]
        while stack:
            node = stack[-1]
            if node in seen or node in done:
                stack.pop()
                continue
            missing = [arg for arg in node.args if arg not in seen and arg not in done]
            if missing:
                missing.reverse()
                stack += missing
            else:
                stack.pop()
                seen.add(node)
                yield node


def variables(roots: Iterable[Expr]) -> list[str]:
    """The names of the variables under the roots, each once, in the order in which they are met from left to right."""
    seen: set[Expr] = set()
    names: list[str] = []
    stack = [*roots][::-1]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.args:
            stack += node.args[::-1]
        elif node.op == "var":
            names.append(node.data)
    return names


def leaves(roots: Iterable[Expr], op: str = "var") -> Iterator[Expr]:
    """The leaves of one kind (`var`, `param`, `time`) under the roots, each once."""
    return (node for node in topological(roots) if node.op == op)


_BUILD: Mapping[str, Callable[..., Expr]] = {
    "add": lambda *args: add(args),
    "mul": mul,
    "div": div,
    "pow": power,
    "neg": neg,
    "not": not_,
    "if": if_else,
    **{name: (lambda a, b, name=name: relation(name, a, b)) for name in RELATIONS},
    **{
        name: (lambda a, b, name=name: binary(name, a, b)) if name in ("atan2", "min", "max") else (lambda a, name=name: unary(name, a))
        for name in FUNCTIONS
    },
}


def rebuild(node: Expr, args: tuple[Expr, ...]) -> Expr:
    """The node with other operands, simplified anew."""
    if all(new is old for new, old in zip(args, node.args, strict=True)):
        return node
    return table(node.data[0], args[0], node.data[1]) if node.op == "table" else _BUILD[node.op](*args)


def substitute(roots: Iterable[Expr], replacement: Mapping[Expr, Expr]) -> tuple[Expr, ...]:
    """The roots with every node that is a key replaced by its value (values are not searched again)."""
    return rewrite(roots, dict(replacement))


def rewrite(roots: Iterable[Expr], done: dict[Expr, Expr]) -> tuple[Expr, ...]:
    """As `substitute`; every node met is added to `done`, so that later calls with the same one go on from there."""
    roots = tuple(roots)
    for node in topological(roots, done):
        done[node] = rebuild(node, tuple(done[arg] for arg in node.args)) if node.args else node
    return tuple(done[root] for root in roots)
