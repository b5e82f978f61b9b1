"""The paper's reductions again: what falls, what comes apart, how accurate and how fast the rest is. Every number of docs/engine-study.md.

    python benchmarks/reduction_study.py [--write] [--files] [--search]

prints the tables; --write puts them into docs/engine-study.md; --files writes the reduced models anew into models/reduced; --search
looks for the smallest engines again, which takes minutes: else their files name the terms that were found.

Amplitudes are those of engine_study.py: last four cycles of 4 s, by order. Times are of one simulated second at 1e-6, after everything
has been compiled; the models take turns, seven rounds at slightly different tolerances, and the median counts: a stiff solver's number of
steps is a matter of chance within some 15 %.
"""

from __future__ import annotations

import argparse
import math
import re
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import engine_study
import numpy as np

from bgdsl import pipeline
from bgdsl.expr import topological
from bgdsl.ir.program import Assign, Program, SolveLinear, SolveNewton
from bgdsl.passes.dependencies import dependencies
from bgdsl.playback import STEPS, play, recording_times
from bgdsl.reduce import Measured, Partitioned, Scenario, condition, holdable, measure, partition, reduced
from bgdsl.reductions.condition import decide
from bgdsl.searching import Searched, smallest
from bgdsl.verification import Verification, reduction_of, verify_reduced

ROOT = Path(__file__).parent.parent
MODELS = ROOT / "models"
REDUCED = MODELS / "reduced"
THRESHOLD, CONDITIONED_AT = 0.0035, 0.003
OUTPUTS = ("front_mount_force", "left_rear_mount_force", "right_rear_mount_force", "crank_speed", "crank_angle", "piston_displacement")
FORCES = OUTPUTS[:3]
RECORDED_EVERY = 4e-4
"""s: what the table of playback shows to be fine enough, the start apart."""
ALLOWED = 0.08
"""The error of a force component that the smallest model may make."""

IDEAL_TRIES = 60
"""Of the engine with ideal joints so many models are tried, and then the few that have to be written."""

PAPER_TABLE_5 = (
    ("front x", 0.055, 0.058),
    ("front y", 78.0, 80.0),
    ("front z", 4.2, 4.25),
    ("left x", 0.81, 0.87),
    ("left y", 53.0, 55.0),
    ("left z", 60.0, 61.0),
    ("right x", 0.90, 0.97),
    ("right y", 53.0, 55.0),
    ("right z", 62.0, 63.0),
)
"""The paper's Table 5: third order of the balanced engine in N, full and partitioned."""


@dataclass(frozen=True)
class Small:
    """A small structure: file, model, experiment, threshold, what it shows."""

    file: str
    model: str
    experiment: str
    threshold: float


SMALL = (
    Small("lever_stiff.bg", "LeverStiff", "light", 0.003),
    Small("half_car.bg", "HalfCar", "bump", 0.003),
    Small("half_car.bg", "HalfCar", "soft_rear", 0.003),
    Small("drive_line.bg", "DriveLine", "pull", 0.01),
    Small("hydraulic_servo.bg", "HydraulicServo", "follow", 0.02),
    Small("dc_motor.bg", "DcMotor", "run_up", 0.003),
    Small("dc_motor.bg", "DcMotor", "heavy", 0.003),
)


# ------------------------------------------------------------------------------------------------------------ reductions


def measured(file: str, model: str, experiment: str) -> Measured:
    """A model of models/ with its activities."""
    return measure(pipeline.load(MODELS / file, model), Scenario(experiment))


def engine_partitions(found: Measured) -> Partitioned:
    """The balanced engine's partitions that feed the outputs, as they are committed."""
    return partition(found, THRESHOLD, stem="engine", folder=REDUCED / "engine_balanced", outputs=OUTPUTS)


EIGHT, IDEAL_EIGHT = "engine_misfire_8_percent.bg", "engine_ideal_misfire_8_percent.bg"


