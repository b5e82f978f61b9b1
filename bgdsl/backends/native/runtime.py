"""What kernels call: factors of a dense matrix, substitution, damped Newton. Written as IR, compiled once, kept on disk.

Matrices are row by row. Behind each are 3 n numbers: its pivots (as integers) and the scales of its rows and columns.

bg_factor(n, A, s): A := L U with scaled partial pivoting; 1 if singular to round-off, whatever the units of rows and columns.
bg_substitute(n, A, s, m, B): B := inv(A) B for the n x m matrix B.
bg_newton(n, eval, area, warm, info, t, x, u, c, w, o): z with residuals zero, from `warm` (NaN: none yet) or the guesses; area
holds z, residuals, guesses, step, start of the step, row scales (n each) and the Jacobian. 1 if it does not converge; info[0]
then holds the largest residual.
bg_eliminate(array, plan): what `elimination.py` says; 0, or the number of the step whose block is singular.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

from bgdsl.backends.native.numbers import literal
from bgdsl.ir.program import OFFSETS


class _Routine:
    """A function under construction, with loops and mutable variables; LLVM turns the latter into registers."""

    def __init__(self, head: str, numbers: Iterator[int]) -> None:
        self.head = head
        self.group = ""
        self.numbers = numbers
        self.variables: list[str] = []
        self.lines: list[str] = []
        self.count = 0
        self.marks: list[str] = []

    def text(self) -> str:
        return "\n".join((f"define {self.head} nounwind {{", "entry:", *self.variables, *self.lines, "}", *self.marks))

    def name(self) -> str:
        self.count += 1
        return f"%v{self.count}"

    def do(self, line: str) -> None:
        self.lines.append(line)

    def new(self, text: str) -> str:
        name = self.name()
        self.do(f"{name} = {text}")
        return name

    def variable(self, kind: str = "double") -> str:
        name = self.name()
        self.variables.append(f"{name} = alloca {kind}")
        return name

    def get(self, variable: str, kind: str = "double") -> str:
        return self.new(f"load {kind}, ptr {variable}{self.group}")

    def set(self, variable: str, value: str, kind: str = "double") -> None:
        self.do(f"store {kind} {value}, ptr {variable}{self.group}")

    def at(self, array: str, index: str) -> str:
        return self.new(f"getelementptr inbounds double, ptr {array}, i64 {index}")

    def load(self, array: str, index: str) -> str:
        return self.get(self.at(array, index))

    def store(self, array: str, index: str, value: str) -> None:
        self.set(self.at(array, index), value)

    def integer(self, op: str, a: str, b: str) -> str:
        return self.new(f"{op} i64 {a}, {b}")

    def float(self, op: str, a: str, b: str) -> str:
        return self.new(f"{op} contract double {a}, {b}")

    def size(self, a: str) -> str:
        return self.new(f"call double @llvm.fabs.f64(double {a})")

    def test(self, relation: str, a: str, b: str) -> str:
        return self.new(f"fcmp {relation} double {a}, {b}")

    def largest(self, variable: str, value: str) -> None:
        """variable := max(variable, value), and NaN once a value is NaN."""
        self.set(variable, self.new(f"call double @llvm.maximum.f64(double {self.get(variable)}, double {value})"))

    def largest_of(self, array: str, end: str) -> str:
        """The largest size in an array, NaN if there is one: compared as integers, in whose order NaN comes last, since machines
        find the largest of several integers at once, but not of several floats that may be NaN."""
        most = self.variable("i64")
        self.set(most, "0", "i64")
        with self.loop("0", end, wide=True) as j:
            bits = self.integer("and", self.get(self.at(array, j), "i64"), str(2**63 - 1))
            self.set(most, self.new(f"call i64 @llvm.umax.i64(i64 {self.get(most, 'i64')}, i64 {bits})"), "i64")
        return self.new(f"bitcast i64 {self.get(most, 'i64')} to double")

    @contextmanager
    def loop(self, start: str, end: str, *, wide: bool = False, apart: bool = False) -> Iterator[str]:
        """For i from `start` up to `end`, exclusive; `wide` where it is worth LLVM's time to do several at once, `apart` where besides
        no turn reads or writes what another one writes."""
        index = self.variable("i64")
        name = self.name()[1:]
        self.set(index, start, "i64")
        self.do(f"br label %head{name}\nhead{name}:")
        mark = self.apart() if apart else "" if wide else self.mark("!0")
        i = self.get(index, "i64")
        more = self.new(f"icmp slt i64 {i}, {end}")
        self.do(f"br i1 {more}, label %body{name}, label %end{name}\nbody{name}:")
        yield i
        self.set(index, self.integer("add", i, "1"), "i64")
        self.do(f"br label %head{name}{mark}\nend{name}:")
        self.group = ""

    def mark(self, *properties: str) -> str:
        """What to write at a loop's last branch for it to have these properties."""
        mark = f"!{next(self.numbers)}"
        self.marks.append(f"{mark} = distinct !{{{', '.join((mark, *properties))}}}")
        return f", !llvm.loop {mark}"

    def apart(self) -> str:
        """The mark of a loop whose turns do not meet, and from here on that of its accesses (`group`)."""
        group, accesses = f"!{next(self.numbers)}", f"!{next(self.numbers)}"
        self.marks += (f"{group} = distinct !{{}}", f'{accesses} = !{{!"llvm.loop.parallel_accesses", {group}}}')
        self.group = f", !llvm.access.group {group}"
        return self.mark(accesses)

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        name = self.name()[1:]
        self.do(f"br i1 {condition}, label %yes{name}, label %no{name}\nyes{name}:")
        yield
        self.do(f"br label %no{name}\nno{name}:")

    def leave(self, value: str) -> None:
        """Return; what follows is in a block of its own."""
        self.do(f"ret {value}\nafter{self.name()[1:]}:")

    def row(self, matrix: str, i: str, width: str) -> str:
        return self.at(matrix, self.integer("mul", i, width))

    def subtract(self, target: str, factor: str, source: str, start: str, end: str) -> None:
        """target[j] -= factor source[j]"""
        with self.loop(start, end, apart=True) as j:
            product = self.float("fmul", factor, self.load(source, j))
            self.store(target, j, self.float("fsub", self.load(target, j), product))

    def swap(self, a: str, b: str, width: str) -> None:
        with self.loop("0", width, apart=True) as j:
            x, y = self.load(a, j), self.load(b, j)
            self.store(a, j, y)
            self.store(b, j, x)


