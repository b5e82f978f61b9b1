"""Machine code: statuses, memory, tables, long programs, blocks of any size, and the cache on disk."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bgdsl import cache
from bgdsl.backends.native import build
from bgdsl.backends.native.elimination import eliminate
from bgdsl.expr import ONE, ZERO, add, const, param, table, unary, var
from bgdsl.ir.program import Assign, Program, SolveLinear
from tests.backends import programs
from tests.backends.programs import ORIGIN, newton, parameter, program
from tests.backends.test_agreement import dense, module_of


def call(model, t: float, *x: float) -> tuple[int, np.ndarray]:  # type: ignore[no-untyped-def]
    out = np.zeros(len(model.program.derivatives))
    return model.rhs(t, np.array(x), np.zeros(0), out), out


def linear(n: int, symmetric: bool, parametric: bool = False) -> Program:
    """A diagonally weak but regular system of n unknowns whose matrix depends on the state (or on a parameter)."""
    lead = param("a") if parametric else var("x0")
    random = np.random.default_rng(n)
    numbers = random.normal(size=(n, n)) * (random.random((n, n)) < 0.3) + np.eye(n) * 2 * n
    if symmetric:
        numbers = numbers + numbers.T
    entries = tuple(
        (i, j, const(numbers[i, j]) + lead if i == j else const(numbers[i, j])) for i, j in zip(*np.nonzero(numbers), strict=True)
    )
    names = tuple(f"z{i}" for i in range(n))
    step = SolveLinear(names, entries, tuple(var("x0") * float(i) + var("x1") for i in range(n)), ORIGIN, "z", symmetric)
    return program(
        {"x0": var("z0") + var(f"z{n - 1}"), "x1": add(var(name) for name in names)}, steps=(step,), parameters=(parameter("a", 0.5),)
    )


@pytest.mark.parametrize("parametric", [False, True])
@pytest.mark.parametrize("symmetric", [False, True])
@pytest.mark.parametrize("n", [4, 5, 12, 40, 90])
def test_linear_blocks_of_any_size(n: int, symmetric: bool, parametric: bool) -> None:
    made = linear(n, symmetric, parametric)
    model, module = build(made), module_of(made)
    p = module.parameters()
    for x in ([0.3, 1.0], [-2.0, 0.1]):
        status, out = call(model, 0.0, *x)
        assert status == 0
        assert out == pytest.approx(module.rhs(0, x, p), rel=1e-12, abs=1e-13)
        assert dense(model, 0.0, np.array(x), np.zeros(0)) == pytest.approx(module.jacobian(0, x, p), rel=1e-11, abs=1e-13)


def test_pivoting_and_units() -> None:
    """A matrix with zeros on its diagonal, whose rows and columns are in units of very different size."""
    step = SolveLinear(
        ("a", "b", "c", "d"),
        (
            *((0, 1, const(1e12)), (0, 3, const(1.0))),
            *((1, 0, const(1e-9)), (1, 2, var("x") * 1e-3)),
            *((2, 3, const(1e-14)), (2, 1, const(5e-3))),
            *((3, 2, const(1e5)), (3, 3, const(1e-4)), (3, 0, const(1.0))),
        ),
        (const(1e12), const(1e-9), var("x"), const(2.0)),
        ORIGIN,
        "a, b, c, d",
        symmetric=False,
    )
    made = program({"x": var("a") + var("b"), "y": var("c") + var("d")}, steps=(step,))
    status, out = call(build(made), 0.0, 3.0, 0.0)
    assert status == 0
    assert out == pytest.approx(module_of(made).rhs(0, [3.0, 0.0], {}), rel=1e-9)


def test_singular_block_gives_its_number() -> None:
    first = Assign("s", var("x") * 1.0, ORIGIN)
    step = SolveLinear(
        ("a", "b"), ((0, 0, const(0.1)), (0, 1, const(0.3)), (1, 0, const(0.2)), (1, 1, var("x") * 0.6)), (ONE, ONE), ORIGIN, "a, b"
    )
    model = build(program({"x": var("a")}, steps=(first, step)))
    assert call(model, 0.0, 3.0)[0] == 0
    assert call(model, 0.0, 1.0)[0] == 2
    assert call(model, 0.0, 0.0)[0] == 0


@pytest.mark.parametrize("symmetric", [False, True])
def test_singular_block_of_many_gives_its_number(symmetric: bool) -> None:
    n = 12
    entries = [(i, j, const(1.0)) for i in range(n) for j in range(n) if abs(i - j) == 1]
    entries += [(i, i, const(2.0) if 0 < i < n - 1 else var("x")) for i in range(n)]
    entries = [(i, j, -value if i != j else value) for i, j, value in entries]
    step = SolveLinear(tuple(f"z{i}" for i in range(n)), tuple(entries), (ONE,) * n, ORIGIN, "z", symmetric)
    model = build(program({"x": var("z3")}, steps=(step,)))
    assert call(model, 0.0, 2.0)[0] == 0
    assert call(model, 0.0, 1.0)[0] == 1, "rows sum to zero"


def test_singular_parametric_block_spoils_results() -> None:
    entries = tuple((i, j, param("a") if i == j else ONE) for i in range(4) for j in range(4))
    step = SolveLinear(tuple("abcd"), entries, (var("x"),) * 4, ORIGIN, "a")
    model = build(program({"x": var("a")}, steps=(step,), parameters=(parameter("a", 2.0),)))
    status, out = call(model, 0.0, 5.0)
    assert (status, out[0]) == (0, pytest.approx(1.0))
    assert model.set_parameters(np.array([1.0])) == 1
    status, out = call(model, 0.0, 5.0)
    assert status != 0 or math.isnan(out[0])
    assert model.set_parameters(np.array([3.0])) == 0
    assert call(model, 0.0, 6.0)[1][0] == pytest.approx(1.0)


def test_iteration_that_fails_gives_number_and_residual() -> None:
    z = var("z")
    model = build(program({"x": z}, steps=(newton(("z",), {}, (z**2.0 + var("x"),), (ONE,)),)))
    assert call(model, 0.0, -4.0) == (0, pytest.approx([2.0]))
    status, _ = call(model, 0.0, 1.0)
    assert status == 1
    assert model.residual >= 1.0
    assert call(model, 0.0, -9.0) == (0, pytest.approx([3.0]))


def test_iteration_starts_where_it_ended() -> None:
    """Of two solutions, the one that continues the last is found, by every kernel alike; new parameters forget it."""
    z = var("z")
    made = program(
        {"x": z}, steps=(newton(("z",), {}, (z**2.0 - ONE + var("x"),), (param("guess"),)),), parameters=(parameter("guess", 1.0),)
    )
    model = build(made)
    value = model.evaluator([z * 1.0])
    out = np.zeros(1)
    model.set_parameters(np.array([-1.0]))
    assert call(model, 0.0, 0.5)[1][0] == pytest.approx(-(0.5**0.5), rel=1e-15)
    assert value(0.0, np.array([0.4]), np.zeros(0), out) == 0 and out[0] == pytest.approx(-(0.6**0.5), rel=1e-15)
    assert dense(model, 0.0, np.array([0.4]), np.zeros(0))[0, 0] == pytest.approx(0.5 / 0.6**0.5)
    model.set_parameters(np.array([1.0]))
    assert call(model, 0.0, 0.4)[1][0] == pytest.approx(0.6**0.5)


@pytest.mark.parametrize(
    ("residual", "guess", "wanted"),
    [
        (unary("exp", var("z")) - ONE - var("x"), 0.0, math.log(2.0)),
        (unary("exp", var("z") / 0.02585) * 1e-14 + var("z") - var("x") * 0.7, 0.0, None),
        (unary("atan", var("z")) - var("x") * 0.5, 10.0, math.tan(0.5)),
        (var("z") ** 3.0 - var("x") * 1e-9, 1.0, 1e-3),
        (unary("log", var("z")) + var("x"), 1e-3, math.exp(-1.0)),
    ],
)
def test_hard_iterations(residual, guess: float, wanted: float | None) -> None:  # type: ignore[no-untyped-def]
    made = program({"x": var("z")}, steps=(newton(("z",), {}, (residual,), (const(guess),)),))
    status, out = call(build(made), 0.0, 1.0)
    assert status == 0
    found = out[0] if wanted is None else wanted
    assert out[0] == pytest.approx(found, rel=1e-14, abs=1e-7)
    if wanted is None:
        assert abs(math.exp(out[0] / 0.02585) * 1e-14 + out[0] - 0.7) < 1e-14
    assert module_of(made).rhs(0, [1.0], {})[0] == pytest.approx(out[0], rel=1e-14, abs=1e-7)


@pytest.mark.parametrize("name", ["uneven", "even"])
@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_tables(name: str, order: int) -> None:
    made = program({"x": table(name, var("x"), order)})
    model, module, direct = build(made), module_of(made), programs.TABLES[name]
    points = [
        *np.linspace(-5, 7, 101),
        *direct.x,
        *(np.nextafter(x, 9) for x in direct.x),
        *(np.nextafter(x, -9) for x in direct.x),
        1e300,
        -1e9,
    ]
    together = module.rhs(0, np.array([points]), {})[0]
    for x, other in zip(points, together, strict=True):
        wanted = direct(x, order)
        assert call(model, 0.0, x)[1][0] == pytest.approx(wanted, rel=1e-12, abs=1e-12), x
        assert other == pytest.approx(wanted, rel=1e-12, abs=1e-12), x
    assert order or math.isnan(call(model, 0.0, math.nan)[1][0])


def test_long_programs_are_cut_and_agree() -> None:
    n = 400
    states = {f"x{i}": unary("sin", var(f"x{i}")) * var(f"x{(i + 7) % n}") - var(f"x{(i + 200) % n}") / param("m") for i in range(n)}
    shared = add(var(f"x{i}") ** 2.0 for i in range(n))
    made = program({name: value * unary("cos", shared) for name, value in states.items()}, parameters=(parameter("m", 3.0),))
    model = build(made)
    assert model.rhs.code.text.count("define internal") > 3
    x = np.sin(np.arange(n))
    status, out = call(model, 0.0, *x)
    assert status == 0
    wanted = (np.sin(x) * np.roll(x, -7) - np.roll(x, -200) / 3.0) * np.cos(np.sum(x * x))
    assert out == pytest.approx(wanted, rel=1e-11, abs=1e-12)


def test_two_models_share_no_memory() -> None:
    made = programs.loops()
    one, two = build(made), build(made)
    two.set_parameters(np.array([5.0, 1.0]))
    before = call(one, 0.0, 0.7, 1.0)[1]
    call(two, 0.0, 0.1, 2.0)
    assert (call(one, 0.0, 0.7, 1.0)[1] == before).all()
    assert (call(two, 0.0, 0.7, 1.0)[1] != before).any()


def test_chained_blocks_carry_only_the_states_that_reach_them() -> None:
    """Ten blocks, the k-th over state k and the block before: the pattern is lower triangular and exact."""
    n, steps = 10, []
    for k in range(n):
        before = var(f"z{k - 1}") if k else ZERO
        steps.append(newton((f"z{k}",), {}, (var(f"z{k}") + unary("tanh", var(f"z{k}")) - var(f"x{k}") - before * 0.5,)))
    made = program({f"x{k}": var(f"z{k}") * var("x0") for k in range(n)}, steps=steps)
    model, module = build(made), module_of(made)
    pattern = eliminate(made)
    assert len(pattern.rows) == n * (n + 1) // 2
    x = np.linspace(0.5, 1.5, n)
    assert dense(model, 0.0, x, x) == pytest.approx(module.jacobian(0, x, {}), rel=1e-12, abs=1e-14)


def test_constants_as_results() -> None:
    made = program(
        {"x": const(-0.0), "y": param("a") / param("b"), "z": const(1e300) * param("a")},
        parameters=(parameter("a", 1.0), parameter("b", 0.0)),
    )
    assert list(call(build(made), 0.0, 0.0, 0.0, 0.0)[1]) == [0.0, math.inf, 1e300]


# ---------------------------------------------------------------------------------------------------------------- cache


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("BGDSL_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_cache_is_used_and_survives_damage(folder: Path) -> None:
    made = program({"x": var("x") * 7.25})
    assert call(build(made), 0.0, 2.0)[1][0] == 14.5
    (file,) = folder.glob("*.o")
    good = file.read_bytes()
    for damaged in (b"", good[:40], good[:-1], good[:60] + b"\xff" + good[61:], b"x" * len(good)):
        file.write_bytes(damaged)
        assert call(build(made), 0.0, 2.0)[1][0] == 14.5
        assert file.read_bytes() == good, "what was damaged is made anew"
    assert [entry.name for entry in folder.iterdir()] == [file.name], "no temporary files stay"


def test_cache_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    for place in (blocked, blocked / "below"):
        monkeypatch.setenv("BGDSL_CACHE", str(place))
        assert call(build(program({"x": var("x") * 3.5})), 0.0, 2.0)[1][0] == 7.0


def test_cache_is_bounded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "LIMIT", 10_000)
    for k in range(30):
        cache.keep(f"{k:03}", bytes(1000))
    kept = sorted(path.stem for path in folder.glob("*.o"))
    assert len(kept) == 9 and kept[-1] == "029"


def test_concurrent_processes_share_the_cache(folder: Path) -> None:
    code = (
        "import numpy as np\nfrom tests.backends.programs import loops\nfrom bgdsl.backends.native import build\n"
        "out = np.zeros(2)\nassert build(loops()).rhs(0.0, np.array([0.7, 1.0]), out, out) == 0\nprint(repr(out[1]))"
    )
    root = Path(__file__).parent.parent.parent
    runs = [subprocess.Popen([sys.executable, "-c", code], cwd=root, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    results = {run.communicate()[0] for run in runs}
    assert len(results) == 1 and all(run.returncode == 0 for run in runs)


def test_importing_costs_no_llvm() -> None:
    code = "import sys, bgdsl.backends.native; sys.exit('llvmlite' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
