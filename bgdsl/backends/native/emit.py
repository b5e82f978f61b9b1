"""One kernel as LLVM IR text: straight-line code in functions of bounded size, which pass values on through a work array.

Input        Tape
Output       Code: the text, and what its memory holds
Establishes  the function `f` of the text has the signature of `ir.native`; its operations are those of the tape, to round-off

LLVM's code generation costs more than linearly in the length of a function, so long code is cut. What several functions
read goes through the work array; what reads parameters alone is not computed here at all but found in the constants array,
which `constants.py` fills once for each parameter set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bgdsl.backends.native.elimination import Elimination
from bgdsl.backends.native.layout import Block, Function, Place, lay_out
from bgdsl.backends.native.numbers import literal
from bgdsl.backends.native.tables import table_text
from bgdsl.backends.tape import PARAMETRIC, RELATIONS, LinearSolve, NewtonSolve, Tape
from bgdsl.expr import Table

CHUNK = 400
"""Operands in one function, about."""

INFO, WARM, FIRST = 0, 1, 2
"""Places in the context (an array of pointers): what to say of a failure, the starts of iterations, then for kernel k its
constants, its work array, its factored matrices, its array and plan of elimination from FIRST + 5 k."""
POINTERS = 5

_MATHS = ("sin", "cos", "exp", "log", "log10", "sqrt")
_LIBM = ("tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")
_ROUND = {"abs": "fabs", "floor": "floor", "ceil": "ceil", "trunc": "trunc"}
_TWO = {"pow": "llvm.pow.f64", "atan2": "atan2", "min": "llvm.minimum.f64", "max": "llvm.maximum.f64"}
_COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
_ARGUMENTS = "double %t, ptr noalias %x, ptr noalias %u, ptr noalias %c, ptr noalias %w, ptr noalias %o"
_PASSED = "double %t, ptr %x, ptr %u, ptr %c, ptr %w, ptr %o"

_HEAD = "\n".join(
    (
        *(f"declare double @llvm.{name}.f64(double)" for name in (*_MATHS, *_ROUND.values())),
        *(f"declare double @{name}(double) #1" for name in _LIBM),
        *(f"declare double @{name}(double, double) #1" for name in _TWO.values()),
        "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)",
        "declare i64 @llvm.fptosi.sat.i64.f64(double)",
        "declare i64 @llvm.smax.i64(i64, i64)",
        "declare i64 @llvm.smin.i64(i64, i64)",
        "declare i32 @bg_factor(i64, ptr, ptr)",
        "declare void @bg_substitute(i64, ptr, ptr, i64, ptr)",
        "declare i32 @bg_eliminate(ptr, ptr)",
        "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
        "declare i32 @bg_newton(i64, ptr, ptr, ptr, ptr, double, ptr, ptr, ptr, ptr, ptr)",
        "attributes #0 = { nounwind noinline }",
        "attributes #1 = { nounwind willreturn memory(none) }",
        "!0 = !{}",
    )
)


@dataclass(slots=True)
class Code:
    """A kernel's text and its memory.

    size: numbers it gives. constants: the operations whose values the constants array holds. work: length of the work array.
    factors: parametric matrices, each with where its factors start in the array of factored matrices (`factor_size` numbers).
    calls_runtime: whether the text calls the routines of `runtime.py`.
    """

    text: str
    size: int
    constants: tuple[int, ...]
    work: int
    factors: tuple[tuple[LinearSolve, int], ...]
    calls_runtime: bool


def emit(tape: Tape, *, slot: int, elimination: Elimination | None = None, chunk: int = CHUNK) -> Code:
    """The kernel that gives the tape's roots, or what elimination makes of them; `slot` is its number in the context."""
    return _Emitter(tape, slot, elimination, chunk).code()