def _factor(numbers: Iterator[int]) -> str:
    r = _Routine("i32 @bg_factor(i64 %n, ptr noalias %A, ptr noalias %s)", numbers)
    rows, columns = r.at("%s", "%n"), r.at("%s", r.integer("mul", "%n", "2"))
    best, where, found = r.variable(), r.variable("i64"), r.variable("i64")
    with r.loop("0", "%n") as i:
        most = r.largest_of(r.row("%A", i, "%n"), "%n")
        with r.when(r.test("ule", most, "0.0")):
            r.leave("i32 1")
        r.store(rows, i, r.float("fdiv", "1.0", most))
    with r.loop("0", "%n") as j:
        r.store(columns, j, "0.0")
    with r.loop("0", "%n") as i:
        row, scale = r.row("%A", i, "%n"), r.load(rows, i)
        with r.loop("0", "%n", wide=True) as j:
            value = r.float("fmul", r.size(r.load(row, j)), scale)
            before = r.load(columns, j)
            r.store(columns, j, r.new(f"select i1 {r.test('ogt', value, before)}, double {value}, double {before}"))
    noise = r.float("fmul", r.new("sitofp i64 %n to double"), literal(2.0**-52))
    with r.loop("0", "%n") as k:
        top, after = r.row("%A", k, "%n"), r.integer("add", k, "1")
        r.set(best, r.float("fmul", r.size(r.load(top, k)), r.load(rows, k)))
        r.set(where, k, "i64")
        r.set(found, after, "i64")  # the rows below with an entry in this column are listed where later pivots will stand
        with r.loop(after, "%n") as i:
            entry = r.load(r.row("%A", i, "%n"), k)
            here = r.get(found, "i64")
            r.set(r.at("%s", here), i, "i64")
            r.set(found, r.integer("add", here, r.new(f"zext i1 {r.test('une', entry, '0.0')} to i64")), "i64")
            value = r.float("fmul", r.size(entry), r.load(rows, i))
            with r.when(r.test("ogt", value, r.get(best))):
                r.set(best, value)
                r.set(where, i, "i64")
        with r.when(r.test("ule", r.get(best), r.float("fmul", noise, r.load(columns, k)))):
            r.leave("i32 1")
        p = r.get(where, "i64")
        r.do(f"store i64 {p}, ptr {r.at('%s', k)}")
        with r.when(r.new(f"icmp ne i64 {p}, {k}")):
            r.swap(top, r.row("%A", p, "%n"), "%n")
            r.store(rows, p, r.load(rows, k))
        inverse = r.float("fdiv", "1.0", r.load(top, k))
        with r.loop(after, r.get(found, "i64")) as listed:
            row = r.row("%A", r.get(r.at("%s", listed), "i64"), "%n")
            below = r.load(row, k)
            with r.when(r.test("une", below, "0.0")):
                factor = r.float("fmul", below, inverse)
                r.store(row, k, factor)
                r.subtract(row, factor, top, after, "%n")
    r.do("ret i32 0")
    return r.text()


