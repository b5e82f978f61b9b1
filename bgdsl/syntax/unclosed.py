"""Repairs of what is open and not closed as it should be: brackets, constructs with an `end`, statements without their `;`."""

from __future__ import annotations

from bgdsl.source import Span
from bgdsl.syntax import errors
from bgdsl.syntax.machine import Machine
from bgdsl.syntax.resync import reopen, resynchronize
from bgdsl.syntax.situation import (
    CLOSING,
    DEFINERS,
    OPENING,
    after_last,
    container,
    looks_new,
    new_line,
    open_bracket,
    open_construct,
    outer_constructs,
    starts_line,
    statement_start,
    token_span,
    word_kind,
)
from bgdsl.syntax.trouble import Trouble


def brackets(trouble: Trouble, machine: Machine) -> bool | None:
    """The innermost open bracket is not closed, or is closed by another."""
    opened = open_bracket(machine)
    kind, text, start = machine.token
    if opened is None:
        return extra_bracket(trouble, machine)
    symbol, at = opened
    closing, sign = CLOSING[symbol]
    opening = Span(machine.source, at, at + 1)
    after = machine.tokens.kinds[machine.index + 1] if not machine.pending and kind != "$END" else "$END"
    if kind in OPENING and machine.accepts(closing) and not machine.accepts(closing, kind, after):
        message = f"`{text}` does not close `{opening.text}`"
        trouble.add(errors.UNCLOSED_BRACKET, message, token_span(machine), f"should be `{sign}`", others=[(opening, "opened here")])
        machine.replace(closing, sign)
        return True
    ends = kind in (*OPENING, "SEMICOLON", "$END", "EQUATION", "INITIAL_EQUATION", "END", "THEN", "LOOP") or (
        new_line(machine) and kind == "NAME"
    )
    if not ends or not machine.accepts(closing):
        return None
    message = f"this `{opening.text}` is not closed"
    trouble.add(
        errors.UNCLOSED_BRACKET, message, opening, "opened here", others=[(after_last(machine), f"`{sign}` is missing here, or before")]
    )
    machine.insert((closing, sign, start))
    return True


def extra_bracket(trouble: Trouble, machine: Machine) -> bool | None:
    """A bracket closes that was not opened: it is left out."""
    kind, text, _ = machine.token
    if kind not in OPENING:
        return None
    trouble.add(errors.UNCLOSED_BRACKET, f"this `{text}` closes nothing", token_span(machine), "no bracket is open here")
    machine.advance()
    return True


def wrong_end(trouble: Trouble, machine: Machine) -> bool | None:
    """The word after `end` does not fit what is open."""
    symbols = machine.symbols()
    if not symbols or symbols[-1] != "END" or (new_line(machine) and machine.accepts("SEMICOLON")):
        return None
    kind, text, start = machine.token
    end = Span(machine.source, machine.begins[-1], start + len(text))
    opened = open_construct(machine)
    if opened is None:
        return None
    word, name, opening = opened
    wanted = f"end {word}" if word in ("for", "if") else "end" if word == "test" else f"end {name}"
    outer = outer_constructs(machine)
    closes_outer = (kind in ("FOR", "IF") and text in (w for w, _ in outer)) or (kind == "NAME" and text in (n for _, n in outer))
    if closes_outer and word in ("for", "if"):
        trouble.add(errors.MISSING_END, f"`{wanted};` is missing", end, f"this closes what stands around the `{word}`",
                 others=[(opening, f"this `{word}` is still open")])  # fmt: skip
        machine.insert((word.upper(), word, start), ("SEMICOLON", ";", start), ("END", "end", start))
        return True
    if kind in ("FOR", "IF") and word not in ("for", "if"):
        trouble.add(errors.END_MISMATCH, f"`{end.text};` closes nothing", end, f"no `{text}` is open here")
    else:
        message = "`end` is not enough here" if text == ";" else f"`{end.text}` does not fit here"
        others = [(opening, f"this closes the `{word}` that starts here")]
        trouble.add(errors.END_MISMATCH, message, end, f"should be `{wanted};`", others=others)
    if kind in ("FOR", "IF") and word not in ("for", "if"):  # `end for;` closes no loop: it is left out
        if not reopen(machine):
            return resynchronize(machine)
        while machine.token[0] not in ("SEMICOLON", "$END"):
            machine.advance()
        if machine.token[0] == "SEMICOLON":
            machine.advance()
        return True
    if kind not in ("SEMICOLON", "$END"):
        machine.advance()
    if word == "test":
        return True
    machine.insert((word.upper(), word, start) if word in ("for", "if") else ("NAME", name, start))
    return True


def missing_end(trouble: Trouble, machine: Machine) -> bool | None:
    """The text ends, or the next definition starts, while something is open."""
    kind, _, start = machine.token
    back = False
    where = statement_start(machine)
    if kind != "$END" and where and where[1] < machine.index and word_kind(machine, where[1]) in DEFINERS:
        back = starts_line(machine, machine.tokens.starts[where[1]])
    if not back and kind != "$END" and not (kind in DEFINERS and starts_line(machine, start)):
        return None
    if back and where:
        if container(machine, where[0]) != "statement":
            return None
        machine.rewind(*where)
        kind, _, start = machine.token
    opened = open_construct(machine)
    if opened is None:
        return None
    word, name, opening = opened
    closing = [("END", "end", start), ("SEMICOLON", ";", start)]
    if word != "test":
        closing.insert(1, (word.upper(), word, start) if word in ("for", "if") else ("NAME", name, start))
    if not machine.accepts(*(token[0] for token in closing)):
        return None
    wanted = f"end {word}" if word in ("for", "if") else "end" if word == "test" else f"end {name}"
    if trouble.closed_at != start:
        trouble.add(
            errors.MISSING_END,
            f"`{wanted};` is missing",
            opening,
            f"this `{word}` is not closed",
            others=[(token_span(machine) if kind != "$END" else after_last(machine), f"`{wanted};` should stand before this")],
        )
    trouble.closed_at = start
    machine.insert(*closing)
    return True


def missing_semicolon(trouble: Trouble, machine: Machine) -> bool | None:
    """The next statement starts where this one should end."""
    kind = machine.token[0]
    if open_bracket(machine) or kind in ("SEMICOLON", "$END") or not machine.accepts("SEMICOLON", kind):
        return None
    if not new_line(machine) and kind not in ("END", "EQUATION", "INITIAL_EQUATION", "ALGORITHM") and not looks_new(machine):
        return None
    trouble.add(
        errors.MISSING_SEMICOLON,
        "a `;` is missing",
        after_last(machine),
        "expected `;` here",
        others=[(token_span(machine), "before this")],
    )
    machine.insert(("SEMICOLON", ";", machine.end))
    return True