def ideal_misfire() -> Measured:
    """The engine with ideal joints, misfiring, with its activities."""
    return measured("engine_ideal.bg", "EngineIdeal", "misfire_settled")


def write_smallest(found: Measured, file: Path) -> None:
    """An engine's smallest model anew, by the choice that its file's annotation names."""
    file.write_text(reduced(found, reduction_of(file).choice, folder=file.parent).source, "utf-8")


def search_anew(found: Measured, file: Path, most: float = math.inf) -> Searched:
    """The smallest model of an engine, looked for and written."""
    searched = smallest_engine(found, file, most)
    assert searched.reduced is not None
    file.write_text(searched.reduced.source, "utf-8")
    return searched


def smallest_engine(found: Measured, file: Path, most: float = math.inf) -> Searched:
    """The smallest model of an engine whose force components err by no more than `ALLOWED`, at equal crank angles."""
    return smallest(found, ALLOWED, outputs=FORCES, folder=file.parent, file=file.name, shaft="crank_angle", most=most)


def small_partitions(found: Measured, small: Small) -> Partitioned:
    """A small structure's partitions, as they are committed."""
    stem = small.file.removesuffix(".bg")
    return partition(found, small.threshold, stem=stem, folder=REDUCED / f"{stem}_{small.experiment}")


def write_partition(found: Partitioned, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.bg"):
        old.unlink()
    for written in found.files:
        (folder / written.file).write_text(written.text, "utf-8")
    (folder / "partition.json").write_text(found.document + "\n", "utf-8")


def write_files(balanced: Measured, misfire: Measured, small: Mapping[Small, Measured]) -> None:
    """models/reduced, anew; the smallest engines by the terms that their files name."""
    write_partition(engine_partitions(balanced), REDUCED / "engine_balanced")
    (REDUCED / "engine_misfire_conditioned.bg").write_text(condition(misfire, CONDITIONED_AT, folder=REDUCED).source, "utf-8")
    write_smallest(misfire, REDUCED / EIGHT)
    write_smallest(ideal_misfire(), REDUCED / IDEAL_EIGHT)
    for one, found in small.items():
        apart = small_partitions(found, one)
        stem = one.file.removesuffix(".bg")
        if apart.files:
            write_partition(apart, REDUCED / f"{stem}_{one.experiment}")
        reduced = condition(found, one.threshold, folder=REDUCED)
        if reduced.decision.dropped:
            (REDUCED / f"{stem}_{one.experiment}.bg").write_text(reduced.source, "utf-8")


# ---------------------------------------------------------------------------------------------------------------- tables


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(map(str, row)) + " |" for row in rows)])


def reach(found: Measured, threshold: float, target: str = "crank.w[1]") -> tuple[int, int]:
    """How many terms fall at a threshold, and how many states the crank's spin then still depends on."""
    scalar, report = found.model.scalar, found.report
    decision = decide(scalar, report, threshold)
    needs = dependencies(scalar, decision.dropped)
    held = holdable(found, threshold)
    readers: dict[int, list[int]] = defaultdict(list)
    for edge in needs.edges:
        if edge not in held or held[edge].change >= threshold:
            readers[edge.reader].append(edge.source)
    start = next(k for k, junction in enumerate(scalar.junctions) if junction.name == target)
    seen, waiting = {start}, [start]
    while waiting:
        for node in readers[waiting.pop()]:
            if node not in seen:
                seen.add(node)
                waiting.append(node)
    kinds = {element.name: element for element in scalar.graph.elements}
    stores = sum(t.other is None and bool(kinds[t.element or ""].states) and t.junction in seen for t in scalar.terms)
    integrated = {name for signal in scalar.graph.signals if signal.role == "state" for name in signal.scalars()}
    signals = sum(needs.signals[node - needs.junctions] in integrated for node in seen if node >= needs.junctions)
    return len(decision.dropped), stores + signals


