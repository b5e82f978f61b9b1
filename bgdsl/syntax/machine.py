"""The LALR(1) machine: shifts and reduces by the tables, and calls the tree builder.

The loop is written for speed: it is most of the time that reading a large model takes. Chains of unit rules (a name that is
a `reference`, a `primary`, ... an `expression`) are skipped in one step, remembered by state, symbol and next token.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from operator import itemgetter
from typing import Any, Protocol

from bgdsl.source import Source, Span
from bgdsl.syntax.lexer import RESERVED, Tokens
from bgdsl.syntax.limits import MAX_DEPTH
from bgdsl.syntax.tables import Rule, Tables, tables

MAX_STACK = 4 * MAX_DEPTH
"""Each level of nesting has about four symbols on the stack."""

Token = tuple[str, str, int]
"""Kind, text and start."""

Action = Callable[..., Any]


class Recover(Protocol):
    """What is done when no action fits: change the machine or its next tokens so that it can go on; False to give up."""

    def __call__(self, machine: Machine) -> bool: ...


@cache
def soft_words() -> frozenset[str]:
    """Kinds of keywords that are names where the grammar does not ask for the keyword."""
    return frozenset(kind for word, kind in tables().words.items() if word not in RESERVED)


@cache
def terminals() -> frozenset[str]:
    """The kinds of tokens."""
    known = tables()
    return frozenset([*known.words.values(), *known.signs.values(), *(name for name, _ in known.patterns), "$END"])


@cache
def entries() -> dict[int, str]:
    """The symbol by which each state is entered."""
    return {target: symbol for state in tables().states for symbol, target in state.items() if target >= 0}


@cache
def _skips() -> dict[tuple[int, str, str], int]:
    """Remembered ends of chains of unit rules."""
    return {}


def _arguments(rule: Rule) -> Callable[[list[Any]], Sequence[Any]]:
    """How the arguments of a rule's action are taken from the values of its symbols."""
    if rule.spliced:

        def gather(values: list[Any]) -> list[Any]:
            found: list[Any] = []
            for place in rule.kept:
                if place is None:
                    found.append(None)
                elif place in rule.spliced:
                    found += values[place]
                else:
                    found.append(values[place])
            return found

        return gather
    if rule.kept == tuple(range(rule.length)):
        return lambda values: values
    places = [place for place in rule.kept if place is not None]
    if len(places) == len(rule.kept):
        match places:
            case []:
                return lambda values: ()
            case [one]:
                return lambda values: (values[one],)
            case _:
                return itemgetter(*places)
    return lambda values: [None if place is None else values[place] for place in rule.kept]


def _extend(rule: Rule) -> Callable[[list[Any]], list[Any]]:
    """The list behind a `*` or `+`: started by its first items, extended in place by the next."""
    if rule.spliced:
        places = [place for place in rule.kept if place not in rule.spliced and place is not None]
        first = rule.spliced[0]

        def extend(values: list[Any]) -> list[Any]:
            found: list[Any] = values[first]
            for place in places:
                found.append(values[place])
            return found

        return extend
    take = _arguments(rule)
    return lambda values: list(take(values))


def _reducers(table: Tables, action: Callable[[str], Action]) -> list[tuple[str, int, Action | None, Callable[[list[Any]], Any]]]:
    """For each rule: what it makes, its length, the builder's action, and how its arguments are taken."""
    found: list[tuple[str, int, Action | None, Callable[[list[Any]], Any]]] = []
    for rule in table.rules:
        if rule.splice:
            found.append((rule.origin, rule.length, None, _extend(rule)))
        elif rule.action is None:
            place = rule.kept[0]
            assert place is not None
            found.append((rule.origin, rule.length, None, itemgetter(place)))
        else:
            found.append((rule.origin, rule.length, action(rule.action), _arguments(rule)))
    return found


