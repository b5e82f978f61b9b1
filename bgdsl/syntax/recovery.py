"""What happens at a token that does not fit: say what is wrong in the words of somebody who knows the usual causes, and go on.

Each repair looks for one usual mistake; it reports it and changes the machine's next tokens to what was meant, so that the
parse goes on as if the text were right. Where none knows the mistake, what was found and what could stand there is said,
and the statement is dropped: the parse goes on after its `;`. Every repair either moves on in the text or inserts a token
that the machine takes together with the one after it, so the work stays linear.
"""

from __future__ import annotations

from collections.abc import Callable

from bgdsl.diagnostics import Reporter
from bgdsl.source import Span
from bgdsl.syntax import errors
from bgdsl.syntax.lexer import tokenize
from bgdsl.syntax.limits import MAX_DEPTH
from bgdsl.syntax.machine import MAX_STACK, Machine
from bgdsl.syntax.resync import reopen, resynchronize
from bgdsl.syntax.situation import (
    CLOSING,
    DEFINERS,
    OPENING,
    after_last,
    closest,
    container,
    end_of_line,
    first_long_string,
    looks_new,
    new_line,
    open_bracket,
    open_construct,
    outer_constructs,
    starts_line,
    statement_start,
    token_span,
    usual_cause,
    word_kind,
)

MAX_ERRORS = 50
"""After so many errors the rest of the text is not read: it is no `.bg`."""

MAX_REPAIRS = 8
"""How many repairs may be tried at one token before the statement is dropped."""


BUILT_IN_TYPES = ("Real", "Integer", "Boolean", "String", "Table")

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


