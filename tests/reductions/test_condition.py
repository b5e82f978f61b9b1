"""What is dropped, what never is, and how it is written."""

from __future__ import annotations

import numpy as np
import pytest
from driving import condition, measure

from bgdsl import pipeline
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.native import parameter_names
from bgdsl.reductions.condition import decide, parameter_values
from bgdsl.reductions.determined import reinstate
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.options import Settings
from bgdsl.simulate.run import simulate


def rates(model: pipeline.Model, **states: float) -> dict[str, float]:
    """The derivatives of a model at a state."""
    names = [record.name for record in model.program.states]
    direct = DirectModel(model.program)
    values = parameter_values(model.graph)
    direct.set_parameters(np.array([values[name] for name in parameter_names(model.program)]))
    out = np.zeros(len(names))
    assert direct.rhs(0.0, np.array([states[name.replace(".", "_")] for name in names]), np.zeros(0), out) == 0
    return dict(zip(names, out.tolist(), strict=True))


def test_the_lever_becomes_equations_7_and_8(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    result, decision = condition(lever, lever_report, 0.025)
    assert len(decision.dropped) == 1
    assert "MSf lever(f = ratio*vA.f);" in result.text
    assert "  // dropped at vA: effort of lever, rho = 1.99 %\n  lever -> F2;\n" in result.text
    reduced = pipeline.loads(result.text)
    assert reduced.check() == ()
    p = parameter_values(reduced.graph)
    at = {"massA_p": 70.0, "springA_q": 0.01, "massB_p": 0.3, "springB_q": -0.002}
    found = rates(reduced, **at)
    v_a, v_b = at["massA_p"] / p["mA"], at["massB_p"] / p["mB"]
    relative = p["ratio"] * v_a - v_b
    assert found["massA.p"] == pytest.approx(-p["RA"] * v_a - p["kA"] * at["springA_q"], rel=1e-12)  # (7): nothing of B
    assert found["massB.p"] == pytest.approx(p["kB"] * at["springB_q"] + p["RB"] * relative, rel=1e-12)  # (8)
    assert found["springB.q"] == pytest.approx(relative, rel=1e-12)


def test_untouched_lines_stay_and_the_rest_is_small(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    result, _ = condition(lever, lever_report, 0.025)
    before, after = lever.source.splitlines(), result.text.splitlines()
    assert sum(line not in after for line in before) == 2
    assert sum(line not in before for line in after) == 5  # the annotation takes two


def test_at_zero_nothing_changes(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    result, decision = condition(lever, lever_report, 0.0)
    assert result.text == lever.source
    assert not decision.dropped


def test_twice_is_once(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    once, _ = condition(lever, lever_report, 0.025)
    again = pipeline.loads(once.text)
    twice, decision = condition(again, measure(again, "kick", tolerance=1e-8), 0.025)
    assert twice.text == once.text
    assert not decision.dropped


def test_equal_inputs_write_equal_bytes(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    assert condition(lever, lever_report, 0.025)[0].text == condition(lever, lever_report, 0.025)[0].text


def dropped_names(text: str, threshold: float, **more: object) -> tuple[set[tuple[str, str]], dict[str, str]]:
    """(junction, term) of what is dropped, and the reasons of what stays."""
    model = pipeline.loads(text)
    report = measure(model, stop=2.0, interval=0.1, tolerance=1e-8, max_step=0.02)
    decision = decide(model.scalar, report, threshold, **more)  # type: ignore[arg-type]
    names = {t.index: (j.name, t.name) for j in report.junctions for t in j.terms}
    return {names[t] for t in decision.dropped}, {names[k.term][1]: k.reason for k in decision.kept}


def test_a_flow_source_at_a_1_junction_stays() -> None:
    found, kept = dropped_names(
        """model M
          J1 v;  Sf drive(f = sin(2*time));  I mass(I = 1);  C spring(k = 4, q(start = -0.5));  R loss(R = 1e-3);
        equation
          drive -> v;  v -> mass, spring, loss;
        end M;""",
        0.1,
        guard=False,
    )
    assert ("v", "drive") not in found
    assert kept["drive"] == "a flow source at a 1-junction"


def test_an_effort_source_at_a_0_junction_stays() -> None:
    found, kept = dropped_names(
        """model M
          J0 u;  Se drive(e = sin(2*time));  C tank(C = 1);  I coil(I = 0.25, p(start = -0.5));  R loss(R = 1e3);
        equation
          drive -> u;  u -> tank, coil, loss;
        end M;""",
        0.1,
        guard=False,
    )
    assert ("u", "drive") not in found
    assert kept["drive"] == "an effort source at a 0-junction"


PARASITIC = """model M
  J1 v;  I mass(I = 1, f(start = 1));  C spring(k = 10);  R tiny(R = 1e-6{flag});
equation
  v -> mass, spring, tiny;
end M;"""


def test_parasitic_elements_stay() -> None:
    assert ("v", "tiny") in dropped_names(PARASITIC.format(flag=""), 0.01)[0]
    found, kept = dropped_names(PARASITIC.format(flag=", parasitic = true"), 0.01)
    assert not found
    assert kept["tiny"] == "parasitic"


def test_bonds_that_lead_to_parasitic_elements_only_stay() -> None:
    found, _ = dropped_names(
        """model M
          J1 a;  I ma(I = 1, f(start = 1));  C ka(k = 10);  J1 b;  I mb(I = 1, f(start = 1));  C kb(k = 10);
          J0 gap;  J1 rel;  C stiff(k = 1e6, parasitic = true);  R loss(R = 10, parasitic = true);
        equation
          a -> ma, ka;  b -> mb, kb;  a -> gap;  gap -> b;  gap -> rel;  rel -> stiff, loss;
        end M;""",
        0.2,
        guard=False,
    )
    assert ("gap", "gap_rel") not in found


def test_a_junction_without_activity_is_left_alone_and_told() -> None:
    model = pipeline.loads(
        """model M
          J1 v;  I mass(I = 1, f(start = 1));  C spring(k = 10);
          J1 idle;  I still(I = 1);  C rest(k = 1);  R calm(R = 1);
        equation
          v -> mass, spring;  idle -> still, rest, calm;
        end M;"""
    )
    report = measure(model, stop=1.0, interval=0.1)
    decision = decide(model.scalar, report, 0.5)
    assert not decision.dropped
    assert [model.scalar.junctions[j].name for j in decision.unexcited] == ["idle"]


def test_two_terms_of_one_junction_stay(lever: pipeline.Model, lever_report: ActivityReport) -> None:
    decision = decide(lever.scalar, lever_report, 1.1, guard=False)
    assert all(len(lever.scalar.terms_at[lever.scalar.terms[t].junction]) > 2 for t in decision.dropped)


GUARDED = """model M "the weight moves little power, and it is what the spring carries in the end"
  J1 v;  I mass(I = 1, f(start = 100));  R brake(R = 200);  C spring(k = 1e3);  Se weight(e = 200);
equation
  v -> mass, brake, spring;  weight -> v;
end M;"""


def test_the_effort_guard_keeps_what_power_does_not_see() -> None:
    model = pipeline.loads(GUARDED)
    report = measure(model, stop=10.0, interval=0.1, tolerance=1e-8)
    (weight,) = (t for j in report.junctions for t in j.terms if t.name == "weight")
    threshold = (weight.rho + weight.strength) / 2
    assert weight.rho < threshold < weight.strength
    assert not decide(model.scalar, report, threshold).dropped
    assert weight.index in decide(model.scalar, report, threshold, guard=False).dropped


def test_a_modulus_that_can_vanish_is_not_divided_by() -> None:
    text = """model M
      J0 a;  I la(I = 1, f(start = 1));  I lb(I = 1, f(start = -0.999));
      MTF turn(m = {modulus});
      J1 b;  R rb(R = 1);  C cc(k = 1, q(start = 1e-3));
      Real phi(start = 0.3);
    equation
      a -> la, lb;  a -> turn -> b;  b -> rb, cc;  der(phi) = 1;
    end M;"""
    reason = "what took its place would divide by a modulus that can vanish"
    found, kept = dropped_names(text.format(modulus="1e-3*sin(phi)"), 0.01, guard=False)
    assert ("a", "turn") not in found
    assert reason in kept.values()
    found, kept = dropped_names(text.format(modulus="1e-3"), 0.01, guard=False)
    assert ("a", "turn") in found


def test_inactive_at_both_ends_goes_whole() -> None:
    model = pipeline.loads(
        """model M
          J1 a;  I ma(I = 1, f(start = 1));  C ka(k = 1);
          TF weak(m = 1e-4) "hardly couples";
          J0 b;  C kb(C = 1, q(start = 1));  I mb(I = 1);
        equation
          a -> ma, ka;  a -> weak -> b;  b -> kb, mb;
        end M;"""
    )
    report = measure(model, stop=2.0, interval=0.1, tolerance=1e-8)
    result, _ = condition(model, report, 0.01)
    assert "weak(" not in result.text
    assert "-> weak" not in result.text
    assert pipeline.loads(result.text).check() == ()


def test_an_element_that_is_read_stays_as_an_observer() -> None:
    model = pipeline.loads(
        """model M
          J1 v;  I mass(I = 1, f(start = 1));  C spring(k = 10);  R tiny(R = 1e-6);
          output Real loss = tiny.e;
        equation
          v -> mass, spring, tiny;
        end M;"""
    )
    report = measure(model, stop=2.0, interval=0.1, tolerance=1e-8)
    result, _ = condition(model, report, 0.01)
    assert "MSf tiny_drive(f = v.f);" in result.text
    reduced = pipeline.loads(result.text)
    assert rates(reduced, mass_p=2.0, spring_q=0.1)["mass.p"] == -1.0
    options = reduced.compile().options(None, {}, Settings(method="rk45", stop=1.0, interval=0.1, variables=("loss", "v.f")))
    run = simulate(DirectModel(reduced.program), options)
    assert np.allclose(run["loss"], 1e-6 * run["v.f"], rtol=1e-12)


def test_a_junction_without_determiner_gets_its_largest_term_back() -> None:
    model = pipeline.loads(
        """model M
          J0 a;  C ca(C = 1, q(start = 1));  R ra(R = 0.1);  I la(I = 1);
          J1 weak;  R small(R = 1e3);
          J0 b;  C cb(C = 1, q(start = 1.001));  R rb(R = 0.1);  I lb(I = 1);
        equation
          a -> ca, ra, la;  a -> weak;  weak -> small, b;  b -> cb, rb, lb;
        end M;"""
    )
    scalar = model.scalar
    report = measure(model, stop=1.0, interval=0.1, tolerance=1e-9)
    decision = decide(scalar, report, 0.01)
    settled = reinstate(scalar, report, decision)
    result, _ = condition(model, report, 0.01)
    assert pipeline.loads(result.text).check() == ()
    assert settled.reinstated
    names = {t.index: t for j in report.junctions for t in j.terms}
    for t in settled.reinstated:
        at = scalar.terms_at[scalar.terms[t].junction]
        assert names[t].activity == max(names[o].activity for o in at if o in decision.dropped or o == t)
