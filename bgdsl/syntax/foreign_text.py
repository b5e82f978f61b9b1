"""What other languages write, and text that does not end: repairs of single signs, strings and comments.

Each says what is wrong and what to write instead, and changes the next tokens to what was meant.
"""

from __future__ import annotations

from bgdsl.source import Span
from bgdsl.syntax import errors
from bgdsl.syntax.lexer import tokenize
from bgdsl.syntax.machine import Machine
from bgdsl.syntax.resync import resume
from bgdsl.syntax.situation import end_of_line, first_long_string, statement_start, token_span
from bgdsl.syntax.trouble import Trouble

_UPDATES = "an equation states what holds; it changes nothing"
_BOND, _VECTOR_BOND = "a bond is written `->`, a vector bond `=>`", "a vector bond is written `=>`"
FOREIGN_SIGNS = {
    "!=": ("<>", "not equal is written `<>`"),
    "~=": ("<>", "not equal is written `<>`"),
    "===": ("==", "equality is written `==`"),
    "&&": ("and", "write `and`"),
    "&": ("and", "write `and`"),
    "||": ("or", "write `or`"),
    "!": ("not", "write `not`"),
    "**": ("^", "a power is written `^`"),
    "+=": ("=", _UPDATES),
    "-=": ("=", _UPDATES),
    "*=": ("=", _UPDATES),
    "-->": ("->", _BOND),
    "<->": ("->", _BOND),
    "\N{RIGHTWARDS ARROW}": ("->", _BOND),
    "==>": ("=>", _VECTOR_BOND),
    "<=>": ("=>", _VECTOR_BOND),
    "\N{RIGHTWARDS DOUBLE ARROW}": ("=>", _VECTOR_BOND),
    "\N{MINUS SIGN}": ("-", "write `-`"),
    "\N{EN DASH}": ("-", "write `-`"),
    "\N{MULTIPLICATION SIGN}": ("*", "write `*`"),
    "\N{MIDDLE DOT}": ("*", "write `*`"),
    "\N{NOT EQUAL TO}": ("<>", "write `<>`"),
    "\N{LESS-THAN OR EQUAL TO}": ("<=", "write `<=`"),
    "\N{GREATER-THAN OR EQUAL TO}": (">=", "write `>=`"),
}
"""Signs of other languages: what they mean here, and what to say."""

SIGNS_AFTER_NAMES = frozenset(["=", ".", "[", ":", ";", ",", "->", "=>", "->|", "=>|", "|->", "|=>"])
"""What may follow a name that starts a statement: then it is no word of another language."""


def unclosed_text(trouble: Trouble, machine: Machine) -> bool | None:
    """A string or a comment runs to the end of the text."""
    kind, text, _ = machine.token
    if kind != "UNCLOSED":
        return None
    what = "string" if text == '"' else "comment"
    long = first_long_string(machine) if text == '"' else None
    others = [(long, "or is the quote missing that closes this string, which runs over several lines?")] if long else []
    helps = ['a string ends with `"`'] if text == '"' else ["a comment `/*` ends with `*/`"]
    trouble.add(
        errors.UNCLOSED_TEXT, f"this {what} is not closed", token_span(machine), f"the {what} starts here", others=others, helps=helps
    )
    return False


def string_over_lines(trouble: Trouble, machine: Machine) -> bool | None:
    """An error right after a string of several lines: its closing quote is missing. What follows its first line is read anew."""
    tokens, index = machine.tokens, machine.index
    if index < 1 or tokens.kinds[index - 1] != "STRING" or "\n" not in tokens.texts[index - 1] or trouble.relexed > 20:
        return None
    start = tokens.starts[index - 1]
    first = tokens.texts[index - 1].split("\n", 1)[0]
    trouble.relexed += 1
    trouble.add(
        errors.UNCLOSED_TEXT,
        "this string is not closed on its line",
        Span(machine.source, start, start + len(first.rstrip())),
        "the string starts here",
        others=[(token_span(machine), "so this is where its text would end")],
        helps=['a string ends with `"`'],
    )
    again = tokenize(machine.source.text, start + len(first))
    tokens.comments[:] = [c for c in tokens.comments if c[0] < start] + again.comments
    tokens.kinds[index:], tokens.texts[index:], tokens.starts[index:] = again.kinds, again.texts, again.starts
    machine.pending.clear()
    machine.index = index - 1
    machine.end = start + len(first)
    machine.advance()
    if machine.accepts("SEMICOLON"):
        machine.insert(("SEMICOLON", ";", machine.end))
    return True


