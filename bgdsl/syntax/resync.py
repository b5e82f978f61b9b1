"""Going on after an error that no repair knows: the statement is dropped."""

from __future__ import annotations

from bgdsl.syntax.machine import Machine
from bgdsl.syntax.situation import DEFINERS, container, starts_line


def resynchronize(machine: Machine) -> bool:
    """Drop the statement at hand: go on after its `;`, or at a word that ends or starts something larger."""
    if finish_header(machine):
        return True
    machine.pending.clear()
    first = True
    while True:
        kind, _, start = machine.token
        if kind == "SEMICOLON":
            machine.end = start + 1
            machine.advance()
            if resume(machine, inner_only=machine.token[0] not in ("END", "$END")):
                return True
            first = False
            continue
        larger = kind in ("END", "EQUATION", "INITIAL_EQUATION", "$END") or (kind in DEFINERS and starts_line(machine, start))
        if larger and not first and resume(machine, inner_only=False):
            return True
        if larger and first and kind != "END" and not machine.accepts(kind) and resume(machine, inner_only=False):
            return True
        if kind == "$END":
            return False
        machine.end = start + len(machine.token[1])
        machine.advance()
        first = False


def reopen(machine: Machine) -> bool:
    """After a stray `end`: open the model's list again that the `end` has closed (what it held is lost)."""
    symbols = machine.symbols()
    if symbols[-3:] != ["items", "sections", "END"]:
        return False
    has_sections = bool(machine.values[-2])
    machine.cut(len(symbols) - (2 if has_sections else 3))
    if has_sections:
        machine.push("section_kind", False, machine.token[2])
    return True


def finish_header(machine: Machine) -> bool:
    """An error between `for` and `loop`, or `if` and `then`: the header is dropped, the body stays."""
    symbols = machine.symbols()
    for height in range(len(symbols), 0, -1):
        symbol = symbols[height - 1]
        state = machine.states[height]
        if symbol in ("FOR", "IF", "ELSEIF") and (symbol == "ELSEIF" or container(machine, height - 1)):
            word, rest = ("LOOP", "iterators") if symbol == "FOR" else ("THEN", "expression")
            ahead = machine.tokens.kinds[machine.index : machine.index + 60]
            stop = ahead.index("SEMICOLON") if "SEMICOLON" in ahead else len(ahead)
            if word not in ahead[:stop] or rest not in machine.table.states[state]:
                return False
            machine.pending.clear()
            while machine.token[0] != word:
                machine.advance()
            machine.cut(height)
            machine.push(rest, (), machine.token[2])
            return True
        if container(machine, height):
            return False
    return False


def resume(machine: Machine, *, inner_only: bool) -> bool:
    """Take the item at hand of the innermost list as read, if what comes next then fits (else of a list around it)."""
    kind, _, start = machine.token
    follow = (kind, machine.tokens.kinds[machine.index + 1]) if kind == "END" else (kind,)
    for height in range(len(machine.values), -1, -1):
        symbol = container(machine, height)
        if symbol is None:
            continue
        probe = [*machine.states[: height + 1], machine.table.states[machine.states[height]][symbol]]
        if machine.takes(probe, *follow, soft=kind not in DEFINERS):
            machine.cut(height)
            machine.push(symbol, None, start)
            return True
        if inner_only:
            return False
    return False