def reach_table(balanced: Measured, misfire: Measured) -> str:
    rows = []
    for eps in (0.002, 0.003, 0.0032, 0.0034, 0.0035, 0.005, 0.01, 0.05, 0.08):
        one, two = reach(balanced, eps), reach(misfire, eps)
        rows.append((f"{100 * eps:g} %", one[0], one[1], two[0], two[1]))
    return table(("threshold", "balanced: terms dropped", "states that reach the spin", "misfire: terms dropped", "states"), rows)


def states_by_kind(states: Iterable[str]) -> str:
    """State names with the cylinders counted together."""
    kinds: dict[str, int] = defaultdict(int)
    for state in states:
        kinds[re.sub(r"(cyl|bore)\[\d\]", r"\1[i]", state)] += 1
    return ", ".join(f"`{kind}`" + (f" x {count}" if count > 1 else "") for kind, count in kinds.items())


def partition_table(whole: Partitioned) -> str:
    rows = [
        (p.number + 1, p.role, len(p.states), ", ".join(str(d + 1) for d in p.drivers) or "-", states_by_kind(p.states))
        for p in whole.found.partitions.partitions
    ]
    return table(("", "role", "states", "driven by", "states by name"), rows)


def term_table(found: Measured, whole: Partitioned, reader: int) -> str:
    """The terms that fall at the boundary of a partition, the cylinders together: the paper's Table 4."""
    scalar, records = found.model.scalar, found.report.by_index()
    of_node, names = whole.found.partitions.of_node, {j.index: j for j in found.report.junctions}
    groups: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for t in sorted(whole.found.decision.dropped):
        if of_node[scalar.terms[t].junction] == reader:
            junction, record = names[scalar.terms[t].junction], records[t]
            what = "effort" if junction.kind == 1 else "flow"
            place, name = (re.sub(r"(cyl|bore|pins|v_to_block|w_to_block)\[\d\]", r"\1[i]", text) for text in (junction.name, record.name))
            name = re.sub(r"bore_\d", "bore_i", name)
            groups[what, place, name].append(record.rho)
    rows = [(what, f"`{place}`", f"`{name}`", len(rhos), _range(rhos)) for (what, place, name), rhos in groups.items()]
    return table(("", "dropped from the balance of", "term", "times", "rho, %"), sorted(rows, key=lambda r: (r[0], r[1], r[2])))


def _range(rhos: Sequence[float]) -> str:
    low, high = (f"{100 * rho:.2g}" if rho < 0.1 else f"{100 * rho:.0f}" for rho in (min(rhos), max(rhos)))
    return low if low == high else f"{low} to {high}"


# -------------------------------------------------------------------------------------------------------------- accuracy


@dataclass(frozen=True)
class Signals:
    """A run's signals under the names that engine_study.amplitudes asks for."""

    time: Any
    signals: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.signals[name]


def orders(path: Path, experiment: str) -> dict[str, Any]:
    """Amplitudes of the nine force components and the speed over the last four cycles of 4 s."""
    run = play(path, Scenario(experiment, None, {"stop": 4.0, "tolerance": 1e-8}))
    return engine_study.amplitudes(Signals(run.time, run.signals))


def amplitude_table_5(full: Mapping[str, Any], parts: Mapping[str, Any]) -> str:
    """Third order of the balanced engine, full and partitioned, ours and the paper's."""
    rows = []
    for k, (name, paper_full, paper_parts) in enumerate(PAPER_TABLE_5):
        one, two = full["3"][k], parts["3"][k]
        numbers = (f"{one:.3g}", f"{two:.3g}", f"{100 * (two / one - 1):+.1f} %", f"{paper_full:g}", f"{paper_parts:g}")
        rows.append((name, *numbers, f"{100 * (paper_parts / paper_full - 1):+.1f} %"))
    return table(("", "full, N", "partitioned, N", "error", "paper: full", "partitioned", "error"), rows)


