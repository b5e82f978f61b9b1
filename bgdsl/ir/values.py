"""Every addressable scalar of a model, made when asked for.

A large model has a hundred thousand names (each bond's effort and flow); an equation or an output reads few of them. So the
mapping keeps the aliases as the scalar graph gives them, and closes one over the unknowns when somebody reads it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property

from bgdsl.expr import Expr, rebuild, var


class Values(Mapping[str, Expr]):
    """Scalar names to expressions over states, unknowns, inputs, parameters and time.

    known: names that stand for themselves. aliases: names with a value that may read other names. made: names whose value is
    computed by the function given with them (powers, energies). A name whose value reads itself (a modulus that depends on
    its own port's effort) cannot be an alias: it stands for itself, and is listed in `loops`.
    """

    def __init__(self, known: dict[str, None], aliases: Mapping[str, Expr], made: Mapping[str, Callable[[], Expr]]):
        self.known = known
        self._aliases = aliases
        self._made = made
        self._done: dict[Expr, Expr] = {}
        self.loops: dict[str, Expr] = {}
        self.missing: set[str] = set()

    def __getitem__(self, name: str) -> Expr:
        if name not in self:
            raise KeyError(name)
        return self.close(var(name))

    def __contains__(self, name: object) -> bool:
        return name in self._aliases or name in self._made or name in self.known

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.known, *self._aliases, *self._made)))

    def close(self, root: Expr) -> Expr:
        """The expression with every alias replaced by its value, through any number of levels."""
        done = self._done
        stack = [root]
        opened: set[Expr] = set()
        while stack:
            node = stack[-1]
            if node in done:
                stack.pop()
                continue
            wanted = self._wanted(node)
            waiting = [arg for arg in wanted if arg not in done]
            if not waiting:
                done[node] = self._closed(node, wanted)
                stack.pop()
            elif node.op == "var" and node in opened:
                self._cut(node)
            else:
                if node.op == "var":
                    opened.add(node)
                stack += waiting
        return done[root]

    def _wanted(self, node: Expr) -> tuple[Expr, ...]:
        """What has to be closed before the node: its operands, or an alias's value."""
        if node.op != "var":
            return node.args
        value = self._value(node.data)
        return () if value is None else (value,)

    def _value(self, name: str) -> Expr | None:
        if name in self._aliases:
            return self._aliases[name]
        make = self._made.get(name)
        if make is None and name not in self.known:
            self.missing.add(name)
        return None if make is None else make()

    def _closed(self, node: Expr, wanted: tuple[Expr, ...]) -> Expr:
        if node.op == "var":
            return self._done[wanted[0]] if wanted else node
        return rebuild(node, tuple(self._done[arg] for arg in wanted)) if wanted else node

    def _cut(self, node: Expr) -> None:
        value = self._value(node.data)
        assert value is not None
        self.loops[node.data] = value
        self._done[node] = node
