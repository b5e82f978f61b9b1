"""The generated module: what it offers, what it survives, and that its text is no place for a model to run code."""

from __future__ import annotations

import ast
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Environment, meta

import bgdsl.backends.numpy.module as module_source
from bgdsl.backends.numpy import write_module
from bgdsl.backends.numpy.module import Context
from bgdsl.backends.numpy.names import Namespace, mangled
from bgdsl.expr import ONE, TIME, ZERO, const, if_else, param, relation, unary, var
from bgdsl.ir.graph import Origin
from bgdsl.ir.program import Assign, Program, Record
from bgdsl.source import Source, Span
from tests.backends import programs
from tests.backends.test_agreement import module_of

PUBLIC = {"parameters", "initial_state", "rhs", "jacobian", "outputs", "bonds"}


def oscillator(**more: object) -> Program:
    """A mass m on a spring k = 100 m, with an array parameter and an input."""
    return programs.program(
        {"p": -(param("k") * var("q")) - param("K[2]") * var("q") ** 3.0 + var("F"), "q": var("p") / param("m")},
        parameters=(
            programs.parameter("m", 2.0, unit="kg", comment="mass"),
            programs.parameter("k", param("m") * 100.0),
            programs.parameter("K", 1.0, param("m"), 3.0, shape=(3,)),
            programs.parameter("T", 1.0, 2.0, 3.0, 4.0, shape=(2, 2)),
        ),
        inputs=("F",),
        outputs={"v": var("p") / param("m")},
        starts=(param("m"), ZERO),
        **more,
    )


def test_template_places_exactly_the_context() -> None:
    folder = Path(module_source.__file__).parent / "templates"
    used = meta.find_undeclared_variables(Environment().parse((folder / "module.py.j2").read_text()))
    assert used == {field.name for field in fields(Context)}


def test_surface() -> None:
    module = module_of(oscillator())
    assert (module.MODEL, module.SOURCE, module.DIGEST) == ("Made", "made.bg", "0" * 64)
    assert module.TOOL.startswith("bgdsl ")
    assert [(s.name, s.unit, s.description, s.start) for s in module.STATES] == [
        ("p", "kg.m/s", "a state", 2.0),
        ("q", "kg.m/s", "a state", 0.0),
    ]
    assert [record.name for record in module.OUTPUTS] == ["v"]
    assert [record.name for record in module.INPUTS] == ["F"]
    assert module.BONDS == ()
    assert module.PARAMETERS == {"m": 2.0, "k": 200.0, "K": (1.0, 2.0, 3.0), "T": ((1.0, 2.0), (3.0, 4.0))}


def test_imports_numpy_only() -> None:
    tree = ast.parse(write_module(oscillator(), source_name="made.bg"))
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    assert names == ["numpy"] and not any(isinstance(node, ast.ImportFrom) for node in ast.walk(tree))


def test_parameters() -> None:
    module = module_of(oscillator())
    assert module.parameters() == dict(module.PARAMETERS)
    assert module.parameters(m=3)["k"] == 300.0
    assert module.parameters(m=3)["K"] == (1.0, 3.0, 3.0)
    assert module.parameters(m=3, k=7)["k"] == 7.0
    assert module.parameters(**{"K[1]": 9, "m": 5})["K"] == (9.0, 5.0, 3.0)
    assert module.parameters(K=np.array([1, 2, 4]))["K"] == (1.0, 2.0, 4.0)
    assert module.parameters(**{"T[2,1]": 8})["T"] == ((1.0, 2.0), (8.0, 4.0))
    assert module.parameters() == dict(module.PARAMETERS), "changes are forgotten"
    with pytest.raises(KeyError, match=r"no parameter 'massa'"):
        module.parameters(massa=1)
    with pytest.raises(KeyError, match="did you mean"):
        module.parameters(KK=1)
    for wrong in ("K[4]", "K[0]", "m[1]", "T[1]", "K[x]", "K[]"):
        with pytest.raises(KeyError, match="no parameter"):
            module.parameters(**{wrong: 1})
    with pytest.raises(ValueError, match="3 values"):
        module.parameters(K=(1, 2))
    with pytest.raises((TypeError, ValueError)):
        module.parameters(m="2; import os")