def misfire_table(models: Mapping[str, Mapping[str, Any]]) -> str:
    """Amplitudes of the misfiring engine by order: N (rad/s), and each reduced model's error."""
    full = models["full"]
    head = ("", "Front x", "y", "z", "Left x", "y", "z", "Right x", "y", "z", "speed")
    rows: list[tuple[str, ...]] = []
    for order in ("0.5", "1", "3"):
        rows.append((f"order {order}: full", *(f"{value:.4g}" for value in full[order])))
        for name, found in models.items():
            if name != "full":
                rows.append((f"{name}, %", *(f"{100 * (b / a - 1):+.1f}" for a, b in zip(full[order], found[order], strict=True))))
    return table(head, rows)


def variant_table(misfire: Measured, full: Mapping[str, Any]) -> str:
    """What the effort guard, and a single element, do to the model conditioned at 0.3 %."""
    import tempfile

    rows = []
    folder = Path(tempfile.mkdtemp(prefix="bgdsl-study-"))
    variants: dict[str, dict[str, bool]] = {
        "as committed": {},
        "elements stay": {"elements": False},
        "without the effort guard": {"guard": False},
    }
    for k, (name, how) in enumerate(variants.items()):
        reduced = condition(misfire, CONDITIONED_AT, folder=folder, **how)
        path = folder / f"variant_{k}.bg"
        path.write_text(reduced.source, "utf-8")
        found = orders(path, "misfire")
        scalar, records = misfire.model.scalar, misfire.report.by_index()
        fallen = [records[t].name for t in reduced.decision.dropped if scalar.terms[t].other is None]
        change = [f"{100 * (found[order][2] / full[order][2] - 1):+.1f} %" for order in ("0.5", "1")]
        rows.append((name, len(reduced.decision.dropped), ", ".join(f"`{e}`" for e in sorted(fallen)) or "none", *change))
    return table(("", "terms dropped", "elements among them", "front z, order 0.5", "order 1"), rows)


def worst(full: Mapping[str, Any], reduced: Mapping[str, Any], wanted: Sequence[str], floor: float = 1.0) -> float:
    """The largest relative error of force components above `floor` newtons."""
    return max(abs(b / a - 1) for order in wanted for a, b in zip(full[order][:9], reduced[order][:9], strict=True) if a > floor)


# ---------------------------------------------------------------------------------------------------------------- verify


def verify_table(found: Verification) -> tuple[str, tuple[float, float]]:
    """Terms to reinstate, the cylinders together; the mean old and new rho of crank translation at the crank pins."""
    groups: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for term in found.terms:
        place, name = (re.sub(r"(cyl|pins|v_to_block)\[\d\]", r"\1[i]", text) for text in (term.junction, term.name))
        groups[place, name].append((term.old, term.new))
    rows = [(f"`{p}`", f"`{n}`", len(v), _range([old for old, _ in v]), _range([new for _, new in v])) for (p, n), v in groups.items()]
    crank = [(t.old, t.new) for t in found.terms if re.fullmatch(r"pins\[\d\]\.point\.v_sum\[[23]\]", t.name)]
    text = table(("to reinstate at", "term", "times", "rho before, %", "rho now, %"), rows)
    return text, (statistics.mean(old for old, _ in crank), statistics.mean(new for _, new in crank))


# ------------------------------------------------------------------------------------------------------------------ cost


def operations(program: Program) -> int:
    """Products, quotients, sums and functions of the right-hand side, common ones counted once."""
    roots = list(program.derivatives)
    for step in program.steps:
        match step:
            case Assign():
                roots.append(step.value)
            case SolveLinear():
                roots += [*step.right, *(value for _, _, value in step.entries)]
            case SolveNewton():
                roots += [*step.residuals, *(inner.value for inner in step.inner), *(value for _, _, value in step.entries)]
    return sum(max(1, len(node.args) - 1) for node in topological(tuple(roots)) if node.op not in ("var", "param", "const", "time", "neg"))