def _substitute(numbers: Iterator[int]) -> str:
    r = _Routine("void @bg_substitute(i64 %n, ptr noalias %A, ptr noalias %s, i64 %m, ptr noalias %B)", numbers)
    with r.loop("0", "%n") as k:
        p = r.new(f"load i64, ptr {r.at('%s', k)}")
        with r.when(r.new(f"icmp ne i64 {p}, {k}")):
            r.swap(r.row("%B", k, "%m"), r.row("%B", p, "%m"), "%m")
    last = r.integer("sub", "%n", "1")
    with r.when(r.new("icmp eq i64 %m, 1")):
        _substitute_one(r, last)
        r.leave("void")
    with r.loop("0", "%n") as i:
        row, target = r.row("%A", i, "%n"), r.row("%B", i, "%m")
        with r.loop("0", i) as k:
            factor = r.load(row, k)
            with r.when(r.test("une", factor, "0.0")):
                r.subtract(target, factor, r.row("%B", k, "%m"), "0", "%m")
    with r.loop("0", "%n") as back:
        i = r.integer("sub", last, back)
        row, target = r.row("%A", i, "%n"), r.row("%B", i, "%m")
        with r.loop(r.integer("add", i, "1"), "%n") as k:
            factor = r.load(row, k)
            with r.when(r.test("une", factor, "0.0")):
                r.subtract(target, factor, r.row("%B", k, "%m"), "0", "%m")
        inverse = r.float("fdiv", "1.0", r.load(row, i))
        with r.loop("0", "%m") as j:
            r.store(target, j, r.float("fmul", r.load(target, j), inverse))
    r.do("ret void")
    return r.text()


def _substitute_one(r: _Routine, last: str) -> None:
    """One right side: by dot products, whose terms may be added in any order."""
    total = r.variable()

    def dot(row: str, start: str, end: str) -> None:
        with r.loop(start, end, wide=True) as k:
            product = r.new(f"fmul reassoc contract double {r.load(row, k)}, {r.load('%B', k)}")
            r.set(total, r.new(f"fsub reassoc contract double {r.get(total)}, {product}"))

    with r.loop("0", "%n") as i:
        r.set(total, r.load("%B", i))
        dot(r.row("%A", i, "%n"), "0", i)
        r.store("%B", i, r.get(total))
    with r.loop("0", "%n") as back:
        i = r.integer("sub", last, back)
        row = r.row("%A", i, "%n")
        r.set(total, r.load("%B", i))
        dot(row, r.integer("add", i, "1"), "%n")
        r.store("%B", i, r.float("fdiv", r.get(total), r.load(row, i)))


_STEPS = 60
_HALVINGS = 30