def test_structural_parameters_cannot_be_changed_here() -> None:
    program = programs.program({"x": ZERO}, parameters=(replace(programs.parameter("n", 3.0), structural=True),))
    module = module_of(program)
    assert module.parameters(n=3) == {"n": 3.0}
    with pytest.raises(ValueError, match="compile again"):
        module.parameters(n=4)


def test_state_input_and_parameters_are_read_at_each_call() -> None:
    module = module_of(oscillator())
    p = module.parameters(**{"K[2]": 0})
    assert module.initial_state(p) == pytest.approx([2.0, 0.0])
    assert module.rhs(0, [1, 0.5], p, [3]) == pytest.approx([-97.0, 0.5])
    assert module.rhs(0, (1, 0.5), p, {"F": 3}) == pytest.approx([-97.0, 0.5])
    p["m"] = 1.0
    assert module.rhs(0, [1, 0.5], p, [3])[1] == 1.0
    assert module.outputs(0, [1, 0.5], p, [3]) == pytest.approx([1.0])
    assert [part.shape for part in module.bonds(0, [1, 0.5], p, [3])] == [(0,), (0,)]
    for x, u, error in (([1], [3], ValueError), ([1, 2], None, ValueError), ([1, 2], {"G": 1}, KeyError), ([1, 2], [1, 2], ValueError)):
        with pytest.raises(error):
            module.rhs(0, x, p, u)