class Recovery:
    """Recovers the parse of one text; an instance is the machine's `recover`."""

    def __init__(self, report: Reporter):
        self.report = report
        self.errors = 0
        self.relexed = 0
        self.closed_at = -1
        self.stuck = (-1, 0)
        self.said: set[tuple[str, int]] = set()

    def __call__(self, machine: Machine) -> bool:
        """Go on after an error; False when there is no use in going on."""
        if len(machine.states) > MAX_STACK:
            return self.too_deep(machine)
        machine.settle()
        start = machine.token[2]
        self.stuck = (start, self.stuck[1] + 1 if self.stuck[0] == start else 0)
        for repair in REPAIRS if self.stuck[1] < MAX_REPAIRS else ():
            done = repair(self, machine)
            if done is not None:
                return done and self.errors <= MAX_ERRORS
        self.general(machine)
        return self.errors <= MAX_ERRORS and resynchronize(machine)

    def add(self, *arguments: object, **more: object) -> None:
        self.errors += 1
        if self.errors > MAX_ERRORS:
            notes = [*more.get("notes", ()), f"there are more than {MAX_ERRORS} errors: the rest is not read"]  # type: ignore[misc]
            more["notes"] = notes
        self.report.add(*arguments, **more)  # type: ignore[arg-type]

    # ------------------------------------------------------------------------------------------------- the text itself

    def too_deep(self, machine: Machine) -> bool:
        self.errors += 1
        errors.too_deep(self.report, token_span(machine), MAX_DEPTH)
        return False

    def unclosed_text(self, machine: Machine) -> bool | None:
        kind, text, _ = machine.token
        if kind != "UNCLOSED":
            return None
        what = "string" if text == '"' else "comment"
        long = first_long_string(machine) if text == '"' else None
        others = [(long, "or is the quote missing that closes this string, which runs over several lines?")] if long else []
        helps = ['a string ends with `"`'] if text == '"' else ["a comment `/*` ends with `*/`"]
        self.add(
            errors.UNCLOSED_TEXT, f"this {what} is not closed", token_span(machine), f"the {what} starts here", others=others, helps=helps
        )
        return False

    def string_over_lines(self, machine: Machine) -> bool | None:
        """An error right after a string of several lines: its closing quote is missing. What follows its first line is read anew."""
        tokens, index = machine.tokens, machine.index
        if index < 1 or tokens.kinds[index - 1] != "STRING" or "\n" not in tokens.texts[index - 1] or self.relexed > 20:
            return None
        start = tokens.starts[index - 1]
        first = tokens.texts[index - 1].split("\n", 1)[0]
        self.relexed += 1
        self.add(
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

    def foreign_sign(self, machine: Machine) -> bool | None:
        kind, text, start = machine.token
        if kind not in ("FOREIGN", "BAD"):
            return None
        if text == "#":
            return self.hash_comment(machine)
        if text == "'":
            return self.single_quotes(machine)
        if kind == "BAD" and text.isalpha():
            return self.foreign_letter(machine)
        meant = FOREIGN_SIGNS.get(text)
        shown = text if text.isprintable() else f"U+{ord(text):04X}"
        if meant is None:
            self.add(errors.FOREIGN, f"`.bg` has no sign `{shown}`", token_span(machine), "not known")
            machine.advance()
            return True
        sign, why = meant
        self.add(errors.FOREIGN, f"`.bg` has no sign `{shown}`", token_span(machine), why)
        machine.token = (machine.table.words.get(sign) or machine.table.signs[sign], sign, start)
        return True

    def hash_comment(self, machine: Machine) -> bool:
        line_end = end_of_line(machine, machine.token[2])
        self.add(errors.FOREIGN, "a comment starts with `//`, not `#`", token_span(machine), "write `//`")
        while machine.token[0] != "$END" and machine.token[2] < line_end:
            machine.advance()
        return True

    def single_quotes(self, machine: Machine) -> bool:
        start = machine.token[2]
        line_end = end_of_line(machine, start)
        close = machine.source.text.find("'", start + 1, line_end)
        end = close + 1 if close >= 0 else start + 1
        self.add(errors.FOREIGN, "a string stands in double quotes", Span(machine.source, start, end), 'write `"..."`')
        while machine.token[0] != "$END" and machine.token[2] < end:
            machine.advance()
        if close >= 0:
            machine.insert(("STRING", f'"{machine.source.text[start + 1 : close]}"', start))
        return True

    def foreign_letter(self, machine: Machine) -> bool:
        text, start = machine.source.text, machine.token[2]
        begin, end = start, start
        while begin > 0 and (text[begin - 1].isalnum() or text[begin - 1] == "_"):
            begin -= 1
        while end < len(text) and (text[end].isalnum() or text[end] == "_"):
            end += 1
        self.add(
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

    # ----------------------------------------------------------------------------------------------- words and signs

    def number_into_name(self, machine: Machine) -> bool | None:
        kind, text, start = machine.token
        before = machine.index - 1
        if kind != "NAME" or before < 0 or start != machine.end or machine.tokens.kinds[before] != "NUMBER":
            return None
        number = machine.tokens.texts[before]
        helps = [f"write `{number}*{text}`"] if not machine.accepts("NAME") else []
        self.add(
            errors.UNEXPECTED,
            f"the number `{number}` runs into the name `{text}`",
            Span(machine.source, machine.tokens.starts[before], start + len(text)),
            "neither a number nor a name",
            helps=helps,
        )
        return resynchronize(machine)

    def misspelt(self, machine: Machine) -> bool | None:
        """A name where only keywords fit, or a statement that starts with a word much like a keyword."""
        kind, text, _ = machine.token
        if kind == "NAME":
            expected = machine.expected()
            words = {word: k for word, k in machine.table.words.items() if k in expected}
            close = closest(text, words)
            if close:
                self.say_misspelt(text, close, token_span(machine))
                machine.replace(words[close], close)
                return True
        return self.misspelt_start(machine)

    def misspelt_start(self, machine: Machine) -> bool | None:
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
        self.say_misspelt(text, close, token_span(machine))
        machine.tokens.kinds[index] = words[close]
        machine.replace(words[close], close)
        return True

    def say_misspelt(self, text: str, word: str, span: Span) -> None:
        self.add(errors.MISSPELT, f"`{text}` is not a keyword", span, f"did you mean `{word}`?")

    def wrong_equals(self, machine: Machine) -> bool | None:
        kind, text, _ = machine.token
        where = statement_start(machine)
        if text == "=" and where and not machine.pending and "IF" in machine.symbols()[where[0] :] and not machine.accepts("EQUAL"):
            self.add(errors.WRONG_EQUALS, "`=` does not compare", token_span(machine), "write `==`")
            machine.tokens.kinds[machine.index], machine.tokens.texts[machine.index] = "RELATION", "=="
            machine.rewind(*where)
        elif text == ":=" and machine.accepts("EQUAL"):
            self.add(errors.WRONG_EQUALS, "`:=` stands only in the `algorithm` of a function", token_span(machine), "write `=`")
            machine.replace("EQUAL", "=")
        elif text == "==" and machine.accepts("EQUAL"):
            self.add(errors.WRONG_EQUALS, "`==` only compares", token_span(machine), "write `=`")
            machine.replace("EQUAL", "=")
        elif text == "=>" and kind != "RELATION" and machine.accepts("RELATION"):
            self.add(errors.WRONG_EQUALS, "`=>` is a bond, not a comparison", token_span(machine), "write `>=`")
            machine.replace("RELATION", ">=")
        else:
            return None
        return True

    def missing_word(self, machine: Machine) -> bool | None:
        """`for ...` without `loop`, `if ...` without `then`."""
        kind, _, start = machine.token
        for word in ("loop", "then"):
            if kind not in ("SEMICOLON", "$END") and machine.accepts(word.upper(), kind):
                opening = "for" if word == "loop" else "if"
                where = next(
                    (b for s, b in reversed(list(zip(machine.symbols(), machine.begins, strict=True))) if s == opening.upper()), None
                )
                others = [] if where is None else [(Span(machine.source, where, where + len(opening)), f"of this `{opening}`")]
                self.add(errors.UNEXPECTED, f"`{word}` is missing", after_last(machine), f"write `{word}` here", others=others)
                machine.insert((word.upper(), word, start))
                return True
        return None

    # ------------------------------------------------------------------------------------------------------- brackets

    def brackets(self, machine: Machine) -> bool | None:
        """The innermost open bracket is not closed, or is closed by another."""
        opened = open_bracket(machine)
        kind, text, start = machine.token
        if opened is None:
            return self.extra_bracket(machine)
        symbol, at = opened
        closing, sign = CLOSING[symbol]
        opening = Span(machine.source, at, at + 1)
        after = machine.tokens.kinds[machine.index + 1] if not machine.pending and kind != "$END" else "$END"
        if kind in OPENING and machine.accepts(closing) and not machine.accepts(closing, kind, after):
            message = f"`{text}` does not close `{opening.text}`"
            self.add(errors.UNCLOSED_BRACKET, message, token_span(machine), f"should be `{sign}`", others=[(opening, "opened here")])
            machine.replace(closing, sign)
            return True
        ends = kind in (*OPENING, "SEMICOLON", "$END", "EQUATION", "INITIAL_EQUATION", "END", "THEN", "LOOP") or (
            new_line(machine) and kind == "NAME"
        )
        if not ends or not machine.accepts(closing):
            return None
        message = f"this `{opening.text}` is not closed"
        self.add(
            errors.UNCLOSED_BRACKET, message, opening, "opened here", others=[(after_last(machine), f"`{sign}` is missing here, or before")]
        )
        machine.insert((closing, sign, start))
        return True

    def extra_bracket(self, machine: Machine) -> bool | None:
        kind, text, _ = machine.token
        if kind not in OPENING:
            return None
        self.add(errors.UNCLOSED_BRACKET, f"this `{text}` closes nothing", token_span(machine), "no bracket is open here")
        machine.advance()
        return True

    # ------------------------------------------------------------------------------------------------------------ ends

    def wrong_end(self, machine: Machine) -> bool | None:
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
            self.add(errors.MISSING_END, f"`{wanted};` is missing", end, f"this closes what stands around the `{word}`",
                     others=[(opening, f"this `{word}` is still open")])  # fmt: skip
            machine.insert((word.upper(), word, start), ("SEMICOLON", ";", start), ("END", "end", start))
            return True
        if kind in ("FOR", "IF") and word not in ("for", "if"):
            self.add(errors.END_MISMATCH, f"`{end.text};` closes nothing", end, f"no `{text}` is open here")
        else:
            message = "`end` is not enough here" if text == ";" else f"`{end.text}` does not fit here"
            others = [(opening, f"this closes the `{word}` that starts here")]
            self.add(errors.END_MISMATCH, message, end, f"should be `{wanted};`", others=others)
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

    def missing_end(self, machine: Machine) -> bool | None:
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
        if self.closed_at != start:
            self.add(
                errors.MISSING_END,
                f"`{wanted};` is missing",
                opening,
                f"this `{word}` is not closed",
                others=[(token_span(machine) if kind != "$END" else after_last(machine), f"`{wanted};` should stand before this")],
            )
        self.closed_at = start
        machine.insert(*closing)
        return True

    def missing_semicolon(self, machine: Machine) -> bool | None:
        kind = machine.token[0]
        if open_bracket(machine) or kind in ("SEMICOLON", "$END") or not machine.accepts("SEMICOLON", kind):
            return None
        if not new_line(machine) and kind not in ("END", "EQUATION", "INITIAL_EQUATION", "ALGORITHM") and not looks_new(machine):
            return None
        self.add(
            errors.MISSING_SEMICOLON,
            "a `;` is missing",
            after_last(machine),
            "expected `;` here",
            others=[(token_span(machine), "before this")],
        )
        machine.insert(("SEMICOLON", ";", machine.end))
        return True

    def reserved_name(self, machine: Machine) -> bool | None:
        """A reserved word where only a name fits."""
        kind, text, _ = machine.token
        reserved = machine.table.words.get(text) == kind or kind == "END_INDEX"
        if not reserved or kind in ("END", "EQUATION") or machine.expected() - {"DOT", "LSQB"} != {"NAME"}:
            return None
        self.add(errors.UNEXPECTED, f"`{text}` is a keyword and cannot be a name", token_span(machine), "choose another name")
        machine.replace("NAME", text)
        return True

    def missing_section(self, machine: Machine) -> bool | None:
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
        self.add(errors.UNEXPECTED, f"{what} stand in the `equation` section", first, "this stands among the declarations",
                 helps=["write `equation` before the first of them"])  # fmt: skip
        machine.insert(section)
        return True

    # ---------------------------------------------------------------------------------------------------- anything else

    def general(self, machine: Machine) -> None:
        kind, text, _ = machine.token
        said = errors.wanted(machine.expected(), machine.table.shown)
        found = errors.found(kind, text)
        cause = usual_cause(machine)
        if cause and cause.startswith("declarations"):  # say it once for each section
            where = statement_start(machine)
            key = cause, machine.begins[where[0] - 1] if where else 0
            if key in self.said:
                return
            self.said.add(key)
        if cause:
            self.add(errors.UNEXPECTED, cause, token_span(machine), f"{found} is not expected here", notes=[f"expected {said}"])
        else:
            self.add(errors.UNEXPECTED, f"expected {said}, found {found}", token_span(machine), "not expected here")


Repair = Callable[[Recovery, Machine], bool | None]
REPAIRS: tuple[Repair, ...] = (
    Recovery.unclosed_text,
    Recovery.string_over_lines,
    Recovery.foreign_sign,
    Recovery.number_into_name,
    Recovery.wrong_equals,
    Recovery.misspelt,
    Recovery.wrong_end,
    Recovery.missing_word,
    Recovery.brackets,
    Recovery.missing_end,
    Recovery.missing_section,
    Recovery.missing_semicolon,
    Recovery.reserved_name,
)
