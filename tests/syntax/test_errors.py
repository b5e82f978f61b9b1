"""Syntax errors: each is found once, at its place, with its usual cause; the parse goes on after it."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Reporter, render
from bgdsl.source import Source
from bgdsl.syntax import ast
from bgdsl.syntax.formatter import format_source
from bgdsl.syntax.lexer import tokenize
from bgdsl.syntax.parser import parse, read_source
from bgdsl.syntax.printer import print_tree

HEAD = "model A\n  J1 v; Real x;\nequation\n"
ROOT = Path(__file__).parent.parent.parent

# text, then what must be found: code, line, and a part of the message
CASES: dict[str, tuple[str, list[tuple[str, int, str]]]] = {
    "three semicolons": (
        "model A\n  J1 v\n  J1 w;\nequation\n  v -> w\n  w -> v;\n  x = 3\nend A;\n",
        [("BG106", 2, "`;`"), ("BG106", 5, "`;`"), ("BG106", 7, "`;`")],
    ),
    "semicolon on the line": ("model A\n  J1 v  I m(I = 1);\nequation\n  v -> m  w -> v;\nend A;\n", [("BG106", 2, ""), ("BG106", 4, "")]),
    "end of another name": ("model A\n  J1 v;\nend B;\n", [("BG104", 3, "does not close model `A`")]),
    "no end before the next model": (
        "model A\n J1 v;\nequation\n v -> w;\n\nmodel B\n J1 v;\nend B;\n",
        [("BG114", 1, "`end A;` is missing")],
    ),
    "no end at all": (HEAD + "  v -> w;\n", [("BG114", 1, "`end A;` is missing")]),
    "no end for": (HEAD + "  for i in 1:3 loop\n   v -> w;\nend A;\n", [("BG114", 6, "`end for;` is missing")]),
    "end if for end for": (HEAD + "  for i in 1:3 loop\n   v -> w;\n  end if;\nend A;\n", [("BG104", 6, "`end if` does not fit")]),
    "stray end for": (HEAD + "   v -> w;\n  end for;\n x = 3;\nend A;\n", [("BG104", 5, "`end for;` closes nothing")]),
    "bare end": (HEAD + "   v -> w;\nend;\n", [("BG104", 5, "not enough")]),
    "end test": ('test "x"\n assert 1 == 1;\nend test;\n', [("BG104", 3, "`end test` does not fit")]),
    "open parenthesis": ("model A\n  J1 v(a = (1 + 2);\n  J1 w;\nend A;\n", [("BG105", 2, "this `(` is not closed")]),
    "open brace": ("model A\n  J1 v(a = {1, 2);\n  J1 w;\nend A;\n", [("BG105", 2, "this `{` is not closed")]),
    "extra parenthesis": ("model A\n  J1 v(a = 1));\n  J1 w;\nend A;\n", [("BG105", 2, "this `)` closes nothing")]),
    "equals signs": (
        "model A\n  R r(R == 3);\n J1 b if a = 3;\nequation\n x == 3;\n y := 4;\n"
        " if n = 2 then x = 1; end if; z = if a => b then 1 else 2;\nend A;\n",
        [("BG115", 2, "`==`"), ("BG115", 3, "`=`"), ("BG115", 5, "`=`"), ("BG115", 6, "`:=`"), ("BG115", 7, "`=`"), ("BG115", 7, "`=>`")],
    ),
    "foreign signs": (
        "model A\n # comment here\n R r(R = a**2) if a != 3 && b;\n"
        " String s = 'abc';\n Real größe = 3;\n Real b$ = 3;\n"
        "equation\n v --> w;\n x += 3; \nend A;\n",
        [
            ("BG102", n, s)
            for n, s in ((2, "`//`"), (3, "`**`"), (3, "`!=`"), (3, "`&&`"), (4, "double"), (5, "größe"), (6, "$"), (8, "-->"), (9, "+="))
        ],
    ),
    "misspelt": (
        "modle A\n  paramter Real x = 3;\n  ouput Real y;\nequatoin\n  v -> w;\n fro i in 1:3 loop x = 3; end fro;\nend A;\n",
        [("BG113", n, w) for n, w in ((1, "modle"), (2, "paramter"), (3, "ouput"), (4, "equatoin"), (6, "fro"), (6, "fro"))],
    ),
    "redeclarations": (
        "model A\n redelcare X a;\n redeclare X;\n redeclare X a[1], a[2];\n redeclare X a = 2;\n final redeclare X a;\n"
        " redeclare output X a;\n redeclare X a[1]\n Real x;\nequation\n redeclare X a;\nend A;\n",
        [
            ("BG113", 2, "redelcare"),
            ("BG101", 3, "a redeclaration is"),
            ("BG101", 4, "one statement for each"),
            ("BG101", 5, "a redeclaration is"),
            ("BG101", 6, "`final` stands after"),
            ("BG101", 7, "cannot make it `output`"),
            ("BG106", 8, "`;`"),
            ("BG101", 11, "declarations stand before"),
        ],
    ),
    "when": (
        "model A\n when a > 1 then\n  x = 2;\n end when;\n Real when = 1;\nequation\n"
        " when {a, b} then\n  reinit(x, 2);\n  if c then x = 2; end if;\n elsewhen c then\n  x = 3;\n end when;\n"
        " when time > 3\n  x = 2;\n end when;\n x = when;\n v - > w;\nend A;\n",
        [("BG101", 2, "no `when`"), ("BG101", 7, "no `when`"), ("BG101", 13, "no `when`"), ("BG101", 17, "")],
    ),
    "loop and then": (
        HEAD + "  for i in 1:3\n    v -> w;\n  end for;\n  if a\n x = 3;\n end if;\n for j = 1:3 loop\n y = 3;\n end for;\nend A;\n",
        [("BG101", 4, "`loop` is missing"), ("BG101", 7, "`then` is missing"), ("BG101", 10, "expected `in`")],
    ),
    "late declarations": (
        HEAD + " v -> w;\n parameter Real x = 3;\n Real y;\n w -> v;\nend A;\n",
        [("BG101", 5, "declarations stand before `equation`")],
    ),
    "early statements": (
        "model A\n J1 v;\n v -> w;\n x = 3;\n der(x) = 4;\nend A;\n",
        [("BG101", 3, "bonds stand in the `equation` section")],
    ),
    "a fan is last": (HEAD + " v -> w, x -> y;\nend A;\n", [("BG101", 4, "only the last end of a chain may be a list")]),
    "expressions": (
        HEAD + " x = a^b^c;\n x = a < b < c;\n y = 3 % 2;\n"
        " z = if a then b;\n w = 2x;\n q = .5;\n r = 3 + ;\n s = f(a = 1, 2);\n x[1;\n x + 3;\nend A;\n",
        [
            ("BG101", 4, "powers do not chain"),
            ("BG101", 5, "comparisons do not chain"),
            ("BG101", 6, "`mod(a, b)`"),
            ("BG101", 7, "needs its `else`"),
            ("BG101", 8, "the number `2` runs into the name `x`"),
            ("BG101", 9, "`0.5`"),
            ("BG101", 10, "expected an expression, found `;`"),
            ("BG111", 11, "follows `a = ...`"),
            ("BG105", 12, "`[`"),
            ("BG110", 13, "no statement"),
        ],
    ),
    "modifications": (
        "model A\n R r(3);\n R q(R);\n R s(a b);\n Real end;\nend A;\n",
        [("BG101", 2, "`name = value`"), ("BG101", 3, "`name = value`"), ("BG101", 4, "`name = value`"), ("BG101", 5, "`end`")],
    ),
    "a quote is missing": ('model A\n J1 v "abc;\n J1 w "def";\nequation\n x = 3;\nend A;\n', [("BG103", 2, "not closed on its line")]),
    "open string": ('model A\n J1 v "abc;\n J1 w;\nend A;\n', [("BG103", 2, "string")]),
    "open comment": ("model A\n J1 v; /* abc;\n J1 w;\nend A;\n", [("BG103", 2, "comment")]),
    "a test": (
        'model A end A;\ntest "x"\n run r = A(a = 1) fro 10;\n run x = A("abc");\n assert x < 3 %;\n expect BG401 in M;\nend;\n',
        [("BG116", 3, "`fro`"), ("BG101", 4, "not a string"), ("BG101", 5, "`%`"), ("BG101", 6, "expected `error`")],
    ),
    "no reduction": ("model A\n Real x = foo(i for i in 1:3);\nend A;\n", [("BG112", 2, "`foo`")]),
}


def errors_of(text: str) -> tuple[ast.File, Reporter]:
    report = Reporter()
    return parse(Source("case.bg", text), report), report


@pytest.mark.parametrize("name", CASES)
def test_each_error_is_found_once_and_at_its_place(name: str) -> None:
    text, wanted = CASES[name]
    _, report = errors_of(text)
    found = sorted(((d.code.number, d.primary.span.line, d.message) for d in report.diagnostics), key=lambda e: e[1])
    shown = render(report.diagnostics)
    assert [(code, line) for code, line, _ in found] == [(code, line) for code, line, _ in wanted], shown
    for (_, _, message), (_, _, part) in zip(found, wanted, strict=True):
        assert part in message or part in shown, shown


def test_what_stands_beside_an_error_is_in_the_tree() -> None:
    tree, report = errors_of("model A\n  J1 v;\n  R r(3);\n  I m(I = 1);\nend A;\nmodel B end B;\n")
    assert len(report.errors) == 1
    first, second = tree.items
    assert isinstance(first, ast.Model)
    assert isinstance(second, ast.Model)
    assert [item.declarators[0].name for item in first.items if isinstance(item, ast.Declaration)] == ["v", "m"]


def good_text() -> str:
    files = [*sorted((ROOT / "models").glob("lever*.bg")), *sorted((ROOT / "bgdsl/library").rglob("rigid.bg"))]
    return "\n".join(path.read_text("utf-8") for path in files) + "\nfunction f(x) = x;\n"


def test_one_dropped_token_gives_few_errors() -> None:
    """No cascades: of all texts with one token missing, nine in ten have at most one error, and hardly one has more than three."""
    text = good_text()
    tokens = tokenize(text)
    rng = random.Random(1)
    counts = []
    for index in rng.sample(range(len(tokens.starts) - 1), 150):
        start = tokens.starts[index]
        _, report = errors_of(text[:start] + " " + text[start + len(tokens.texts[index]) :])
        counts.append(len(report.errors))
    assert sum(count <= 1 for count in counts) >= 0.9 * len(counts), counts
    assert sum(count > 3 for count in counts) <= 0.03 * len(counts), counts


def test_any_text_gives_diagnostics_only() -> None:
    text = good_text()
    rng = random.Random(2)
    pieces = re.split(r"(?<=\W)|(?=\W)", text)
    for _ in range(60):
        count = len(pieces)
        mutated = list(pieces)
        for _ in range(rng.randrange(1, 6)):
            mutated[rng.randrange(count)] = rng.choice(pieces)
        junk = "".join(chr(rng.choice([rng.randrange(1, 127), rng.randrange(0x2FFF)])) for _ in range(200))
        for wrong in ("".join(mutated)[:6000], text[: rng.randrange(len(text))], junk):
            render(errors_of(wrong)[1].diagnostics)


DEEP = {
    "parentheses": "model A equation x = " + "(" * 10000 + "1" + ")" * 10000 + "; end A;",
    "powers of sums": "model A equation x = " + "(" * 5000 + "1" + "+1)^2" * 5000 + "; end A;",
    "sums of products": "model A equation x = " + "(" * 5000 + "1" + "+1)*2" * 5000 + "; end A;",
    "signs": "model A equation x = " + "-" * 10000 + "1; end A;",
    "ifs": "model A equation x = " + "if a then 1 else " * 5000 + "1; end A;",
    "subscripts": "model A equation x = f(1)" + "[1]" * 5000 + "; end A;",
    "loops": "model A equation " + "for i in 1:3 loop " * 3000 + "end for; " * 3000 + "end A;",
    "models": "model A " * 3000,
    "modifications": "model A R r" + "(a" * 3000 + "= 1" + ")" * 3000 + "; end A;",
    "mixed": "model A equation x = " + "(" * 150 + "1" + "+1)*2" * 150 + "; end A;",
}


@pytest.mark.parametrize("name", DEEP)
def test_deep_nesting_is_refused(name: str) -> None:
    _, report = errors_of(DEEP[name])
    assert "BG107" in {d.code.number for d in report.diagnostics}
    assert len(report.errors) <= 2
    assert len(render(report.diagnostics)) < 5000


@pytest.mark.parametrize("sign", [" + ", " - ", "*", " and ", " or ", " .+ "])
def test_what_is_written_in_a_row_is_not_deep(sign: str) -> None:
    text = f"model A\nequation\n  x = {sign.join(['a[1]', *'bc', '2'] * 1500)};\nend A;\n"
    tree, report = errors_of(text)
    assert not report.errors
    assert errors_of(print_tree(tree))[0] == tree
    assert errors_of(text.replace("2;", "3;"))[0] != tree
    laid_out = format_source(Source("case.bg", text), Reporter())
    assert format_source(Source("case.bg", laid_out), Reporter()) == laid_out


def test_a_row_of_many_terms_has_their_value() -> None:
    terms = " + ".join(f"{i}*k - 1" for i in range(1, 1001))
    model = pipeline.loads(f"model A\n  parameter Real k = 2;\n  parameter Real all = {terms};\nend A;\n")
    assert model.compile().parameters["all"] == 1000 * 1001 - 1000


def test_a_text_that_is_no_model_is_given_up() -> None:
    _, report = errors_of("model A\n" + " R r(3);\n" * 500 + "end A;")
    assert 50 <= len(report.errors) <= 52
    assert "the rest is not read" in report.errors[-1].notes[-1]


@pytest.mark.parametrize(
    ("content", "part"),
    [(None, "no file"), (b"model A\xff end A;", "not UTF-8"), (b"model A \0 end A;", "not text"), ("folder", "a folder")],
)
def test_files_that_cannot_be_read(content: bytes | str | None, part: str, tmp_path: Path) -> None:
    path = tmp_path / "model.bg"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "folder":
        path.mkdir()
    with pytest.raises(BgError) as caught:
        read_source(path, Reporter())
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.number == "BG108"
    assert part in diagnostic.message


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "model.bg"
    path.write_bytes("\ufeffmodel A end A;".encode())
    assert read_source(path, Reporter()).text == "model A end A;"