@dataclass(frozen=True)
class Cost:
    seconds: float
    steps: float
    least: float


def _timed(run: Callable[[], Any]) -> tuple[float, Any]:
    began = time.process_time()
    result = run()
    return time.process_time() - began, result


def costs(models: Mapping[str, Path], experiment: str, method: str, rounds: int, stop: float = 1.0) -> dict[str, Cost]:
    """Processor seconds and steps of a run, models in turns; a folder is run partition by partition, with what it takes to record the
    driving signals and to hand them over."""
    systems = {label: pipeline.load(path).compile() for label, path in _files(models).items()}
    seconds: dict[str, list[float]] = defaultdict(list)
    steps: dict[str, list[int]] = defaultdict(list)
    for k in range(rounds + 1):
        record: dict[str, dict[str, Any]] = defaultdict(dict)
        drivers: dict[str, int] = {}
        for label, system in systems.items():
            group, _, part = label.partition("/")
            settings: dict[str, Any] = {"stop": stop, "tolerance": 1e-6 * (1 + 1e-3 * k), "method": method}
            names = [signal.name for signal in system.program.inputs]
            if part:
                settings |= {"interval": 1e-3} if names else {"times": recording_times(stop, RECORDED_EVERY)}
                if names:
                    inputs = {name: record[group][name] for name in ("time", *names)}
                    settings |= {"inputs": inputs, "max_step": STEPS * stop / drivers[group]}
            used, run = _timed(lambda system=system, settings=settings: system.simulate(experiment, **settings))
            if part and not names:
                drivers[group] = run.statistics.steps
                record[group] = {"time": run.time, **{name: run[name] for name in run.names}}
            if k:  # the first round makes machine code
                seconds[label].append(used)
                steps[label].append(run.statistics.steps)
    return {label: Cost(statistics.median(seconds[label]), statistics.median(steps[label]), min(seconds[label])) for label in systems}


def _files(models: Mapping[str, Path]) -> dict[str, Path]:
    """Labels and files; the partitions of a folder in their order as `label/file`."""
    found: dict[str, Path] = {}
    for label, path in models.items():
        if path.is_dir():
            found |= {f"{label}/{file.name}": file for file in sorted(path.glob("*.bg"))}
        else:
            found[label] = path
    return found


PAPER_TABLE_6 = {
    "paper: full": (5682, 6501, 279, 989_618, "100 %"),
    "paper: conditioned": (4881, 5863, 294, 908_492, "misfire: 61 %"),
    "paper: driving partition": (1688, 1999, 77, 60_973, ""),
    "paper: driven partition": (3452, 4111, 197, 854_084, "both: about 50 %"),
}


def cost_table(models: Mapping[str, Path], experiment: str, method: str, rounds: int = 7, paper: bool = True, stop: float = 1.0) -> str:
    """Sizes and times beside the paper's Table 6 and Figure 18."""
    found = costs(models, experiment, method, rounds, stop)
    first = next(iter(found.values())).seconds
    rows: list[tuple[Any, ...]] = [(name, *row[:3], "", row[3], "", row[4]) for name, row in PAPER_TABLE_6.items()] if paper else []
    total: dict[str, float] = defaultdict(float)
    for label, path in _files(models).items():
        model, cost = pipeline.load(path), found[label]
        sizes = model.sizes()
        total[label.partition("/")[0]] += cost.seconds
        numbers = (sizes["equations"], sizes["equations"] + sizes["states"], sizes["states"], operations(model.program))
        rows.append((label, *numbers, f"{cost.steps:.0f}", f"{cost.seconds:.3f}", f"{100 * cost.seconds / first:.0f} %"))
    for label, seconds in total.items():
        if models[label].is_dir():
            rows.append((f"{label}, together", "", "", "", "", "", f"{seconds:.3f}", f"{100 * seconds / first:.0f} %"))
    return table(("model", "equations", "variables", "states", "operations", "steps", "seconds", "of full"), rows)