class _Emitter:
    """The text of a kernel under construction: its functions, constants and tables."""

    def __init__(self, tape: Tape, slot: int, elimination: Elimination | None, chunk: int) -> None:
        self.tape = tape
        self.slot = slot
        self.elimination = elimination
        self.layout = lay_out(tape, chunk)
        self.work = self.layout.work
        self.functions: list[str] = []
        self.tables: dict[tuple[Any, ...], tuple[str, Table, int]] = {}
        self.inverses: dict[int, int] = {}
        self.fixed = [i for i, k in enumerate(tape.roots) if tape.levels[k] == PARAMETRIC]
        self.listed = [tape.roots[i] for i in self.fixed]
        self.constants = {k: place for place, k in reversed(list(enumerate(self.listed)))}

    def code(self) -> Code:
        layout = self.layout
        lines = [line for n, part in enumerate(layout.parts) for line in self.part(n, part)]
        main = self.main(lines)
        tables = [table_text(name, table, order) for name, table, order in self.tables.values()]
        text = "\n".join((_HEAD, *tables, *self.functions, main, ""))
        size = len(self.tape.roots) if self.elimination is None else len(self.elimination.rows)
        calls = self.elimination is not None or any(isinstance(part, Block) for part in layout.parts)
        return Code(text, size, tuple(self.listed), layout.work_size, tuple(layout.factors), calls)

    def constant(self, k: int) -> int:
        """The place of a parametric value among the constants."""
        place = self.constants.get(k)
        if place is None:
            place = self.constants[k] = len(self.listed)
            self.listed.append(k)
        return place

    def inverse(self, k: int) -> int:
        """The place of one over a parametric value."""
        if k not in self.inverses:
            tape = self.tape
            self.inverses[k] = len(tape.ops)
            tape.ops.append("reciprocal")
            tape.args.append((k,))
            tape.data.append(None)
            tape.levels.append(PARAMETRIC)
        return self.constant(self.inverses[k])

    def table(self, name: str, order: int) -> str:
        """The function for a table's derivative of some order; tables with the same content share it."""
        table = self.tape.tables[name]
        key = (table.x, table.c, table.periodic, order)
        return self.tables.setdefault(key, (f"@table_{len(self.tables)}", table, order))[0]

    # --------------------------------------------------------------------------------------------- functions and main

    def part(self, n: int, part: Function | Block) -> Sequence[str]:
        """The lines of the main function that run a part."""
        if isinstance(part, Function):
            return (self.function(f"@s{n}", part),)
        block = self.tape.data[part.operation]
        return self.linear(n, part, block) if isinstance(block, LinearSolve) else self.newton(n, part, block)

    def function(self, name: str, function: Function) -> str:
        """Write a function; returned is its call."""
        body = _Lines(self)
        for k in function.members:
            body.operation(k)
        for k, place in function.stores:
            body.store(body.value(k), place)
        text = "\n".join(body.lines)
        self.functions.append(f"define internal void {name}({_ARGUMENTS}) #0 {{\nentry:\n{text}\nret void\n}}")
        return f"call void {name}({_PASSED})"

    def linear(self, n: int, part: Block, block: LinearSolve) -> Sequence[str]:
        size, (base, place) = block.size, part.matrix
        lines = [
            f"%a{n} = getelementptr inbounds double, ptr %{base}, i64 {place}",
            f"%p{n} = getelementptr inbounds double, ptr %a{n}, i64 {size * size}",
            f"%b{n} = getelementptr inbounds double, ptr %w, i64 {part.right}",
        ]
        if not block.factored:
            lines += (f"%q{n} = call i32 @bg_factor(i64 {size}, ptr %a{n}, ptr %p{n})", *_stop_if(n, block.step))
        return (*lines, f"call void @bg_substitute(i64 {size}, ptr %a{n}, ptr %p{n}, i64 1, ptr %b{n})")

    def newton(self, n: int, part: Block, block: NewtonSolve) -> Sequence[str]:
        calls = [self.function(f"@s{n}_{i}", function) for i, function in enumerate(part.body)]
        body = "\n".join(calls)
        self.functions.append(f"define internal void @s{n}({_ARGUMENTS}) #0 {{\nentry:\n{body}\nret void\n}}")
        return (
            f"%a{n} = getelementptr inbounds double, ptr %w, i64 {part.right}",
            f"%b{n} = getelementptr inbounds double, ptr %warm, i64 {block.offset}",
            f"%q{n} = call i32 @bg_newton(i64 {block.size}, ptr @s{n}, ptr %a{n}, ptr %b{n}, ptr %info, {_PASSED})",
            *_stop_if(n, block.step),
        )

    def main(self, lines: Sequence[str]) -> str:
        """`f` itself: fetch the arrays, clear the matrices, run the parts, copy the roots that are constants."""
        own = FIRST + POINTERS * self.slot
        result = "o" if self.elimination is None else "result"
        pointers = [("info", INFO), ("warm", WARM), ("c", own), ("w", own + 1), ("f", own + 2)]
        if self.elimination is not None:
            pointers += (("o", own + 3), ("plan", own + 4))
            lines = (*lines, *self.eliminate(self.elimination))
        head = [f"define i32 @f(double %t, ptr %x, ptr %u, ptr %{result}, ptr %context) #0 {{", "entry:"]
        for name, place in pointers:
            head += (f"%{name}_at = getelementptr inbounds ptr, ptr %context, i64 {place}", f"%{name} = load ptr, ptr %{name}_at, align 8")
        start, end = self.layout.matrices
        if end > start:
            head.append(f"call void @llvm.memset.p0.i64(ptr %w, i8 0, i64 {8 * end}, i1 false)")
        if self.fixed:
            self.functions.append(_scatter(self.fixed))
            head.append("call void @scatter(ptr %c, ptr %o)")
        return "\n".join((*head, *lines, "ret i32 0", "}"))

    def eliminate(self, elimination: Elimination) -> Sequence[str]:
        """The roots are in the array of elimination: clear the rest of it, follow the plan, copy the result."""
        start, count = elimination.start, len(elimination.rows)
        return (
            f"%rest = getelementptr inbounds double, ptr %o, i64 {start}",
            f"call void @llvm.memset.p0.i64(ptr %rest, i8 0, i64 {8 * (elimination.size - start)}, i1 false)",
            "%status = call i32 @bg_eliminate(ptr %o, ptr %plan)",
            f"call void @llvm.memcpy.p0.p0.i64(ptr %result, ptr %rest, i64 {8 * count}, i1 false)",
            "%solved = icmp eq i32 %status, 0",
            "br i1 %solved, label %whole, label %broken",
            "broken:",
            "ret i32 %status",
            "whole:",
        )


