"""Parts of models in the author's classes and arrays say what the oracle says: random hierarchies, random sets of dropped ends."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from driving import provenance
from oracle import derivatives, solution
from random_hierarchy import random_hierarchy
from test_oracle import even_report, random_decision, rates

from bgdsl import pipeline
from bgdsl.expr import evaluate, var
from bgdsl.ir.native import parameter_names
from bgdsl.passes.dependencies import dependencies
from bgdsl.passes.subgraphs import partitions
from bgdsl.reduce import tidy
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.determined import gone_elements
from bgdsl.reductions.part import everything
from bgdsl.reductions.partition import Partitioning, write_partitions
from bgdsl.reductions.structured_text import structured_text
from bgdsl.simulate.direct import DirectModel

ROOT = Path(__file__).parents[2]


def random_states(model: pipeline.Model, rng: random.Random) -> dict[str, float]:
    return {record.name: rng.uniform(-1, 1) for record in model.program.states}


@pytest.mark.parametrize("seed", range(10))
def test_a_hierarchy_with_dropped_terms_equals_the_oracle(seed: int) -> None:
    model = pipeline.loads(random_hierarchy(seed), "Net")
    model.check()
    rng = random.Random(seed)
    states = random_states(model, rng)
    assert rates(model, states) == pytest.approx(derivatives(model.scalar, frozenset(), frozenset(), states), abs=1e-9)
    for share in (0, 1):
        report = even_report(model.scalar)
        dropped = random_decision(model.scalar, report, rng).dropped if share else frozenset()
        decision = random_decision(model.scalar, report, rng)
        dropped = decision.dropped if share else frozenset()
        gone = gone_elements(model.scalar, decision) if share else frozenset()
        new = structured_text(model.scalar, everything(model.scalar, dropped, gone), "", lambda told: f"at {told[0][0]}, rho = 1")
        assert tidy(tidy(new.text)) == tidy(new.text)
        again = pipeline.loads(tidy(new.text), "Net")
        again.check()
        wanted = derivatives(model.scalar, dropped, gone, states)
        moved = {state: new.forward.get(state, state) for state in wanted}
        found = rates(again, {str(moved[state]): states[state] for state in wanted})
        assert {moved[state]: value for state, value in wanted.items()} == pytest.approx(found, abs=1e-9)
        if not share:
            assert all(moved[state] == state for state in states)  # nothing is cut, so nothing is opened


@pytest.mark.parametrize("seed", range(10))
def test_partitions_of_a_hierarchy_equal_the_oracle(seed: int) -> None:
    """Each part alone, given what the others pass to it."""
    model = pipeline.loads(random_hierarchy(seed), "Net")
    scalar, rng = model.scalar, random.Random(seed)
    states = random_states(model, rng)
    report = even_report(scalar)
    decision = random_decision(scalar, report, rng)
    found = partitions(scalar, dependencies(scalar, decision.dropped))
    written = write_partitions(scalar, report, Partitioning(decision, found), provenance(model, report, 0.5), "net")
    known = solution(scalar, decision.dropped, gone_elements(scalar, decision), states)
    wanted = derivatives(scalar, decision.dropped, gone_elements(scalar, decision), states)
    seen: set[str] = set()
    for part in written:
        again = pipeline.loads(tidy(part.text), f"Net_{part.partition.number + 1}_{part.partition.role}")
        values = {name: evaluate(var(v), known) for v, name in part.inputs.items()}
        assert {record.name for record in again.program.inputs} == set(values)
        own = {state: part.forward.get(state, state) for state in part.partition.states if state in wanted}
        given = given_rates(again, {str(own[state]): states[state] for state in own}, values)
        assert {own[state]: wanted[state] for state in own} == pytest.approx(given, abs=1e-9)
        seen |= set(own)
    assert seen == set(wanted)


def given_rates(model: pipeline.Model, states: dict[str, float], inputs: dict[str, float]) -> dict[str, float]:
    direct = DirectModel(model.program)
    values = parameter_values(model.graph)
    direct.set_parameters(np.array([values[name] for name in parameter_names(model.program)]))
    names = [record.name for record in model.program.states]
    out = np.zeros(len(names))
    u = np.array([inputs[record.name] for record in model.program.inputs])
    assert direct.rhs(0.0, np.array([states[name] for name in names]), u, out) == 0
    return dict(zip(names, out.tolist(), strict=True))


def test_a_model_of_which_all_is_there_is_written_as_its_author_did() -> None:
    model = pipeline.load(ROOT / "models" / "engine.bg", "Engine")
    part = everything(model.scalar, frozenset(), frozenset())
    new = structured_text(model.scalar, part, "", lambda _: "", folder=ROOT / "models")
    for said in (
        "Cylinder cyl[6](",
        "each speed = speed",
        "pin = pin",
        "Side pins[6](axes(each T = crank.R)",
        "HeavyBody crank(m = 300, ",
        "I[3] mass(I = m*identity(3), f(start = v0))",
        "EJS[3] coriolis(G = m*skew(w.f))",
        "MTF[3, 3] v_to_block[6](each T = transpose(block.R))",
        "cyl[i].piston_v => v_to_block[i] => bore[i].gap;",
        "MTF[3, 3] arm(T = -skew(r))",
        "point.sum => axes => p;",
    ):
        assert said in new.text, said
    assert not new.inputs
    assert not any(path.rpartition(".")[2][0] in "pq" for path in new.forward)


def test_a_part_s_parameters_can_still_be_changed() -> None:
    model = pipeline.loads(random_hierarchy(3), "Net")
    new = structured_text(model.scalar, everything(model.scalar, frozenset(), frozenset()), "", lambda _: "")
    again = pipeline.loads(new.text, "Net")
    states = random_states(model, random.Random(1))
    for name in ("pair[2].two.m", "pair[1].link.k", "k0", "pair[1].one.d[2]"):
        changed = {name: 5.0}
        assert rates_with(again, states, changed) == pytest.approx(rates_with(model, states, changed), rel=1e-12)
        assert rates_with(again, states, changed) != pytest.approx(rates(model, states), rel=1e-6)


def rates_with(model: pipeline.Model, states: dict[str, float], changed: dict[str, float]) -> dict[str, float]:
    direct = DirectModel(model.program)
    values = parameter_values(model.graph, changed)
    direct.set_parameters(np.array([values[name] for name in parameter_names(model.program)]))
    names = [record.name for record in model.program.states]
    out = np.zeros(len(names))
    assert direct.rhs(0.0, np.array([states[name] for name in names]), np.zeros(0), out) == 0
    return dict(zip(names, out.tolist(), strict=True))


def test_experiments_and_tables_of_parts_stay(tmp_path: Path) -> None:
    (tmp_path / "ramp.csv").write_text("x,y\n0,0\n1,2\n2,3\n", "utf-8")
    (tmp_path / "table.bg").write_text(
        """model Springs
  parameter Real stiffer = 7 "read by an experiment alone";
  parameter Real i = 2 "a name that iterators have";
  Spring s[3](k = {1, 2, 3});
  J1 v[3];  I m[3](each I = 1, f(start = {1, 0.5, 0.25}));  R film(R = i*pi);
  experiment soft(stopTime = 1, s[2].k = stiffer/2);