# ---------------------------------------------------------------------------------------------------------------- others


def small_table(found: Mapping[Small, Measured]) -> str:
    rows = []
    for one, activities in found.items():
        apart, reduced = small_partitions(activities, one), condition(activities, one.threshold, folder=REDUCED)
        names = {t.index: f"{t.name} at {j.name}" for j in activities.report.junctions for t in j.terms}
        records = activities.report.by_index()
        fallen = ", ".join(f"`{names[t]}` ({100 * records[t].rho:.2g} %)" for t in sorted(reduced.decision.dropped)) or "nothing"
        roles = "; ".join(f"{p.role}: {', '.join(p.states)}" for p in apart.found.partitions.partitions) if apart.files else "one whole"
        if apart.found.misses:
            roles += "; nearest: " + ", ".join(f"`{m.name}` at `{m.junction}` {100 * m.rho:.2g} %" for m in apart.found.misses[:2])
        rows.append((f"`{one.file}` {one.experiment}", f"{100 * one.threshold:g} %", fallen, roles))
    return table(("", "threshold", "falls", "partitions"), rows)


def lever_table() -> str:
    """Activity at the lever's junctions, and what conditioning it costs, against the published values."""
    published = {1.0: (1.990, None), 0.3: (0.599, 5.04), 0.15: (0.299, 2.52), 0.1: (0.200, 1.68), 0.01: (0.020, 0.17)}
    model, rows = pipeline.load(MODELS / "lever_stiff.bg"), []
    for s, (rho, error) in published.items():
        found = measure(model, Scenario("kick", {"s": s}))
        junction = next(j for j in found.report.junctions if j.name == "vA")
        mine = next(t for t in junction.terms if t.name == "lever")
        reduced = condition(found, mine.rho * 1.001, guard=False, folder=MODELS)
        small = pipeline.loads(reduced.source, name="lever.bg").compile()
        settings = {"interval": 1e-3, "tolerance": 1e-10}
        one, two = model.compile().simulate("kick", {"s": s}, **settings)["vA.f"], small.simulate("kick", **settings)["vA.f"]
        measured_error = 100 * float(np.sqrt(np.mean((two - one) ** 2) / np.mean(one**2)))
        rows.append((s, f"{100 * mine.rho:.3f}", rho, f"{measured_error:.2f}", "-" if error is None else error))
    return table(("s", "rho of the lever at vA, %", "reference", "normalised RMS error of vA, %", "reference"), rows)


def search_table(found: Searched) -> str:
    """The thresholds tried, and of the steps beyond every one by which another twenty terms had fallen."""
    rows: list[tuple[str, ...]] = []
    told = 0
    for c in found.search.tried:
        if c.spared == 0 or c is found.search.best or c.dropped >= told + 20:
            told = c.dropped if c.error <= ALLOWED else told
            percent = "0" if c.threshold < 1e-12 else f"{100 * c.threshold:.3g}"
            rows.append(
                (
                    f"{percent} %",
                    *map(str, (c.dropped, c.spared, c.states)),
                    f"{100 * c.error:.2g} %",
                    "yes" if c.error <= ALLOWED else "no",
                )
            )
    text = table(("terms below", "dropped", "spared", "states", "largest error of a force component", "within 8 %"), rows)
    ended = found.search.ended
    end = "" if ended is None else f" Above {100 * ended:.2g} % nothing was tried any more: too many in a row had cost too much."
    assert found.accuracy is not None
    return f"{text}\n\n{found.search.trials} models tried; the one written errs by {100 * found.accuracy.worst:.2g} %.{end}"


