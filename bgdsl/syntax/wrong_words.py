"""Repairs of words and signs of `.bg` itself: misspelt, left out, or standing where another should."""

from __future__ import annotations

from bgdsl.source import Span
from bgdsl.syntax import errors
from bgdsl.syntax.machine import Machine
from bgdsl.syntax.resync import resynchronize
from bgdsl.syntax.situation import after_last, closest, container, open_bracket, statement_start, token_span
from bgdsl.syntax.trouble import Trouble

BUILT_IN_TYPES = ("Real", "Integer", "Boolean", "String", "Table")


def number_into_name(trouble: Trouble, machine: Machine) -> bool | None:
    """`2x`: the statement is dropped."""
    kind, text, start = machine.token
    before = machine.index - 1
    if kind != "NAME" or before < 0 or start != machine.end or machine.tokens.kinds[before] != "NUMBER":
        return None
    number = machine.tokens.texts[before]
    helps = [f"write `{number}*{text}`"] if not machine.accepts("NAME") else []
    trouble.add(
        errors.UNEXPECTED,
        f"the number `{number}` runs into the name `{text}`",
        Span(machine.source, machine.tokens.starts[before], start + len(text)),
        "neither a number nor a name",
        helps=helps,
    )
    return resynchronize(machine)


def misspelt(trouble: Trouble, machine: Machine) -> bool | None:
    """A name where only keywords fit, or a statement that starts with a word much like a keyword."""
    kind, text, _ = machine.token
    if kind == "NAME":
        expected = machine.expected()
        words = {word: k for word, k in machine.table.words.items() if k in expected}
        close = closest(text, words)
        if close:
            say_misspelt(trouble, text, close, token_span(machine))
            machine.replace(words[close], close)
            return True
    return misspelt_start(trouble, machine)


def misspelt_start(trouble: Trouble, machine: Machine) -> bool | None:
    """The statement starts with a word much like a keyword: it is read again with the keyword."""
    where = statement_start(machine)
    if where is None:
        return None
    height, index = where
    if index >= machine.index or machine.tokens.kinds[index] != "NAME":
        return None
    text = machine.tokens.texts[index]
    states = machine.states[: height + 1]
    words = {word: kind for word, kind in machine.table.words.items() if kind in machine.table.states[states[-1]]}
    close = closest(text, words)
    if close is None or not text[0].islower():
        return None
    machine.rewind(height, index)
    say_misspelt(trouble, text, close, token_span(machine))
    machine.tokens.kinds[index] = words[close]
    machine.replace(words[close], close)
    return True


def say_misspelt(trouble: Trouble, text: str, word: str, span: Span) -> None:
    """The finding of a word that was meant to be a keyword."""
    trouble.add(errors.MISSPELT, f"`{text}` is not a keyword", span, f"did you mean `{word}`?")


def wrong_equals(trouble: Trouble, machine: Machine) -> bool | None:
    """`=`, `==`, `:=`, `=>` and `>=` for one another."""
    kind, text, _ = machine.token
    where = statement_start(machine)
    if text == "=" and where and not machine.pending and "IF" in machine.symbols()[where[0] :] and not machine.accepts("EQUAL"):
        trouble.add(errors.WRONG_EQUALS, "`=` does not compare", token_span(machine), "write `==`")
        machine.tokens.kinds[machine.index], machine.tokens.texts[machine.index] = "RELATION", "=="
        machine.rewind(*where)
    elif text == ":=" and machine.accepts("EQUAL"):
        trouble.add(errors.WRONG_EQUALS, "`:=` stands only in the `algorithm` of a function", token_span(machine), "write `=`")
        machine.replace("EQUAL", "=")
    elif text == "==" and machine.accepts("EQUAL"):
        trouble.add(errors.WRONG_EQUALS, "`==` only compares", token_span(machine), "write `=`")
        machine.replace("EQUAL", "=")
    elif text == "=>" and kind != "RELATION" and machine.accepts("RELATION"):
        trouble.add(errors.WRONG_EQUALS, "`=>` is a bond, not a comparison", token_span(machine), "write `>=`")
        machine.replace("RELATION", ">=")
    else:
        return None
    return True


def missing_word(trouble: Trouble, machine: Machine) -> bool | None:
    """`for ...` without `loop`, `if ...` without `then`."""
    kind, _, start = machine.token
    for word in ("loop", "then"):
        if kind not in ("SEMICOLON", "$END") and machine.accepts(word.upper(), kind):
            opening = "for" if word == "loop" else "if"
            where = next((b for s, b in reversed(list(zip(machine.symbols(), machine.begins, strict=True))) if s == opening.upper()), None)
            others = [] if where is None else [(Span(machine.source, where, where + len(opening)), f"of this `{opening}`")]
            trouble.add(errors.UNEXPECTED, f"`{word}` is missing", after_last(machine), f"write `{word}` here", others=others)
            machine.insert((word.upper(), word, start))
            return True
    return None


def reserved_name(trouble: Trouble, machine: Machine) -> bool | None:
    """A reserved word where only a name fits."""
    kind, text, _ = machine.token
    reserved = machine.table.words.get(text) == kind or kind == "END_INDEX"
    if not reserved or kind in ("END", "EQUATION") or machine.expected() - {"DOT", "LSQB"} != {"NAME"}:
        return None
    trouble.add(errors.UNEXPECTED, f"`{text}` is a keyword and cannot be a name", token_span(machine), "choose another name")
    machine.replace("NAME", text)
    return True


def missing_section(trouble: Trouble, machine: Machine) -> bool | None:
    """A bond or an equation among the declarations: the word `equation` is missing before it."""
    where = statement_start(machine)
    text = machine.token[1]
    if where is None or container(machine, where[0]) != "item" or machine.pending or open_bracket(machine):
        return None
    plain = machine.tokens.kinds[where[1]] == "NAME" and machine.expected() <= {"NAME", "DOT", "LSQB"}
    first_word = machine.tokens.texts[where[1]]
    nameless = (text == "(" and first_word not in ("der", "assert")) or (text == "=" and first_word in BUILT_IN_TYPES)
    if not plain or nameless or text not in (*errors.SIGNS_OF_BONDS, "=", "(", ":"):
        return None
    what = "bonds" if text in (*errors.SIGNS_OF_BONDS, ":") else "equations"
    span = token_span(machine)
    machine.rewind(*where)
    section = ("EQUATION", "equation", machine.token[2])
    first = Span(machine.source, machine.token[2], span.end)
    trouble.add(errors.UNEXPECTED, f"{what} stand in the `equation` section", first, "this stands among the declarations",
             helps=["write `equation` before the first of them"])  # fmt: skip
    machine.insert(section)
    return True
