"""Reading the machine where a token does not fit: what is open, where the statement started, what usually leads here."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from difflib import get_close_matches

from bgdsl.source import Span
from bgdsl.syntax import errors
from bgdsl.syntax.machine import Machine, entries

CONTAINERS = ("statement", "algorithm_statement", "test_statement", "item", "declaration", "domain_variable", "file_item")
"""What a list is made of: after an error one of these is taken as read, empty."""

DEFINERS = frozenset(["MODEL", "ELEMENT", "FUNCTION", "DOMAIN", "TYPE", "TEST", "IMPORT"])
DECLARERS = frozenset(["PARAMETER", "CONSTANT", "INPUT", "OUTPUT", "OPEN", "PORT", "EXPERIMENT", "EXTENDS", "REDECLARE"])
CLOSING = {"LPAR": ("RPAR", ")"), "LSQB": ("RSQB", "]"), "LBRACE": ("RBRACE", "}")}
OPENING = {closing: opening for opening, (closing, _) in CLOSING.items()}


def closest(text: str, words: Iterable[str]) -> str | None:
    """The keyword that a word was meant to be: much alike, or the same letters in another order."""
    known = [word for word in words if word != text]
    same = [word for word in known if len(text) > 2 and sorted(word) == sorted(text)]
    return next(iter(same or get_close_matches(text, known, n=1, cutoff=0.75)), None)


def token_span(machine: Machine) -> Span:
    """Where the token that does not fit stands."""
    _, text, start = machine.token
    return Span(machine.source, start, start + len(text))


def after_last(machine: Machine) -> Span:
    """The place right after the token read last."""
    return Span(machine.source, machine.end, machine.end)


def end_of_line(machine: Machine, start: int) -> int:
    """Where the line of an offset ends."""
    end = machine.source.text.find("\n", start)
    return end if end >= 0 else len(machine.source.text)


def starts_line(machine: Machine, start: int) -> bool:
    """Whether nothing but blanks stands before an offset in its line."""
    text = machine.source.text
    return not text[text.rfind("\n", 0, start) + 1 : start].strip()


def new_line(machine: Machine) -> bool:
    """Whether the current token stands on a later line than the one before it."""
    return "\n" in machine.source.text[machine.end : machine.token[2]]


def looks_new(machine: Machine) -> bool:
    """On the same line: does a new declaration or statement start here?"""
    if machine.token[0] != "NAME" or machine.pending:
        return False
    after = machine.tokens.kinds[machine.index + 1 : machine.index + 2]
    where = statement_start(machine)
    if where is None or not after:
        return False
    in_equations = "statement" in machine.table.states[machine.states[where[0]]]
    if in_equations:
        return machine.tokens.texts[machine.index + 1] in ("->", "=>", "=", ".")
    return after[0] == "NAME"


def word_kind(machine: Machine, index: int) -> str | None:
    """The keyword that a token would be, if any, even where it was read as a name."""
    return machine.table.words.get(machine.tokens.texts[index])


def first_long_string(machine: Machine) -> Span | None:
    """The first line of the first string that spans lines, None where there is none."""
    tokens = machine.tokens
    for kind, text, start in zip(tokens.kinds, tokens.texts, tokens.starts, strict=True):
        if kind == "STRING" and "\n" in text:
            return Span(machine.source, start, start + len(text.split("\n", 1)[0]))
    return None


def container(machine: Machine, height: int) -> str | None:
    """What the list is made of that is open where the stack has this height; None where no list is."""
    actions = machine.table.states[machine.states[height]]
    found = next((symbol for symbol in CONTAINERS if symbol in actions), None)
    above = entries()[machine.states[height + 1]] if height + 1 < len(machine.states) else ""
    # after `function f` declarations may come, but not if `(` came; after a name items may come, but first its description
    return None if above == "STRING" or (above == "LPAR" and found != "statement") else found


def statement_start(machine: Machine) -> tuple[int, int] | None:
    """The height of the stack where the current statement starts, and the index of its first token."""
    for height in range(len(machine.values), -1, -1):
        if container(machine, height):
            begin = machine.begins[height] if height < len(machine.begins) else machine.token[2]
            return height, bisect_left(machine.tokens.starts, begin)
    return None


def open_bracket(machine: Machine) -> tuple[str, int] | None:
    """The innermost open bracket of the current statement and its place."""
    for height in range(len(machine.values), 0, -1):
        symbol = entries()[machine.states[height]]
        if symbol in CLOSING:
            return symbol, machine.begins[height - 1]
        if container(machine, height):
            return None
    return None


def open_construct(machine: Machine) -> tuple[str, str, Span] | None:
    """The innermost open `model`, `for` ...: its word, its name and where it starts."""
    symbols = machine.symbols()
    for place in range(len(symbols) - 1, -1, -1):
        word = {
            "kind": str(machine.values[place]),
            "FUNCTION": "function",
            "DOMAIN": "domain",
            "TEST": "test",
            "FOR": "for",
            "IF": "if",
        }.get(symbols[place])
        if word and not (symbols[place] in ("FOR", "IF") and not container(machine, place)):
            begin = machine.begins[place]
            named = word not in ("for", "if") and place + 1 < len(symbols)
            name = str(machine.values[place + 1]) if named else ""
            end = machine.begins[place + 1] + len(name) if named and word != "test" else begin + len(word)
            return word, name, Span(machine.source, begin, end)
    return None


def outer_constructs(machine: Machine) -> list[tuple[str, str]]:
    """The open constructs around the innermost one, as word and name."""
    symbols = machine.symbols()
    found: list[tuple[str, str]] = []
    for place, symbol in enumerate(symbols):
        match symbol:
            case "FOR" | "IF" if container(machine, place):
                found.append((symbol.lower(), ""))
            case "kind" | "FUNCTION" | "DOMAIN" if place + 1 < len(symbols):
                found.append((str(machine.values[place]), str(machine.values[place + 1])))
    return found[:-1]


def usual_cause(machine: Machine) -> str | None:
    """The mistake that usually leads to the token at hand."""
    _, text, _ = machine.token
    return (
        misplaced(machine, text)
        or {
            "^": "powers do not chain: write `(a^b)^c` or `a^(b^c)`",
            "%": "the remainder is written `mod(a, b)`",
            ".": "a number starts with a digit, as in `0.5`" if machine.accepts("NUMBER") else None,
        }.get(text)
        or unfinished(machine, text)
    )


def misplaced(machine: Machine, text: str) -> str | None:
    """A statement among the declarations, or the other way round."""
    where = statement_start(machine)
    if where is None or open_bracket(machine):
        return None
    height, first = where
    last = machine.symbols()[-1:]
    words = machine.tokens.texts[first : first + 2]
    match container(machine, height):
        case "item" if words[:1] == ["redeclare"]:
            return "a redeclaration is `redeclare Class name[index](modifications);`, one statement for each component"
        case "item" if words in (["final", "redeclare"], ["replaceable", "redeclare"]):
            return f"`{words[0]}` stands after `redeclare`"
        case "item" if text in errors.SIGNS_OF_BONDS:
            return "bonds stand in the `equation` section"
        case "item" if text in ("=", "(") and last in (["NAME"], ["reference_plain"]):
            return "equations stand in the `equation` section"
        case "statement" if machine.table.words.get(machine.tokens.texts[first]) in DECLARERS or machine.tokens.kinds[
            first : first + 2
        ] == ["NAME", "NAME"]:
            return "declarations stand before `equation`"
        case "statement" if text in errors.SIGNS_OF_BONDS or text == ",":
            return "only the last end of a chain may be a list, as in `a -> b -> c, d;`"
    return None


def unfinished(machine: Machine, text: str) -> str | None:
    """What is wrong with a statement that stops being one here, in a sentence; None where nothing is known."""
    expected = machine.expected()
    if "EACH" in expected or (expected == {"EQUAL", "LPAR"} and open_bracket(machine)):
        return "a modification is `name = value` or `name(...)`"
    if text in ("<", ">", "<=", ">=", "==", "<>") and "NUMBER" not in expected:
        return "comparisons do not chain: write `a < b and b < c`"
    if "ELSE" in expected and "IF" in machine.symbols() and "SEMICOLON" not in expected and not machine.accepts("END"):
        return "an `if` in an expression needs its `else`"
    return None