def costly_table(found: Searched, count: int = 12) -> str:
    """The least active of the families of terms that the search spares, and what each would cost."""
    assert found.reduced is not None
    report = found.reduced.report
    names = {t.index: (j.name, t.name, t.rho) for j in report.junctions for t in j.terms}
    rows = []
    for guilty in found.search.guilty[:count]:
        ends = [names[t] for t in guilty.family.terms]
        place, name, _ = (re.sub(r"(cyl|bore|pins|v_to_block|w_to_block)\[\d\]", r"\1[i]", str(text)) for text in ends[0])
        one = len(ends) == 1
        rows.append(
            (
                f"`{ends[0][0] if one else place}`",
                f"`{ends[0][1] if one else name}`",
                len(ends),
                _range([rho for *_, rho in ends]),
                f"{100 * guilty.error:.3g} %",
            )
        )
    return table(("spared in the balance of", "term", "times", "rho, %", "error without"), rows)


# ------------------------------------------------------------------------------------------------------------------ main


def playback_table() -> str:
    """What playing the driving run from records of different fineness changes in the driven run, over the largest of each force."""
    folder = REDUCED / "engine_balanced"
    driving, driven = (pipeline.load(path).compile() for path in sorted(folder.glob("*.bg")))
    settings = {"stop": 1.0, "tolerance": 1e-8}
    names = [signal.name for signal in driven.program.inputs]
    finest: Any = None
    rows = []
    for interval, start in ((2e-5, True), (1e-4, True), (2e-4, True), (4e-4, True), (1e-4, False), (4e-4, False)):
        recorded = {"times": recording_times(1.0, interval)} if start else {"interval": interval}
        first = driving.simulate("balanced", **recorded, **settings)
        inputs = {"time": first.time, **{name: first[name] for name in names}}
        second = driven.simulate("balanced", inputs=inputs, vars=FORCES, interval=1e-3, **settings).trajectory.values
        if finest is None:
            finest = second
        else:
            error = float((np.abs(second - finest) / np.abs(finest).max(axis=0)).max())
            rows.append((f"{1e3 * interval:g} ms", "5 us, then 2 % of the time" if start else "as the rest", f"{error:.1e}"))
    return table(("recorded every", "at first every", "largest difference from a record every 0.02 ms"), rows)


