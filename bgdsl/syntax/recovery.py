"""What happens at a token that does not fit: say what is wrong in the words of somebody who knows the usual causes, and go on.

Each repair looks for one usual mistake; it reports it and changes the machine's next tokens to what was meant, so that the
parse goes on as if the text were right. Where none knows the mistake, what was found and what could stand there is said,
and the statement is dropped: the parse goes on after its `;`. Every repair either moves on in the text or inserts a token
that the machine takes together with the one after it, so the work stays linear.
"""

from __future__ import annotations

from collections.abc import Callable

from bgdsl.diagnostics import Reporter
from bgdsl.syntax import errors
from bgdsl.syntax.foreign_text import foreign_sign, string_over_lines, unclosed_text, when_clause
from bgdsl.syntax.limits import MAX_DEPTH
from bgdsl.syntax.machine import MAX_STACK, Machine
from bgdsl.syntax.resync import resynchronize
from bgdsl.syntax.situation import statement_start, token_span, usual_cause
from bgdsl.syntax.trouble import Trouble
from bgdsl.syntax.unclosed import brackets, missing_end, missing_semicolon, wrong_end
from bgdsl.syntax.wrong_words import missing_section, missing_word, misspelt, number_into_name, reserved_name, wrong_equals

MAX_REPAIRS = 8
"""How many repairs may be tried at one token before the statement is dropped."""

Repair = Callable[[Trouble, Machine], bool | None]
REPAIRS: tuple[Repair, ...] = (
    unclosed_text,
    string_over_lines,
    foreign_sign,
    when_clause,
    number_into_name,
    wrong_equals,
    misspelt,
    wrong_end,
    missing_word,
    brackets,
    missing_end,
    missing_section,
    missing_semicolon,
    reserved_name,
)
"""In the order in which they are tried. Each returns None if the mistake is another, else whether to go on."""


class Recovery:
    """Recovers the parse of one text; an instance is the machine's `recover`."""

    def __init__(self, report: Reporter):
        self.trouble = Trouble(report)
        self.stuck = (-1, 0)

    def __call__(self, machine: Machine) -> bool:
        """Go on after an error; False when there is no use in going on."""
        if len(machine.states) > MAX_STACK:
            errors.too_deep(self.trouble.report, token_span(machine), MAX_DEPTH)
            return False
        machine.settle()
        start = machine.token[2]
        self.stuck = (start, self.stuck[1] + 1 if self.stuck[0] == start else 0)
        for repair in REPAIRS if self.stuck[1] < MAX_REPAIRS else ():
            done = repair(self.trouble, machine)
            if done is not None:
                return done and not self.trouble.enough
        general(self.trouble, machine)
        return not self.trouble.enough and resynchronize(machine)


def general(trouble: Trouble, machine: Machine) -> None:
    """Say what was found and what could stand there, with the usual cause where one is known."""
    kind, text, _ = machine.token
    said = errors.wanted(machine.expected(), machine.table.shown)
    found = errors.found(kind, text)
    cause = usual_cause(machine)
    if cause and cause.startswith("declarations"):  # say it once for each section
        where = statement_start(machine)
        key = cause, machine.begins[where[0] - 1] if where else 0
        if key in trouble.said:
            return
        trouble.said.add(key)
    if cause:
        trouble.add(errors.UNEXPECTED, cause, token_span(machine), f"{found} is not expected here", notes=[f"expected {said}"])
    else:
        trouble.add(errors.UNEXPECTED, f"expected {said}, found {found}", token_span(machine), "not expected here")
