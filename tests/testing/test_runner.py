"""Test blocks as `bgc test` carries them out: what passes, what fails and how it is shown."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from bgdsl.diagnostics import render
from bgdsl.explanations import explanation
from bgdsl.testing.runner import Outcome, collect, run_file, step_tolerance

DECAY = """\
model Decay
  parameter Real b = 1;
  J1 v;  I mass(I = 1, f(start = 1));  R damper(R = b);
  output Real speed = v.f;
  experiment slow(stopTime = 2, tolerance = 1e-8);
  experiment thick extends slow(b = 4);
equation
  v -> mass, damper;
end Decay;

model Free
  J1[3] v;  I[3] mass(I = 2*identity(3), f(start = {1, 2, 3}));  R[3] damper(R = identity(3));
  C wall(k = 100, q(start = 0.1));  I ball(I = 1);  J1 w;
  Real R[2,2] = [1, 2; 3, 4];
equation
  v => mass, damper;
  w -> wall, ball;
end Free;
"""

Run = Callable[[str], Outcome]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    def carry_out(statements: str) -> Outcome:
        path = tmp_path / "case.bg"
        path.write_text(f'{DECAY}\ntest "it"\n{statements}\nend;\n')
        (outcome,) = run_file(path)
        return outcome

    return carry_out


@pytest.mark.parametrize(
    "statements",
    [
        "run r = Decay for 1 tolerance 1e-9; assert r.v.f(end) == exp(-1) +- 1e-8;",
        "run r = Decay(b = 2) for 1 tolerance 1e-9; assert r.v.f == exp(-2*r.time) +- 1e-8;",
        "run r = Decay experiment slow; assert r.time(end) == 2; assert r.speed(0) == 1;",
        "run r = Decay experiment thick; assert r.b(end) == 4; assert r.speed(end) == exp(-8) +- 1e-6;",
        "run r = Decay(b = 3) experiment slow; assert r.speed(1) == exp(-3) +- 1e-6;",
        'run r = Decay for 1 interval 0.25 method "rk45"; assert r.v.f(0.25) == exp(-0.25) +- 1e-5;',
        "run a = Decay experiment slow; run b = Decay(b = 1.1) for 1; assert a.speed == b.speed +- 11 %; assert a.v.f(1) > b.v.f(1);",
        "run r = Decay for 1; assert r.speed <= 1 and r.speed > 0.3; assert not r.speed > 1;",
        "run r = Decay for 1; assert max(r.speed) == 1; assert min(r.speed) == r.speed(end); assert mean(r.speed) == 1 - exp(-1) +- 1e-5;",
        "run r = Decay for 1; assert integral(r.speed) == 1 - exp(-1) +- 1e-5; assert rms(r.speed) == sqrt((1 - exp(-2))/2) +- 1e-5;",
        "run r = Free for 2*pi/10 tolerance 1e-9; assert amplitude(r.wall.q, 10/(2*pi)) == 0.1 +- 1e-5;",
        "run r = Free for 10 tolerance 1e-9; assert abs(r.wall.energy + r.ball.energy - 0.5) < 1e-6;",
        "run r = Free for 0.1; assert r.energy.total(0) == 14.5 +- 1e-12;",
        "run r = Free for 1 tolerance 1e-9; assert r.v.f == {1, 2, 3}*exp(-r.time/2) +- 1e-8; assert r.v.f[2](end) == 2*exp(-0.5) +- 1e-8;",
        "run r = Free for 1; assert r.v.f == r.v.f[1]*{1, 2, 3} +- 1e-9; assert r.v.f(0) == {1, 2, 3};",
        "run r = Free for 1; assert r.R(0) == [1, 2; 3, 4]; assert r.R[2,1](end) == 3;",
        "run r = Decay for 1; assert (if r.speed > 0.5 then r.speed else 0.5) >= 0.5;",
        "expect error BG256 in Decay(mass(I = 0));",
        "expect error BG220 in Decay(c = 0);",
    ],
)
def test_holds(run: Run, statements: str) -> None:
    outcome = run(statements)
    assert outcome.passed, render(outcome.findings)


@pytest.mark.parametrize(
    ("statements", "shown"),
    [
        ("run r = Decay for 1; assert r.v.f(end) == 0.5 +- 1e-3;", "worst at time 1: value 0.36787"),
        ("run r = Decay for 1; assert r.v.f(end) == 0.5 +- 1e-3;", "wanted == 0.5, allowed +- 0.001"),
        ("run r = Decay for 1 interval 0.5; assert r.v.f > 0.5;", "worst at time 1: value 0.36787"),
        ("run r = Decay for 1; assert r.v.f == 1 +- 10 %;", "wanted == 1, allowed +- 0.1"),
        ("run r = Free for 1; assert r.v.f(0) == {1, 2, 4} +- 0.1;", "worst at time 0, entry 3: value 3, wanted == 4"),
        # three entries and three rows must not be taken for each other
        ("run r = Free for 1 interval 0.5; assert r.v.f == r.v.f[1];", "worst at time 0, entry 3: value 3, wanted == 1"),
        ("run r = Decay for 1; assert r.v.f + 0*log(r.v.f - 2) == 0 +- 10;", "value nan"),
        ('run r = Decay for 1; assert r.v.f(0) == 2 "the start";', "assertion failed: the start"),
        ("run r = Decay for 1 interval 0.5; assert r.v.f > 2 or r.v.f > 0.5;", "is false, first at time 1"),
        ("assert 0*log(-1);", "is false"),
        ("expect error BG256 in Decay;", "expected BG256, and the model is right"),
        ("expect error BG401 in Decay(mass(I = 0));", "expected BG401, found BG256"),
    ],
)
def test_fails_and_shows_the_worst_point(run: Run, statements: str, shown: str) -> None:
    outcome = run(statements)
    assert not outcome.passed and not outcome.error
    assert shown in render(outcome.findings)


@pytest.mark.parametrize(
    ("statements", "code", "shown"),
    [
        ("run r = Dekay for 1;", "BG210", "did you mean `Decay`?"),
        ("run r = Decay(bb = 1);", "BG220", "did you mean `b`?"),
        ("run r = Decay experiment sloww;", "BG610", "did you mean `slow`?"),
        ('run r = Decay for 1 method "euler";', "BG613", "cvode-bdf"),
        ("run r = Decay for -1;", "BG613", "after the start"),
        ("run r = Decay for 1; assert r.v.g == 1;", "BG618", "did you mean `v.f`?"),
        ("run r = Decay for 1; assert rr.v.f == 1;", "BG652", "did you mean `r`?"),
        ("run r = Decay for 1; assert sine(r.v.f) == 1;", "BG652", "did you mean `sin`?"),
        ("run r = Decay for 1; assert r.v.f(2) == 1;", "BG653", "time 2 lies outside the run, 0 to 1"),
        ("run r = Decay for 1; assert r;", "BG653", "`r` is a run"),
        ("run r = Free for 1; assert r.v.f == {1, 2};", "BG653", "arrays of 2 and of 3 entries"),
        ("run r = Free for 1; assert r.v.f[1.5] == 1;", "BG653", "one whole number"),
        ("run r = Free for 1; assert r.v.f[4](0) == 1;", "BG618", "did you mean `v.f["),
        ("run r = Decay for 1; assert max(2) == 1;", "BG653", "`max` is of a signal"),
        ("run r = Decay for 1; assert amplitude(r.v.f) == 1;", "BG653", "does not take 1 values"),
        ('run r = Decay for "long";', "BG653", "a number is needed"),
        ("run r = Decay for 1 method 2;", "BG653", "named in quotes"),
        ("run r = Decay(b = nothing);", "BG230", "not found in `Decay`"),
        ("run r = Decay for 1; assert r.v.f(0):3 == 1;", "BG653", "cannot stand in a test"),
        ("run r = Decay for 1 tolerance 0;", "BG613", "tolerance"),
        ("run r = Decay(b = -1e9) for 1;", "BG6", "needed here"),
        ('assert "a" == "b";', "BG653", "texts cannot be compared"),
        ('assert -"a" < 1;', "BG653", "a text is not a number"),
        ("run r = Decay; run r = Decay;", "BG653", "there is a run `r` already"),
        ("expect error BG999 in Decay;", "BG652", "there is no diagnostic BG999"),
        ('run r = csv("absent.csv");', "BG616", "absent.csv"),
    ],
)
def test_cannot_be_carried_out(run: Run, statements: str, code: str, shown: str) -> None:
    outcome = run(statements)
    assert outcome.error
    assert [d.code.number for d in outcome.findings][-1].startswith(code)
    text = render(outcome.findings)
    assert shown in text and "command line" not in text and "Decay in test" not in text
    assert all(any(label.span.place.startswith(str(outcome.file)) for label in (d.primary, *d.others)) for d in outcome.findings)


def test_an_error_spoils_only_what_needs_it(run: Run) -> None:
    outcome = run("run bad = Decay(bb = 1);  run r = Decay for 1;  assert bad.v.f == 1;  assert r.v.f(0) == 2;  assert r.x == 1;")
    assert [d.code.number for d in outcome.findings] == ["BG220", "BG650", "BG618"]


def test_the_worst_point_as_data(run: Run) -> None:
    outcome = run("run r = Free for 1 interval 0.5; assert r.v.f <= 2.5 +- 0.1;")
    (worst,) = outcome.worst.values()
    assert (worst.time, worst.entry, worst.value, worst.wanted, worst.allowed) == (0.0, 3, 3.0, 2.5, 0.1)


def test_a_reference_file(tmp_path: Path) -> None:
    rows = "".join(f"{t / 10},{math.exp(-t / 10)},{t}\n" for t in range(11))
    (tmp_path / "ref.csv").write_text("time,speed,v[1]\n" + rows)
    (tmp_path / "untimed.csv").write_text("a,b\n1,2\n")
    path = tmp_path / "case.bg"
    path.write_text(
        DECAY
        + 'test "agrees" run ref = csv("ref.csv"); run r = Decay for 2 tolerance 1e-8; assert r.speed == ref.speed +- 1e-5;'
        + " assert ref.v[1](end) == 10; end;\n"
        + 'test "differs" run ref = csv("ref.csv"); run r = Decay(b = 2) for 2; assert ref.speed == r.speed +- 1e-2; end;\n'
        + 'test "column" run ref = csv("ref.csv"); assert ref.speeed == 0; end;\n'
        + 'test "time" run ref = csv("untimed.csv"); end;\n'
    )
    agrees, differs, column, untimed = run_file(path)
    assert agrees.passed, render(agrees.findings)
    assert "worst at time 0.7: value 0.4965853" in render(differs.findings)  # exp(-t) - exp(-2 t) is largest at log 2
    assert "did you mean `speed`?" in render(column.findings)
    assert "no column `time`" in render(untimed.findings)


def test_full_against_reduced(tmp_path: Path) -> None:
    (tmp_path / "full.bg").write_text(DECAY)
    (tmp_path / "reduced.bg").write_text(DECAY.replace("R = b", "R = 1.01*b"))
    path = tmp_path / "case.bg"
    text = 'test "near" run a = Decay for 1; run b = Less for 1; assert a.v.f == b.v.f +- {}; end;'
    text = "import full.Decay; import Less = reduced.Decay;" + text
    path.write_text(text.format("0.01"))
    assert run_file(path)[0].passed
    path.write_text(text.format("1e-4"))
    assert not run_file(path)[0].passed


def test_collecting(tmp_path: Path) -> None:
    (tmp_path / "b.bg").write_text('test "x" assert 1 > 0; end;')
    (tmp_path / "a.bg").write_text("model A end A;")
    assert collect([tmp_path]) == [tmp_path / "b.bg"]
    assert [o.name for o in run_file(tmp_path / "b.bg", only="y")] == []


@pytest.mark.parametrize(("wanted", "steps"), [(1e-6, 1e-9), (1e-9, 1e-12), (1e-11, 1e-12), (1e-13, 1e-13), (-1.0, -1.0)])
def test_tolerance_of_the_steps(wanted: float, steps: float) -> None:
    assert step_tolerance(wanted) == pytest.approx(steps, rel=1e-12)


@pytest.mark.parametrize("number", ["BG650", "BG651", "BG652", "BG653"])
def test_the_examples_of_a_page(number: str, tmp_path: Path) -> None:
    page = explanation(number)
    assert page is not None
    path = tmp_path / "example.bg"
    wrong, right = (block.partition("```")[0] for block in page.split("```bg\n")[1:])
    path.write_text(wrong)
    assert [d.code.number for outcome in run_file(path) for d in outcome.findings] == [number]
    path.write_text(right)
    assert all(outcome.passed for outcome in run_file(path))