equation
  for j in 1:3 loop v[j] -> m[j];  v[j] -> s[j].a;  end for;
  v[1] -> film;
end Springs;

model Spring
  parameter Real k = 1;
  parameter Table force = table("ramp.csv", x = "x", y = "y", kind = "linear");
  port in Generic a;
  C c(e = k*force(q));
equation
  a -> c;
end Spring;
""",
        "utf-8",
    )
    model = pipeline.load(tmp_path / "table.bg", "Springs")
    new = structured_text(model.scalar, everything(model.scalar, frozenset(), frozenset()), "", lambda _: "", folder=tmp_path)
    for said in (
        'force = table("ramp.csv"',
        "s[2].k = stiffer/2",
        "Spring s[3](k = {1, 2, 3})",
        "R film(R = pi*i)",
        "v[i] -> m[i], s[i].a;",
    ):
        assert said in new.text, new.text
    (tmp_path / "new.bg").write_text(new.text, "utf-8")
    assert [found for found in pipeline.check_file(tmp_path / "new.bg") if found.severity == "error"] == []
    again = pipeline.load(tmp_path / "new.bg", "Springs")
    states = random_states(model, random.Random(1))
    assert rates(again, states) == pytest.approx(rates(model, states), rel=1e-12)
    runs = [one.compile().simulate("soft", interval=0.1, tolerance=1e-9)["s[2].c.q"] for one in (model, again)]
    assert runs[0] == pytest.approx(runs[1], rel=1e-6)


def test_a_class_by_itself_is_no_mistake(tmp_path: Path) -> None:
    for seed in range(3):
        model = pipeline.loads(random_hierarchy(seed), "Net")
        scalar, rng = model.scalar, random.Random(seed)
        report = even_report(scalar)
        decision = random_decision(scalar, report, rng)
        found = partitions(scalar, dependencies(scalar, decision.dropped))
        for part in write_partitions(scalar, report, Partitioning(decision, found), provenance(model, report, 0.5), "net")[:4]:
            (tmp_path / part.file).write_text(part.text, "utf-8")
            assert [d.message for d in pipeline.check_file(tmp_path / part.file) if d.severity == "error"] == []
