"""How long reading takes a line, from a thousand lines to a hundred thousand: it must not grow.

    python benchmarks/parse.py [--lines 1000 10000 100000] [--format]

The lines are those of models that people write: declarations with modifications, bonds, equations and descriptions, some
twenty tokens a line. Prints microseconds a line for the lexer alone and for the whole parse (and for the formatter, which
parses three times and checks itself), and the largest memory of the process.
"""

from __future__ import annotations

import argparse
import gc
import resource
import time
from collections.abc import Callable

from bgdsl.diagnostics import Reporter
from bgdsl.source import Source
from bgdsl.syntax.formatter import format_source
from bgdsl.syntax.lexer import tokenize
from bgdsl.syntax.parser import parse

DECLARED = """\
  parameter Real m{i}(unit = "kg", min = 0) = {i}.5e3 "mass {i}";
  J1 v{i};  I mass{i}(I = m{i}, f(start = 1));  C spring{i}(k = 2*m{i} + 1);  R damper{i}(R = 3);
"""
STATED = """\
  v{i} -> mass{i}, spring{i}, damper{i};
  der(x{i}) = if on then v{i}.f*(2 + m{i}) else -cos(v{i}.f[1, 2])^2 "phase";
"""


def model(lines: int) -> str:
    """A model of so many lines."""
    count = lines // 4
    declared = "".join(DECLARED.format(i=i) for i in range(count))
    return f"model Chain\n{declared}equation\n{''.join(STATED.format(i=i) for i in range(count))}end Chain;\n"


def seconds(work: Callable[[], object]) -> float:
    gc.collect()
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--lines", type=int, nargs="*", default=[1000, 3000, 10000, 30000, 100000])
    options.add_argument("--format", action="store_true")
    given = options.parse_args()
    parse(Source("warm", model(100)), Reporter())
    print(f"{'lines':>8} {'tokens':>9} {'lexer us/line':>14} {'parse us/line':>14} {'lines/minute':>13} {'memory MB':>10}")
    for lines in given.lines:
        text = model(lines)
        report = Reporter()
        lexed = seconds(lambda text=text: tokenize(text))
        parsed = seconds(lambda text=text, report=report: parse(Source("chain.bg", text), report))
        assert not report.diagnostics
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        count = len(tokenize(text).kinds)
        print(f"{lines:8} {count:9} {lexed / lines * 1e6:14.1f} {parsed / lines * 1e6:14.1f} {lines / parsed * 60:13.0f} {memory:10.0f}")
        if given.format:
            formatted = seconds(lambda text=text: format_source(Source("chain.bg", text), Reporter()))
            print(f"{'formatter':>18} {formatted / lines * 1e6:14.1f} us/line")


if __name__ == "__main__":
    main()