def _stop_if(n: int, step: int) -> Sequence[str]:
    """Leave with the step's number (from 1) if the status %q is not zero."""
    return (
        f"%r{n} = icmp eq i32 %q{n}, 0",
        f"br i1 %r{n}, label %go{n}, label %stop{n}",
        f"stop{n}:",
        f"ret i32 {step + 1}",
        f"go{n}:",
    )


def _scatter(places: Sequence[int]) -> str:
    """out[places[i]] = c[i]"""
    count = len(places)
    numbers = ", ".join(f"i32 {i}" for i in places)
    return f"""@places = private unnamed_addr constant [{count} x i32] [{numbers}]
define internal void @scatter(ptr noalias %c, ptr noalias %o) #0 {{
entry:
br label %loop
loop:
%i = phi i64 [ 0, %entry ], [ %next, %loop ]
%from = getelementptr inbounds double, ptr %c, i64 %i
%value = load double, ptr %from, align 8
%place_at = getelementptr inbounds [{count} x i32], ptr @places, i64 0, i64 %i
%place = load i32, ptr %place_at, align 4
%to = getelementptr inbounds double, ptr %o, i32 %place
store double %value, ptr %to, align 8
%next = add nuw nsw i64 %i, 1
%more = icmp ult i64 %next, {count}
br i1 %more, label %loop, label %done
done:
ret void
}}"""