def test_ensembles() -> None:
    program = programs.program(
        {
            "x": if_else(relation("lt", var("x"), ZERO), unary("sqrt", -var("x")), ONE / var("x")),
            "y": const(2.0),
            "z": relation("lt", var("x"), var("y")) + TIME,
        }
    )
    module = module_of(program)
    x = np.array([[-4.0, 0.5, 0.0], [1.0, 1.0, -1.0], [0.0, 0.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = module.rhs(0.5, x, {})
        slopes = module.jacobian(0.5, x, {})
    assert found == pytest.approx(np.array([[2.0, 2.0, np.inf], [2.0, 2.0, 2.0], [1.5, 1.5, 0.5]]))
    assert slopes.shape == (3, 3, 3)
    assert slopes[0, 0, :2] == pytest.approx([-0.25, -4.0])
    assert module.rhs(0.5, x[:, :0], {}).shape == (3, 0)


def test_iteration_that_does_not_converge_says_so() -> None:
    step = programs.newton(("z",), {}, (var("z") ** 2.0 + ONE + var("x") * var("x"),), (const(0.3),))
    module = module_of(programs.program({"x": var("z")}, steps=(step,)))
    with pytest.raises(ArithmeticError, match=r"the loop through z .*t = 1.5"):
        module.rhs(1.5, [0.0], {})


def test_singular_block_says_so() -> None:
    step = programs.SolveLinear(("a", "b"), ((0, 0, ONE), (0, 1, ONE), (1, 0, ONE), (1, 1, var("x"))), (ONE, ZERO), programs.ORIGIN, "a, b")
    module = module_of(programs.program({"x": var("a")}, steps=(step,)))
    assert module.rhs(0, [3.0], {}) == pytest.approx([1.5])
    with pytest.raises(ArithmeticError, match="the loop through a, b is singular at t = 2"):
        module.rhs(2, [1.0], {})


def test_dependent_start_that_disagrees_is_refused() -> None:
    program = programs.program(
        {"x": ZERO}, steps=(Assign("y", var("x") * 2.0, programs.ORIGIN),), starts=(param("a"),), parameters=(programs.parameter("a", 1.0),)
    )
    module = module_of(replace(program, dependent=(("y", var("y"), const(2.0)),)))
    assert module.initial_state(module.parameters()) == pytest.approx([1.0])
    with pytest.raises(ArithmeticError, match="start of y"):
        module.initial_state(module.parameters(a=2))


def test_initial_equations_are_solved() -> None:
    steps = (
        programs.newton(("x",), {"s": var("x") * var("x")}, (var("s") - param("a"),), (ONE,)),
        Assign("y", var("x") + var("s"), programs.ORIGIN),
    )
    program = programs.program(
        {"x": ZERO, "y": ZERO}, starts=(var("x"), var("y")), parameters=(programs.parameter("a", 2.0),), initial_steps=steps
    )
    module = module_of(program)
    assert module.initial_state(module.parameters(a=9)) == pytest.approx([3.0, 12.0], rel=1e-14)
    assert [s.start for s in module.STATES] == pytest.approx([2**0.5, 2 + 2**0.5], rel=1e-14)


HOSTILE = (
    'a"b',
    "a'''b\"\"\"c",
    "x\nimport os",
    "x\r\nraise SystemExit",
    "x\x0craise SystemExit",
    "x\u2028raise SystemExit",
    "{{ 7*7 }}{% for i in x %}",
    "\\",
    "\\N{DASH}",
    "coding: utf-7",
    "\ud800",
    "\x00",
    "\u202eabc",
    "# -*- coding: rot13 -*-",
)


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_stays_text(text: str) -> None:
    source = Source(text, f"model M\n{text}\nend M;\n")
    origin = Origin(text, Span(source, 8, 9))
    program = oscillator(name=text)
    program = replace(
        program,
        comment=text,
        digest=text,
        states=tuple(Record(record.name, text, text) for record in program.states),
        parameters=tuple(replace(p, unit=text, comment=text) for p in program.parameters),
        outputs=tuple((Record(record.name + text, text, text), value) for record, value in program.outputs),
        steps=(Assign(text, var("q") * 2.0, origin),),
        derivatives=(var(text), ZERO),
        tables={},
    )
    written = write_module(program, source_name=text)
    assert written.encode("utf-8").decode("utf-8") == written
    tree = ast.parse(written)
    found = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")}
    assert found >= PUBLIC
    assert not any(isinstance(node, ast.Raise) and getattr(node.exc, "id", "") == "SystemExit" for node in ast.walk(tree))
    module = module_of(program)
    assert module.STATES[0].description == text and text == module.MODEL
    assert module.rhs(0, [1.0, 4.0], module.parameters(), [0.0])[0] == 8.0
    assert "49" not in module.MODEL


def test_names() -> None:
    space = Namespace(("rhs", "x"))
    assert mangled("cyl[2].rod.p[1]") == "cyl_2_rod_p_1"
    assert [space.take(name) for name in ("a.b", "a_b", "a[b]", "x", "lambda", "print", "é", "9", "_", "match")] == [
        *("a_b", "a_b_2", "a_b_3", "x_2", "lambda_2", "print_2", "v", "v_9", "v_2", "match_2"),
    ]


def test_variables_named_like_anything_do_no_harm() -> None:
    names = [
        "np",
        "rhs",
        "t",
        "p",
        "u",
        "shape",
        "dx",
        "J",
        "y",
        "len",
        "lambda",
        "None",
        "x",
        "A",
        "b",
        "z",
        "loop",
        "f",
        "s",
        "_linear",
        "effort",
    ]
    states = {name: var(names[i - 1]) * float(i + 1) for i, name in enumerate(names)}
    module = module_of(programs.program(states))
    x = np.arange(1.0, len(names) + 1)
    assert module.rhs(0, x, {}) == pytest.approx([x[i - 1] * (i + 1) for i in range(len(names))])
    assert np.count_nonzero(module.jacobian(0, x, {})) == len(names)


def test_same_text_each_time_and_short_lines() -> None:
    program = programs.loops()
    text = write_module(program, source_name="made.bg")
    assert write_module(programs.loops(), source_name="made.bg") == text
    assert max(len(line) for line in text.splitlines()) < 140
    assert "# made.bg:2: R damper(R = 2);" in text


def test_large_sums_are_broken_into_lines() -> None:
    names = [f"a_rather_long_name_for_a_state[{i}]" for i in range(60)]
    program = programs.program({name: sum((var(other) for other in names), ZERO) for name in names[:1]} | dict.fromkeys(names[1:], ZERO))
    text = write_module(program, source_name="made.bg")
    assert max(len(line) for line in text.splitlines()) < 140
    assert module_of(program).rhs(0, np.arange(60.0), {})[0] == pytest.approx(59 * 30)
