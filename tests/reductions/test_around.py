"""Compare, verify, search, element elimination and repair."""

from __future__ import annotations

import math

import numpy as np
import pytest
from driving import condition, measure, provenance

from bgdsl import pipeline
from bgdsl.diagnostics import BgError
from bgdsl.expr import evaluate
from bgdsl.ir.activity import ActivityReport
from bgdsl.reductions.certificate import leak
from bgdsl.reductions.compare import Shaft, compare_output
from bgdsl.reductions.condition import Decision, decide
from bgdsl.reductions.mora import eliminate, least_active
from bgdsl.reductions.repair import repaired
from bgdsl.reductions.rewrite_source import rewrite
from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.verify import verify
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.options import Settings
from bgdsl.simulate.run import simulate


def signal(amplitude: float, phase: float, mean: float) -> dict[str, np.ndarray]:
    time = np.linspace(0, 4, 4001)
    return {
        "time": time,
        "y": mean + amplitude * np.sin(2 * math.pi * 5 * time + phase) + 0.5 * np.sin(2 * math.pi * 10 * time),
        "angle": 2 * math.pi * 2.5 * time,
    }


def test_compare_finds_harmonics_means_and_errors() -> None:
    full, reduced = signal(2.0, 0.3, 7.0), signal(1.9, 0.4, 7.5)
    found = compare_output("y", "N", full["time"], full["y"], reduced["y"])
    assert found.mean == (pytest.approx(7.0, abs=1e-6), pytest.approx(7.5, abs=1e-6))
    first, other = found.harmonics[0]
    assert first.frequency == pytest.approx(5.0, abs=0.01)
    assert (first.amplitude, other.amplitude) == (pytest.approx(2.0, rel=1e-3), pytest.approx(1.9, rel=1e-3))
    assert other.phase - first.phase == pytest.approx(0.1, abs=1e-3)
    assert found.harmonics[1][0].frequency == pytest.approx(10.0, abs=0.01)
    step = np.hypot(1.9 * np.cos(0.1) - 2.0, 1.9 * np.sin(0.1)) / math.sqrt(2)
    assert found.nrms == pytest.approx(math.hypot(step, 0.5) / math.sqrt(2.0**2 / 2 + 0.5**2 / 2), rel=1e-4)


def test_compare_counts_orders_of_a_shaft() -> None:
    one = signal(2.0, 0.3, 7.0)
    shaft = Shaft(one["angle"], cycles=4)
    found = compare_output("y", "N", one["time"], one["y"], one["y"], shafts=(shaft, shaft))
    assert [full.order for full, _ in found.harmonics[:2]] == [pytest.approx(2.0), pytest.approx(4.0)]
    assert found.harmonics[0][0].amplitude == pytest.approx(2.0, rel=1e-6)
    assert found.nrms == 0.0


def test_the_reduced_lever_has_the_published_error(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    reduced = pipeline.loads(condition(lever, lever_report, 0.025)[0].text)
    runs = []
    for model in (lever, reduced):
        options = model.compile().options("kick", {"s": 0.1}, Settings(method="rk45", tolerance=1e-7, variables=("vA.f",)))
        runs.append(simulate(DirectModel(model.program), options))
    found = compare_output("vA.f", "m/s", runs[0].time, runs[0]["vA.f"], runs[1]["vA.f"])
    assert found.nrms == pytest.approx(0.0168, abs=0.00005)


def test_verify_names_what_is_active_again(lever: pipeline.Model) -> None:
    then = measure(lever, "kick", tolerance=1e-7, changes={"s": 0.1})
    now = measure(lever, "kick", tolerance=1e-7, changes={"s": 1.0})
    dropped = decide(lever.scalar, then, 0.003).dropped
    (back,) = verify(dropped, then, now, lambda old, new: new.rho >= 0.003)
    assert (back.junction, back.name) == ("vA", "lever")
    assert (back.old, back.new) == (pytest.approx(0.002, abs=1e-5), pytest.approx(0.0199, abs=1e-4))
    assert verify(dropped, then, then, lambda old, new: new.rho >= 0.003) == ()


def test_least_active_elements_are_eliminated(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    assert least_active(lever_report, 0.99) == ("damperB", "springB")
    decision = eliminate(lever.scalar, lever_report, 0.998)
    head = provenance(lever, lever_report, 0.002)
    result, _ = rewrite(lever.library, lever.scalar, lever_report, decision, head)
    assert "damperB" not in {e.name for e in pipeline.loads(result.text).graph.elements}
    assert result.forward == {"damperB": None}


def test_a_text_that_does_not_compile_is_repaired(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    decision = Decision(0.5, frozenset({3, 2, 11}), (), frozenset(), ())

    def write(d: Decision):  # type: ignore[no-untyped-def]
        yield rewrite(lever.library, lever.scalar, lever_report, d, provenance(lever, lever_report, 0.5))

    result, settled = repaired(lever.scalar, lever_report, decision, write, lambda text: "no damper" if "R damperB" not in text else None)
    assert "R damperB" in result.text
    assert 11 in settled.reinstated
    assert settled.fault == "no damper"


def test_a_form_that_does_not_compile_gives_way_to_the_next(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    decision = Decision(0.5, frozenset({3, 2, 11}), (), frozenset(), ())

    def write(d: Decision):  # type: ignore[no-untyped-def]
        for form in ("kept", "opened"):
            yield rewrite(lever.library, lever.scalar, lever_report, d, provenance(lever, lever_report, 0.5), form=form)

    result, settled = repaired(lever.scalar, lever_report, decision, write, lambda text: "wrong" if "// The" in text else None)
    assert result.opened
    assert result.reasons == ("wrong",)
    assert settled.dropped == decision.dropped
    assert not settled.reinstated


def test_what_cannot_be_written_at_all_is_refused_with_BG703(lever: pipeline.Model, lever_report: ActivityReport) -> None:  # noqa: N802
    def write(decision: Decision):  # type: ignore[no-untyped-def]
        raise UnwritableError((), "no form")

    with pytest.raises(BgError, match="BG703"):
        repaired(lever.scalar, lever_report, Decision(0.5, frozenset({3}), (), frozenset(), ()), write, lambda text: None)


def test_the_leak_certificate_closes(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    from test_condition import rates

    result, decision = condition(lever, lever_report, 0.025)
    reduced = pipeline.loads(result.text)
    at = {"massA_p": 70.0, "springA_q": 0.01, "massB_p": 0.3, "springB_q": -0.002}
    found = rates(reduced, **at)
    p = {"mA": 100.0, "kA": 1e5, "RA": 200.0, "mB": 0.5, "kB": 2000.0, "RB": 5.0, "ratio": 1.5}
    v_a, v_b = at["massA_p"] / p["mA"], at["massB_p"] / p["mB"]
    relative = p["ratio"] * v_a - v_b
    stored = v_a * found["massA.p"] + p["kA"] * at["springA_q"] * found["springA.q"]
    stored += v_b * found["massB.p"] + p["kB"] * at["springB_q"] * found["springB.q"]
    taken = p["RA"] * v_a**2 + p["RB"] * relative**2
    force = p["kB"] * at["springB_q"] + p["RB"] * relative
    values = {"vA.f": v_a, "F2.e": force, "lever.m": p["ratio"]}
    assert stored + taken == pytest.approx(evaluate(leak(lever.scalar, decision.dropped), values), rel=1e-12)
    assert evaluate(leak(lever.scalar, ()), values) == 0.0
