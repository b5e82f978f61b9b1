"""The LALR tables of `grammar.lark` in a plain form, kept on disk between runs.

lark builds the tables (0.2 s, and its import); what the parser needs of them are numbers and names, so they are kept as
JSON in the user's cache folder under a name made of the grammar's digest: nothing is ever unpickled, a damaged file is
built again, and two runs at once each put a whole file in place.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

FORM = "3"
"""Changes when the form of the kept tables changes."""


@dataclass(frozen=True, slots=True)
class Rule:
    """`origin` is made of `length` symbols; `kept` are the places of those that become arguments (None: absent).

    `action` is the name of the builder's method; None hands a single child through. A `splice` rule makes or extends the
    list behind a `*` or `+`, and the rule that uses it has the list's place in `spliced`.
    """

    origin: str
    length: int
    action: str | None
    kept: tuple[int | None, ...]
    spliced: tuple[int, ...]
    splice: bool

    @property
    def is_unit(self) -> bool:
        """Nothing happens but a change of name: the parser may skip it."""
        return self.length == 1 and self.action is None and not self.splice


@dataclass(frozen=True, slots=True)
class Tables:
    """Actions by state and symbol: a state to go to (0 and above), or `-1 - r` to reduce by rule r."""

    start: int
    end: int
    states: tuple[dict[str, int], ...]
    rules: tuple[Rule, ...]
    words: dict[str, str]
    signs: dict[str, str]
    patterns: tuple[tuple[str, str], ...]
    shown: dict[str, str]


def _terminals(lark: Any) -> dict[str, Any]:
    """Keywords and signs by their text, and the terminals that are patterns, in the order to try them."""
    words: dict[str, str] = {}
    signs: dict[str, str] = {}
    patterns: list[tuple[int, str, str]] = []
    shown: dict[str, str] = {}
    for terminal in lark.terminals:
        name, pattern = terminal.name, terminal.pattern
        if pattern.type == "str":
            (words if pattern.value.isidentifier() else signs)[pattern.value] = name
            shown[name] = pattern.value
        elif name == "RELATION":
            signs.update(dict.fromkeys(("==", "<>", "<=", ">=", "<", ">"), name))
        elif not name.startswith("__"):
            patterns.append((-terminal.priority, name, pattern.to_regexp()))
    return {"words": words, "signs": signs, "patterns": [(name, regexp) for _, name, regexp in sorted(patterns)], "shown": shown}


def _rule(rule: Any) -> dict[str, Any]:
    origin = str(rule.origin.name)
    splice = origin.startswith("__")
    kept: list[int | None] = []
    empty = rule.options.empty_indices or (False,) * (len(rule.expansion) + 1)
    place = 0
    for absent in empty:
        if absent:
            kept.append(None)
        elif place < len(rule.expansion):
            symbol = rule.expansion[place]
            if not (symbol.is_term and symbol.filter_out and not rule.options.keep_all_tokens):
                kept.append(place)
            place += 1
    spliced = [k for k in kept if k is not None and not rule.expansion[k].is_term and rule.expansion[k].name.startswith("__")]
    through = rule.options.expand1 and not rule.alias and len(kept) == 1 and not spliced
    action = None if through or splice else str(rule.alias or origin)
    return {
        "origin": origin,
        "length": len(rule.expansion),
        "action": action,
        "kept": kept,
        "spliced": spliced,
        "splice": splice,
    }


def _build(grammar: str) -> dict[str, Any]:
    from lark import Lark

    lark = Lark(grammar, parser="lalr", lexer="contextual", start="file", maybe_placeholders=True)
    table: Any = lark.parser.parser._parse_table
    numbers = {rule: number for number, rule in enumerate(lark.rules)}

    def action(entry: Any) -> int:
        kind, argument = entry
        return int(argument) if str(kind) == "Shift" else -1 - numbers[argument]

    states, start, end = _in_order(
        {n: {symbol: action(entry) for symbol, entry in sorted(table.states[n].items())} for n in table.states},
        table.start_states["file"],
        table.end_states["file"],
    )
    return {"start": start, "end": end, "states": states, "rules": [_rule(rule) for rule in lark.rules], **_terminals(lark)}


def _in_order(states: dict[int, dict[str, int]], start: int, end: int) -> tuple[list[dict[str, int]], int, int]:
    """The states numbered as they are first reached, so that the tables of a grammar are always the same."""
    order = [start, end]
    numbers = {start: 0, end: 1}
    for state in order:
        for target in states[state].values():
            if target >= 0 and target not in numbers:
                numbers[target] = len(order)
                order.append(target)
    return [{symbol: numbers[a] if a >= 0 else a for symbol, a in states[state].items()} for state in order], 0, 1


def _cache_folder() -> Path | None:
    """`$XDG_CACHE_HOME/bgdsl`, or where the system keeps caches; None when there is no home."""
    given = os.environ.get("XDG_CACHE_HOME")
    if given:
        return Path(given) / "bgdsl"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "win32":
        return home / "AppData" / "Local" / "bgdsl"
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "bgdsl"


def _keep(path: Path, text: str) -> None:
    """Put the whole file in place at once; a folder that cannot be written is no harm."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_text(text, encoding="utf-8")
        os.replace(fresh, path)
    except OSError:
        with suppress(OSError):
            fresh.unlink()


def _read(path: Path) -> Tables | None:
    try:
        return _tables(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _tables(data: dict[str, Any]) -> Tables:
    rules = tuple(Rule(r["origin"], r["length"], r["action"], tuple(r["kept"]), tuple(r["spliced"]), r["splice"]) for r in data["rules"])
    return Tables(
        data["start"],
        data["end"],
        tuple(data["states"]),
        rules,
        data["words"],
        data["signs"],
        tuple((name, regexp) for name, regexp in data["patterns"]),
        data["shown"],
    )


@cache
def tables() -> Tables:
    """The tables of the grammar that ships with the package."""
    grammar = Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    folder = _cache_folder()
    digest = sha256(f"{FORM}\n{grammar}".encode()).hexdigest()[:24]
    path = folder / f"grammar-{digest}.json" if folder else None
    found = _read(path) if path else None
    if found:
        return found
    data = _build(grammar)
    if path:
        _keep(path, json.dumps(data, separators=(",", ":")))
    return _tables(data)