class Machine:
    """One parse. `states`, `values` and `begins` are the stack; `token` is next, then `pending`, then the text's tokens."""

    def __init__(self, source: Source, tokens: Tokens, action: Callable[[str], Action]):
        self.source = source
        self.tokens = tokens
        self.table = tables()
        self.reducers = _reducers(self.table, action)
        self.states = [self.table.start]
        self.values: list[Any] = []
        self.begins: list[int] = []
        self.pending: list[Token] = []
        self.index = -1
        self.end = 0
        self.token: Token = ("", "", 0)
        self.advance()

    def advance(self) -> None:
        """Make the next token the current one."""
        if self.pending:
            self.token = self.pending.pop(0)
        else:
            tokens = self.tokens
            self.index = index = min(self.index + 1, len(tokens.kinds) - 1)
            self.token = (tokens.kinds[index], tokens.texts[index], tokens.starts[index])

    def action(self, state: int, kind: str) -> int | None:
        """The table's action; a keyword that does not fit is tried as a name."""
        actions = self.table.states[state]
        found = actions.get(kind)
        return actions.get("NAME") if found is None and kind in soft_words() else found

    def run(self, recover: Recover) -> Any:
        """The value of the whole text, or None where `recover` gave up."""
        source, table, reducers, skips, soft = self.source, self.table.states, self.reducers, _skips(), soft_words()
        states, values, begins, tokens = self.states, self.values, self.begins, self.tokens
        kinds, texts, starts = tokens.kinds, tokens.texts, tokens.starts
        kind, text, start = self.token
        index, end, last = self.index, 0, self.table.end
        while True:
            actions = table[states[-1]]
            action = actions.get(kind)
            if action is None and kind in soft:
                action = actions.get("NAME")
                if action is not None and action >= 0:  # the formatter wants to know what was a name
                    kinds[index] = "NAME"
            if action is None:
                self.index, self.token, self.end = index, (kind, text, start), end
                if not recover(self):
                    return None
                index, (kind, text, start), end = self.index, self.token, self.end
            elif action >= 0:
                states.append(action)
                values.append(text)
                begins.append(start)
                end = start + len(text)
                if len(states) > MAX_STACK:
                    self.token = (kind, text, start)
                    if not recover(self):
                        return None
                if self.pending:
                    self.advance()
                    kind, text, start = self.token
                else:
                    index += 1
                    kind, text, start = kinds[index], texts[index], starts[index]
            else:
                origin, length, build, take = reducers[-1 - action]
                if length == 1:
                    begin = begins.pop()
                    states.pop()
                    children = [values.pop()]
                    value = take(children) if build is None else build(Span(source, begin, end), *take(children))
                elif length:
                    begin = begins[-length]
                    children = values[-length:]
                    del states[-length:], values[-length:], begins[-length:]
                    value = take(children) if build is None else build(Span(source, begin, end), *take(children))
                else:
                    begin = start
                    value = build(Span(source, start, start), *take([])) if build else take([])
                state = states[-1]
                key = (state, origin, kind)
                target = skips.get(key)
                if target is None:
                    target = skips[key] = self.skip(state, origin, kind)
                states.append(target)
                values.append(value)
                begins.append(begin)
                if target == last and kind == "$END":
                    return value

    def skip(self, state: int, symbol: str, kind: str) -> int:
        """The state after `symbol`, and after the unit rules that the next token makes follow at once."""
        table, rules = self.table.states, self.table.rules
        while True:
            target = table[state][symbol]
            action = self.action(target, kind)
            if action is None or action >= 0 or not rules[-1 - action].is_unit:
                return target
            symbol = rules[-1 - action].origin

    # --------------------------------------------------------------------------------------- what recovery asks and does

    def accepts(self, *kinds: str) -> bool:
        """Whether these tokens could come next, one after the other."""
        return self.takes(self.states[:], *kinds)

    def takes(self, states: list[int], *kinds: str, soft: bool = True) -> bool:
        """Whether a stack of these states could take these tokens (not `soft`: keywords as keywords); the list is used up."""
        return all(self._shift(states, kind, soft) for kind in kinds)

    def _shift(self, states: list[int], kind: str, soft: bool) -> bool:
        table, rules = self.table.states, self.table.rules
        while True:
            action = self.action(states[-1], kind) if soft else table[states[-1]].get(kind)
            if action is None:
                return False
            if action >= 0:
                states.append(action)
                return True
            rule = rules[-1 - action]
            del states[len(states) - rule.length :]
            states.append(table[states[-1]][rule.origin])
            if states[-1] == self.table.end:
                return kind == "$END"

    def expected(self) -> frozenset[str]:
        """The terminals that could come next."""
        actions = self.table.states[self.states[-1]]
        return frozenset(kind for kind in actions if kind in terminals() and self.accepts(kind))

    def settle(self) -> None:
        """Finish what is complete whatever comes next (a statement after its `;`)."""
        while True:
            actions = set(self.table.states[self.states[-1]].values())
            if len(actions) != 1 or (action := actions.pop()) >= 0:
                return
            origin, length, build, take = self.reducers[-1 - action]
            if not length:
                return
            begin, children = self.begins[-length], self.values[-length:]
            self.cut(len(self.values) - length)
            value = build(Span(self.source, begin, self.end), *take(children)) if build else take(children)
            self.push(origin, value, begin)

    def symbols(self) -> list[str]:
        """The symbols on the stack, the first at the bottom."""
        known = entries()
        return [known[state] for state in self.states[1:]]

    def insert(self, *tokens: Token) -> None:
        """Put tokens before the current one."""
        self.pending[:0] = [*tokens, self.token]
        self.advance()

    def replace(self, kind: str, text: str) -> None:
        """Read the current token as another."""
        self.token = (kind, text, self.token[2])

    def cut(self, height: int) -> None:
        """Drop all symbols of the stack but the first `height`."""
        del self.states[height + 1 :], self.values[height:], self.begins[height:]

    def push(self, symbol: str, value: Any, start: int) -> None:
        """Go on as if `symbol` had been read."""
        self.states.append(self.table.states[self.states[-1]][symbol])
        self.values.append(value)
        self.begins.append(start)

    def rewind(self, height: int, index: int) -> None:
        """Go back to token `index`, where the stack had `height` symbols."""
        self.cut(height)
        self.pending.clear()
        kinds, texts = self.tokens.kinds, self.tokens.texts
        for place in range(index, self.index + 1):  # what was read as a name may be a keyword yet
            if kinds[place] == "NAME":
                kinds[place] = self.table.words.get(texts[place], "NAME")
        self.index = index - 1
        self.end = self.tokens.starts[index - 1] + len(self.tokens.texts[index - 1]) if index else 0
        self.advance()