def _newton(numbers: Iterator[int]) -> str:
    r = _Routine(
        "i32 @bg_newton(i64 %n, ptr %eval, ptr %area, ptr %warm, ptr %info, double %t, ptr %x, ptr %u, ptr %c, ptr %w, ptr %o)", numbers
    )
    z = "%area"
    f, guess, step, start, scales, matrix = (r.at("%area", r.integer("mul", "%n", str(k))) for k in range(1, 7))
    scratch = r.at(matrix, r.integer("mul", "%n", "%n"))
    bytes_ = r.integer("mul", r.integer("mul", "%n", "%n"), "8")
    norm, new_norm, largest, near, share = (r.variable() for _ in range(5))

    def evaluate() -> None:
        r.do(f"call void @llvm.memset.p0.i64(ptr {matrix}, i8 0, i64 {bytes_}, i1 false)")
        r.do("call void %eval(double %t, ptr %x, ptr %u, ptr %c, ptr %w, ptr %o)")

    def measure(target: str) -> None:
        """The largest residual, each over the largest derivative in its row: a distance in units of z."""
        r.set(target, "0.0")
        with r.loop("0", "%n") as i:
            r.largest(target, r.float("fmul", r.size(r.load(f, i)), r.load(scales, i)))

    def finish() -> None:
        with r.loop("0", "%n") as i:
            r.store("%warm", i, r.load(z, i))
        r.leave("i32 0")

    with r.loop("0", str(len(OFFSETS) + 1)) as attempt:
        is_warm = r.new(f"icmp eq i64 {attempt}, 0")
        offset = "0.0"
        for k, share_of_guess in enumerate(OFFSETS, start=1):
            offset = r.new(f"select i1 {r.new(f'icmp eq i64 {attempt}, {k}')}, double {literal(share_of_guess)}, double {offset}")
        with r.loop("0", "%n") as i:
            warm = r.load("%warm", i)
            cold = r.new(f"or i1 {r.new(f'xor i1 {is_warm}, true')}, {r.test('uno', warm, warm)}")
            first = r.load(guess, i)
            moved = r.float("fadd", first, r.float("fmul", offset, r.float("fadd", "1.0", r.size(first))))
            r.store(z, i, r.new(f"select i1 {cold}, double {moved}, double {warm}"))
        evaluate()
        iterations = r.variable("i64")
        r.set(iterations, str(_STEPS), "i64")
        name = r.name()[1:]
        r.do(f"br label %iterate{name}\niterate{name}:")
        left = r.get(iterations, "i64")
        r.do(f"br i1 {r.new(f'icmp sgt i64 {left}, 0')}, label %go{name}, label %failed{name}\ngo{name}:")
        r.set(iterations, r.integer("sub", left, "1"), "i64")
        r.set(largest, "0.0")
        with r.loop("0", "%n") as i:
            r.largest(largest, r.size(r.load(f, i)))
        with r.when(r.test("oeq", r.get(largest), "0.0")):  # solved, whatever the derivatives are here
            finish()
        r.set(largest, "0.0")
        with r.loop("0", "%n") as i:
            row = r.row(matrix, i, "%n")
            r.set(norm, "0.0")
            with r.loop("0", "%n") as j:
                r.largest(norm, r.size(r.load(row, j)))
            r.store(scales, i, r.float("fdiv", "1.0", r.get(norm)))
            r.store(step, i, r.load(f, i))
            r.store(start, i, r.load(z, i))
            r.largest(largest, r.size(r.load(z, i)))
        measure(norm)
        status = r.new(f"call i32 @bg_factor(i64 %n, ptr {matrix}, ptr {scratch})")
        solvable = r.new(f"icmp eq i32 {status}, 0")
        r.do(f"br i1 {solvable}, label %solve{name}, label %failed{name}\nsolve{name}:")
        r.do(f"call void @bg_substitute(i64 %n, ptr {matrix}, ptr {scratch}, i64 1, ptr {step})")
        r.set(near, "0.0")  # the largest step over what still counts as near
        with r.loop("0", "%n") as i:
            value = r.load(z, i)
            part = r.float("fmul", r.size(value), literal(1e-9))
            whole = r.float("fmul", r.get(largest), literal(1e-15))
            allowed = r.float("fadd", r.float("fadd", part, whole), literal(1e-200))
            r.largest(near, r.float("fdiv", r.size(r.load(step, i)), allowed))
            r.store(z, i, r.float("fsub", value, r.load(step, i)))
        with r.when(r.test("ole", r.get(near), "1.0")):  # convergence is quadratic: this step is the last
            finish()
        r.set(share, "1.0")
        halvings = r.variable("i64")
        r.set(halvings, str(_HALVINGS), "i64")
        r.do(f"br label %try{name}\ntry{name}:")
        evaluate()
        measure(new_norm)
        bound = r.float("fsub", "1.0", r.float("fmul", r.get(share), "0.25"))
        better = r.test("ole", r.get(new_norm), r.float("fmul", bound, r.get(norm)))
        r.do(f"br i1 {better}, label %iterate{name}, label %halve{name}\nhalve{name}:")
        with r.when(r.test("ole", r.get(near), literal(1e4))):  # no better, but as near as rounding of the residuals allows
            with r.loop("0", "%n") as i:
                r.store(z, i, r.load(start, i))
            finish()
        tries = r.integer("sub", r.get(halvings, "i64"), "1")
        r.set(halvings, tries, "i64")
        r.set(share, r.float("fmul", r.get(share), "0.5"))
        with r.loop("0", "%n") as i:
            moved = r.float("fmul", r.get(share), r.load(step, i))
            r.store(z, i, r.float("fsub", r.load(start, i), moved))
        r.do(f"br i1 {r.new(f'icmp sgt i64 {tries}, 0')}, label %try{name}, label %stuck{name}\nstuck{name}:")
        floor = r.float("fmul", r.float("fadd", r.get(largest), "1.0"), literal(1e-13))
        with r.when(r.test("ole", r.get(norm), floor)):
            with r.loop("0", "%n") as i:
                r.store(z, i, r.load(start, i))
            finish()
        r.do(f"br label %failed{name}\nfailed{name}:")
    r.set(norm, "0.0")
    with r.loop("0", "%n") as i:
        r.largest(norm, r.size(r.load(f, i)))
    r.store("%info", "0", r.get(norm))
    r.do("ret i32 1")
    return r.text()