class _Lines:
    """The lines of one function. `known` are values at hand as doubles, `flags` as truth values."""

    def __init__(self, owner: _Emitter) -> None:
        self.owner = owner
        self.tape = owner.tape
        self.work = owner.work
        self.stores = owner.layout.stores
        self.lines: list[str] = []
        self.last = -1
        self.known: dict[int, str] = {}
        self.flags: dict[int, str] = {}
        self.inverses: dict[int, str] = {}

    def line(self, text: str) -> str:
        """A new value."""
        self.last += 1
        self.lines.append(f"%{self.last} = {text}")
        return f"%{self.last}"

    def load(self, base: str, place: int) -> str:
        self.last += 2
        self.lines.append(
            f"%{self.last - 1} = getelementptr inbounds double, ptr {base}, i64 {place}\n"
            f"%{self.last} = load double, ptr %{self.last - 1}, align 8, !invariant.load !0"
        )
        return f"%{self.last}"

    def store(self, value: str, place: Place) -> None:
        self.last += 1
        self.lines.append(
            f"%{self.last} = getelementptr inbounds double, ptr %{place[0]}, i64 {place[1]}\n"
            f"store double {value}, ptr %{self.last}, align 8"
        )

    def value(self, k: int) -> str:
        """Operation k as a double."""
        found = self.known.get(k)
        if found is None:
            found = self.known[k] = self.fetch(k)
        return found

    def fetch(self, k: int) -> str:
        tape = self.tape
        op = tape.ops[k]
        if op == "const":
            return literal(tape.data[k])
        if k in self.flags:
            return self.line(f"uitofp i1 {self.flags[k]} to double")
        if tape.levels[k] == PARAMETRIC:
            return self.load("%c", self.owner.constant(k))
        if op == "x" or op == "u":
            return self.load(f"%{op}", tape.data[k])
        if op == "time":
            return "%t"
        return self.load("%w", self.owner.work[k])

    def flag(self, k: int) -> str:
        """Operation k as a truth value."""
        found = self.flags.get(k)
        if found is None:
            value = self.value(k)
            found = self.flags[k] = self.line(f"fcmp une double {value}, 0.0")
        return found

    def operation(self, k: int) -> None:
        """The lines that compute operation k, and those that store it where others look for it."""
        op, args = self.tape.ops[k], self.tape.args[k]
        known = self.known
        if op == "mul":
            a, b = args
            known[k] = self.line(f"fmul contract double {known.get(a) or self.value(a)}, {known.get(b) or self.value(b)}")
        elif op == "sum":
            known[k] = self.sum(args, self.tape.data[k])
        elif op in RELATIONS:
            self.flags[k] = self.relation(op, args)
        else:
            known[k] = _OTHERS.get(op, _Lines.call)(self, k, args)
        if k in self.work:
            self.store(self.value(k), ("w", self.work[k]))
        if k in self.stores:
            for place in self.stores[k]:
                self.store(self.value(k), place)

    def sum(self, args: Sequence[int], negative: Sequence[bool]) -> str:
        known, value = self.known, self.value
        first = value(args[0])
        if negative[0]:
            if not negative[1]:
                first = self.line(f"fsub contract double {value(args[1])}, {first}")
                args, negative = args[1:], negative[1:]
            else:
                first = self.line(f"fneg double {first}")
        for arg, minus in zip(args[1:], negative[1:], strict=True):
            first = self.line(f"{'fsub' if minus else 'fadd'} contract double {first}, {known.get(arg) or value(arg)}")
        return first

    def relation(self, op: str, args: Sequence[int]) -> str:
        if op == "not":
            return self.line(f"xor i1 {self.flag(args[0])}, true")
        if op in ("and", "or"):
            return self.line(f"{op} i1 {self.flag(args[0])}, {self.flag(args[1])}")
        return self.line(f"fcmp {_COMPARE[op]} double {self.value(args[0])}, {self.value(args[1])}")

    def divide(self, k: int, args: Sequence[int]) -> str:
        over, under = args
        if self.tape.levels[under] == PARAMETRIC and self.tape.ops[under] != "const":
            inverse = self.inverses.get(under)
            if inverse is None:
                inverse = self.inverses[under] = self.load("%c", self.owner.inverse(under))
            return self.line(f"fmul contract double {self.value(over)}, {inverse}")
        return self.line(f"fdiv double {self.value(over)}, {self.value(under)}")

    def choose(self, k: int, args: Sequence[int]) -> str:
        condition, yes, no = self.flag(args[0]), self.value(args[1]), self.value(args[2])
        return self.line(f"select i1 {condition}, double {yes}, double {no}")

    def sign(self, k: int, args: Sequence[int]) -> str:
        value = self.value(args[0])
        below = self.line(f"fcmp olt double {value}, 0.0")
        above = self.line(f"fcmp ogt double {value}, 0.0")
        lower = self.line(f"select i1 {below}, double -1.0, double 0.0")
        return self.line(f"select i1 {above}, double 1.0, double {lower}")

    def power(self, k: int, args: Sequence[int]) -> str:
        value = self.value(args[0])
        square = self.line(f"fmul contract double {value}, {value}")
        return square if self.tape.ops[k] == "square" else self.line(f"fmul contract double {square}, {value}")

    def reciprocal(self, k: int, args: Sequence[int]) -> str:
        return self.line(f"fdiv double 1.0, {self.value(args[0])}")

    def negate(self, k: int, args: Sequence[int]) -> str:
        return self.line(f"fneg double {self.value(args[0])}")

    def look_up(self, k: int, args: Sequence[int]) -> str:
        return self.line(f"call double {self.owner.table(*self.tape.data[k])}(double {self.value(args[0])})")

    def call(self, k: int, args: Sequence[int]) -> str:
        op = self.tape.ops[k]
        passed = ", ".join(f"double {self.value(arg)}" for arg in args)
        return self.line(f"call double @{_CALLED[op]}({passed})")


_CALLED: Mapping[str, str] = {
    **{name: f"llvm.{name}.f64" for name in _MATHS},
    **{name: f"llvm.{spelled}.f64" for name, spelled in _ROUND.items()},
    **{name: name for name in _LIBM},
    **_TWO,
}
_OTHERS: Mapping[str, Callable[[_Lines, int, Sequence[int]], str]] = {
    "div": _Lines.divide,
    "if": _Lines.choose,
    "sign": _Lines.sign,
    "square": _Lines.power,
    "cube": _Lines.power,
    "reciprocal": _Lines.reciprocal,
    "neg": _Lines.negate,
    "table": _Lines.look_up,
}
