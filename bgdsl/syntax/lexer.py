"""Text to tokens, in one pass over the text; keywords and signs come from the grammar.

A token is a place in three parallel lists: kind (the grammar's terminal), text, start. Whitespace is dropped and comments
are put aside. Signs of other languages (`!=`, `&&`, `:=` ...) and characters that stand for nothing become tokens of
kind `FOREIGN` and `BAD`, which no grammar state accepts: the parser reports them where it meets them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from bgdsl.syntax.tables import tables

RESERVED = frozenset(["and", "or", "not", "if", "then", "elseif", "else", "for", "loop", "end", "equation", "true", "false"])
"""Words that are never names; every other keyword is a name wherever the grammar does not ask for it."""

FOREIGN_SIGNS = ("!=", "&&", "||", "**", "===", "~=", "!", "<-", "==>", "-->", "&", "#", "'", "<->", "<=>", "++", "--", "+=", "-=", "*=")


@dataclass(slots=True)
class Tokens:
    """The last token is `$END`, at the end of the text."""

    kinds: list[str]
    texts: list[str]
    starts: list[int]
    comments: list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Lexer:
    """The one expression that finds every token, and what its groups mean."""

    pattern: re.Pattern[str]
    words: dict[str, str]
    signs: dict[str, str]


@cache
def lexer() -> Lexer:
    """The lexer of the grammar."""
    known = tables()
    alternatives = [f"(?P<{name}>{regexp})" for name, regexp in known.patterns if name != "COMMENT"]
    comment = next(regexp for name, regexp in known.patterns if name == "COMMENT")
    foreign = [sign for sign in FOREIGN_SIGNS if sign not in known.signs]
    # The longest sign first; the foreign ones that are also the start of two signs in a row (`x--y`) are left out there.
    signs = sorted([*known.signs, *(s for s in foreign if s not in ("--", "++", "<-"))], key=len, reverse=True)
    alternatives += [
        f"(?P<COMMENT>{comment})",
        '(?P<UNCLOSED>/\\*|")',
        f"(?P<SIGN>{'|'.join(re.escape(sign) for sign in signs)})",
        r"(?P<BAD>\S)",
    ]
    table = dict.fromkeys(foreign, "FOREIGN") | known.signs
    return Lexer(re.compile("[\\s\ufeff]*(?:" + "|".join(alternatives) + ")"), known.words, table)


def tokenize(text: str, position: int = 0) -> Tokens:
    """All tokens of a text from a position on; never fails, and takes time linear in the text."""
    scanner = lexer()
    words, signs = scanner.words, scanner.signs
    kinds: list[str] = []
    texts: list[str] = []
    starts: list[int] = []
    comments: list[tuple[int, int]] = []
    for match in scanner.pattern.finditer(text, position):
        kind = match.lastgroup
        assert kind is not None
        start, end = match.span(kind)
        word = text[start:end]
        if kind == "NAME":
            kind = words.get(word, kind)
        elif kind == "SIGN":
            kind = signs[word]
        elif kind == "COMMENT":
            comments.append((start, end))
            continue
        kinds.append(kind)
        texts.append(word)
        starts.append(start)
        if kind == "UNCLOSED":  # a comment or string that is not closed takes the rest of the text
            break
    kinds.append("$END")
    texts.append("")
    starts.append(len(text))
    return Tokens(kinds, texts, starts, comments)
