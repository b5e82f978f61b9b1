"""Runs that have to stop say why: the examples of the explanation pages, and where the messages point.

BG631, BG635, BG610, BG611, BG613, BG614, BG615, BG616, BG617, BG618, BG619 are tested here or beside (test_options, test_files).
"""

from __future__ import annotations

import re

import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, RunError
from bgdsl.explanations import explanation

RUN_TIME = ("BG620", "BG621", "BG622", "BG623", "BG630", "BG632", "BG633", "BG634", "BG615")


def simulate(text: str, **more: object) -> object:
    return pipeline.loads(text).compile().simulate(**more)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", RUN_TIME)
def test_the_examples_of_the_page(number: str) -> None:
    page = explanation(number)
    assert page is not None
    wrong, *right = re.findall(r"^```bg\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    with pytest.raises(BgError) as caught:
        simulate(wrong)
    assert [d.code.number for d in caught.value.diagnostics] == [number]
    for text in right:
        simulate(text)


def test_the_first_value_that_is_not_finite_is_named_with_its_law() -> None:
    page = explanation("BG630")
    assert page is not None
    with pytest.raises(RunError) as caught:
        simulate(re.findall(r"^```bg\n(.*?)^```", page, re.MULTILINE | re.DOTALL)[0])
    (found,) = caught.value.diagnostics
    assert "`outlet.f` is nan" in found.message and found.primary.span.text.startswith("outlet")
    assert caught.value.time == pytest.approx(1.5205689, abs=1e-4)
    assert any("sqrt(p.e)" in note for note in found.notes)


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams", "rk45", "lsoda", "radau", "vode-adams"])
def test_growth_without_bound_stops_at_its_time(method: str) -> None:
    text = "model Blow\n  Real x(start = 1);\nequation\n  der(x) = x^2;\nend Blow;\n"
    with pytest.raises(RunError) as caught:
        simulate(text, stop=2.0, method=method)
    assert caught.value.time == pytest.approx(1.0, abs=2e-3)
    assert caught.value.diagnostics[0].code.number in ("BG630", "BG631")


def test_a_jacobian_that_is_not_finite_is_no_fault_of_the_compiler() -> None:
    law = "f = 1e-9*(exp(e/0.05) - 1e300)"
    text = f"model M\n  J0 p;  C c(C = 1e-3);  R d({law});  J1 s;  Se u(e = 10*sin(300*time));  R r(R = 1);\nequation\n"
    with pytest.raises(RunError):
        simulate(text + "  u -> s;  s -> r, p;  p -> c, d;\nend M;\n", stop=0.05, method="radau")


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams", "rk45", "lsoda", "radau", "vode-adams"])
def test_derivatives_that_are_not_finite_at_the_start(method: str) -> None:
    with pytest.raises(RunError) as caught:
        simulate("model M\n  Real x(start = 0);\n  Real y(start = 1);\nequation\n  der(x) = y/x*x;\n  der(y) = x;\nend M;\n", method=method)
    assert caught.value.diagnostics[0].code.number == "BG630" and caught.value.time == 0.0


def test_an_equation_without_solution_beyond_a_time_is_named() -> None:
    page = explanation("BG632")
    assert page is not None
    with pytest.raises(RunError) as caught:
        simulate(re.findall(r"^```bg\n(.*?)^```", page, re.MULTILINE | re.DOTALL)[0])
    (found,) = caught.value.diagnostics
    assert "`y`" in found.message and caught.value.time == pytest.approx(1.0, abs=1e-4)


def test_without_sundials_other_methods_are_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    """BG636."""
    from bgdsl.simulate import run

    def absent() -> None:
        raise OSError("there is no library sundials_cvode")

    monkeypatch.setattr(run, "libraries", absent)
    text = "model Decay\n  Real x(start = 1);\nequation\n  der(x) = -x;\nend Decay;\n"
    with pytest.raises(BgError) as caught:
        simulate(text)
    assert caught.value.diagnostics[0].code.number == "BG636"
    simulate(text, method="lsoda")