def tables() -> dict[str, str]:
    """Every table of docs/engine-study.md by name."""
    balanced, misfire = (measured("engine.bg", "Engine", f"{name}_settled") for name in ("balanced", "misfire"))
    small = {one: measured(one.file, one.model, one.experiment) for one in SMALL}
    whole = partition(balanced, THRESHOLD, stem="engine", folder=REDUCED / "engine_balanced")
    failed = partition(misfire, THRESHOLD, stem="engine", folder=REDUCED)
    found: dict[str, str] = {"lever": lever_table(), "reach": reach_table(balanced, misfire)}
    found |= {"partitions": partition_table(whole), "terms": term_table(balanced, whole, 0), "terms 2": term_table(balanced, whole, 1)}
    misses = failed.found.misses
    at = failed.found.apart_at
    found["misses"] = f"Nearest to coming apart: {len(misses)} terms, at {100 * (at or 0):.3g} %.\n\n" + table(
        ("junction", "term", "rho"), [(f"`{m.junction}`", f"`{m.name}`", f"{100 * m.rho:.3g} %") for m in misses]
    )
    parts, conditioned, eight = (
        REDUCED / "engine_balanced",
        REDUCED / "engine_misfire_conditioned.bg",
        REDUCED / EIGHT,
    )
    full = {name: orders(MODELS / "engine.bg", name) for name in ("balanced", "misfire")}
    apart = orders(parts, "balanced")
    found["table 5"] = amplitude_table_5(full["balanced"], apart)
    found["table 5"] += f"\n\nLargest error above 1 N, orders 3 and 6: {100 * worst(full['balanced'], apart, ('3', '6')):.1f} %."
    verified, (old, new) = verify_table(
        verify_reduced(parts / "engine_1_driving.bg", Scenario("misfire_settled"), full=MODELS / "engine.bg")
    )
    found["verify"] = verified + (
        f"\n\nCrank translation at the crank pins, on average: {100 * old:.2f} % before, {100 * new:.2f} % now"
        " (paper: 0.21 % and 1.16 %; reference: 0.16 % and 1.2 %)."
    )
    models = {
        "full": full["misfire"],
        "balanced partitions": orders(parts, "misfire"),
        "conditioned at 0.3 %": orders(conditioned, "misfire"),
    }
    models |= {"within 8 %": orders(eight, "misfire"), "one way": orders(MODELS / "engine_owcm.bg", "misfire")}
    found["misfire"] = misfire_table(models)
    found["misfire variants"] = variant_table(misfire, full["misfire"])
    found["playback"] = playback_table()
    ideal = ideal_files()
    whole_engine = {"full": MODELS / "engine.bg"}
    misfiring = {**whole_engine, "conditioned at 0.3 %": conditioned, "within 8 %": eight}
    for method, rounds in (("cvode-bdf", 7), ("cvode-bdf3", 7), ("cvode-adams", 3)):
        if method != "cvode-bdf3":
            found[f"balanced {method}"] = cost_table({**whole_engine, "partitioned": parts}, "balanced", method, rounds)
        found[f"misfire {method}"] = cost_table(misfiring, "misfire", method, rounds, paper=False)
    found["balanced 4 s"] = cost_table({**whole_engine, "partitioned": parts}, "balanced", "cvode-bdf", 5, paper=False, stop=4.0)
    found["misfire ideal"] = cost_table(ideal, "misfire", "cvode-bdf", paper=False)
    found["misfire ideal cvode-adams"] = cost_table(ideal, "misfire", "cvode-adams", paper=False)
    found["others"] = small_table(small)
    return found


def ideal_files() -> dict[str, Path]:
    """The engine with ideal joints, that conditioned for the misfire (in a folder of its own), and the smallest one."""
    import tempfile

    folder = Path(tempfile.mkdtemp(prefix="bgdsl-study-"))
    path = folder / "engine_ideal_conditioned.bg"
    path.write_text(condition(ideal_misfire(), CONDITIONED_AT, folder=folder).source, "utf-8")
    return {"full, ideal joints": MODELS / "engine_ideal.bg", "conditioned at 0.3 %": path, "within 8 %": REDUCED / IDEAL_EIGHT}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/engine-study.md")
    parser.add_argument("--files", action="store_true", help="write models/reduced anew")
    parser.add_argument("--search", action="store_true", help="look for the smallest engines anew (some minutes), and write them")
    asked = parser.parse_args()
    found: dict[str, str] = {}
    if asked.search:
        searched = search_anew(measured("engine.bg", "Engine", "misfire_settled"), REDUCED / EIGHT)
        found = {"search": search_table(searched), "costly": costly_table(searched)}
        found["search ideal"] = search_table(search_anew(ideal_misfire(), REDUCED / IDEAL_EIGHT, IDEAL_TRIES))
    if asked.files:
        balanced, misfire = (measured("engine.bg", "Engine", f"{name}_settled") for name in ("balanced", "misfire"))
        write_files(balanced, misfire, {one: measured(one.file, one.model, one.experiment) for one in SMALL})
    if asked.write or not (asked.search or asked.files):
        found |= tables()
    for name, text in found.items():
        print(f"\n{name}\n{text}")
    if asked.write:
        _write(found)


def _write(found: Mapping[str, str]) -> None:
    page = ROOT / "docs" / "engine-study.md"
    text = page.read_text("utf-8")
    for name, content in found.items():
        pattern = rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)"
        text = re.sub(pattern, lambda match, content=content: f"{match[1]}{content}\n{match[2]}", text, flags=re.DOTALL)
    page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