def foreign_sign(trouble: Trouble, machine: Machine) -> bool | None:
    """A sign that `.bg` does not have: read as what it means, where that is known."""
    kind, text, start = machine.token
    if kind not in ("FOREIGN", "BAD"):
        return None
    if text == "#":
        return hash_comment(trouble, machine)
    if text == "'":
        return single_quotes(trouble, machine)
    if kind == "BAD" and text.isalpha():
        return foreign_letter(trouble, machine)
    meant = FOREIGN_SIGNS.get(text)
    shown = text if text.isprintable() else f"U+{ord(text):04X}"
    if meant is None:
        trouble.add(errors.FOREIGN, f"`.bg` has no sign `{shown}`", token_span(machine), "not known")
        machine.advance()
        return True
    sign, why = meant
    trouble.add(errors.FOREIGN, f"`.bg` has no sign `{shown}`", token_span(machine), why)
    machine.token = (machine.table.words.get(sign) or machine.table.signs[sign], sign, start)
    return True


def hash_comment(trouble: Trouble, machine: Machine) -> bool:
    """`# ...`: left out to the end of the line."""
    line_end = end_of_line(machine, machine.token[2])
    trouble.add(errors.FOREIGN, "a comment starts with `//`, not `#`", token_span(machine), "write `//`")
    while machine.token[0] != "$END" and machine.token[2] < line_end:
        machine.advance()
    return True


def single_quotes(trouble: Trouble, machine: Machine) -> bool:
    """`'...'`: read as a string."""
    start = machine.token[2]
    line_end = end_of_line(machine, start)
    close = machine.source.text.find("'", start + 1, line_end)
    end = close + 1 if close >= 0 else start + 1
    trouble.add(errors.FOREIGN, "a string stands in double quotes", Span(machine.source, start, end), 'write `"..."`')
    while machine.token[0] != "$END" and machine.token[2] < end:
        machine.advance()
    if close >= 0:
        machine.insert(("STRING", f'"{machine.source.text[start + 1 : close]}"', start))
    return True


def foreign_letter(trouble: Trouble, machine: Machine) -> bool:
    """A letter that is none of A to Z: the whole name is read as one."""
    text, start = machine.source.text, machine.token[2]
    begin, end = start, start
    while begin > 0 and (text[begin - 1].isalnum() or text[begin - 1] == "_"):
        begin -= 1
    while end < len(text) and (text[end].isalnum() or text[end] == "_"):
        end += 1
    trouble.add(
        errors.FOREIGN,
        f"`{text[begin:end]}` is no name",
        Span(machine.source, begin, end),
        f"`{machine.token[1]}` may not stand in a name",
        notes=["a name is made of the letters A to Z and a to z, digits and `_`"],
    )
    while machine.token[0] != "$END" and machine.token[2] < end:
        machine.advance()
    if begin == start:
        machine.insert(("NAME", text[begin:end], start))
    return True


def when_clause(trouble: Trouble, machine: Machine) -> bool | None:
    """Modelica's `when ... end when;`: left out as a whole, wherever a statement may stand."""
    where = statement_start(machine)
    kinds, texts, starts = machine.tokens.kinds, machine.tokens.texts, machine.tokens.starts
    if where is None or texts[where[1]] != "when" or texts[where[1] + 1] in SIGNS_AFTER_NAMES:
        return None
    first = where[1]
    then = next(i for i in range(first, len(kinds)) if kinds[i] in ("THEN", "SEMICOLON", "$END"))
    end = next((i for i in range(then, len(kinds) - 1) if kinds[i] == "END" and texts[i + 1] == "when"), None)
    if kinds[then] != "THEN" and end is None:
        return None
    trouble.add(
        errors.UNEXPECTED,
        "`.bg` has no `when`",
        Span(machine.source, starts[first], starts[first] + len("when")),
        "equations hold at all times",
        notes=["a run stops exactly where a condition in an expression changes"],
        helps=[
            "a value that changes with a condition is written `x = if condition then a else b;`",
            'a condition that has to hold is written `assert(condition, "message");`',
        ],
    )
    machine.rewind(*where)
    stop = then if end is None else end + 1
    while machine.index <= stop and machine.token[0] != "$END":
        machine.advance()
    if end is not None and machine.token[0] == "SEMICOLON":
        machine.advance()
    return resume(machine, inner_only=False)