def _eliminate(numbers: Iterator[int]) -> str:
    r = _Routine("i32 @bg_eliminate(ptr noalias %array, ptr noalias %plan)", numbers)
    position = r.variable("i64")
    r.set(position, "0", "i64")

    def take() -> str:
        """The next number of the plan."""
        here = r.get(position, "i64")
        r.set(position, r.integer("add", here, "1"), "i64")
        number = r.new(f"load i32, ptr {r.new(f'getelementptr inbounds i32, ptr %plan, i64 {here}')}")
        return r.new(f"sext i32 {number} to i64")

    r.do("br label %next\nnext:")
    r.do(f"switch i64 {take()}, label %done [ i64 0, label %copy i64 1, label %subtract i64 2, label %solve ]\ncopy:")
    with r.loop("0", take()):
        value = r.load("%array", take())
        r.store("%array", take(), value)
    r.do("br label %next\nsubtract:")
    factor, source, count = r.load("%array", take()), r.at("%array", take()), take()
    with r.loop("0", count) as k:
        product = r.float("fmul", factor, r.load(source, k))
        target = r.at("%array", take())
        r.set(target, r.float("fsub", r.get(target), product))
    r.do("br label %next\nsolve:")
    n, matrix, m, right, step = take(), r.at("%array", take()), take(), r.at("%array", take()), take()
    scratch = r.at(matrix, r.integer("mul", n, n))
    status = r.new(f"call i32 @bg_factor(i64 {n}, ptr {matrix}, ptr {scratch})")
    r.do(f"br i1 {r.new(f'icmp eq i32 {status}, 0')}, label %good, label %bad\ngood:")
    r.do(f"call void @bg_substitute(i64 {n}, ptr {matrix}, ptr {scratch}, i64 {m}, ptr {right})")
    r.do("br label %next\nbad:")
    r.do(f"ret i32 {r.new(f'trunc i64 {step} to i32')}\ndone:")
    r.do("ret i32 0")
    return r.text()


def runtime_text() -> str:
    """The module."""
    head = (
        "declare double @llvm.fabs.f64(double)",
        "declare double @llvm.maximum.f64(double, double)",
        "declare i64 @llvm.umax.i64(i64, i64)",
        "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)",
        '!0 = !{!"llvm.loop.vectorize.enable", i1 false}',
    )
    numbers = count(1)
    return "\n".join((*head, _factor(numbers), _substitute(numbers), _newton(numbers), _eliminate(numbers), ""))
