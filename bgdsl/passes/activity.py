"""Activity of every scalar term of a model along a run.

Input        ScalarGraph; the integrals of `integrands(scalar).expressions` along a run, in joules
Output       ActivityReport, and its table, JSON and CSV
Establishes  the two ends of a bond or two-port have one activity, integrated once; rho is relative to the junction's largest
Reports      BG701 an activity is not a number
             BG702 the activities are not resolved by the quadrature
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import ZERO, Expr, leaves, substitute, unary, var
from bgdsl.ir.activity import ActivityReport, ElementActivity, Integrands, JunctionActivity, TermActivity
from bgdsl.ir.program import Program, defined
from bgdsl.ir.scalar import ScalarGraph, Term

NOT_FINITE = Code("BG701", "an activity is not a number")
UNRESOLVED = Code("BG702", "activities are not resolved by the quadrature")

LEAST_RESOLUTION = 1e-3
"""The largest quadrature error, relative to the largest activity of all, with which activities are still told."""

_ENERGETIC = ("I", "C", "R", "field")


# ------------------------------------------------------------------------------------------------------------ integrands


def term_power(scalar: ScalarGraph, term: Term) -> Expr:
    """The power that a term brings into its junction: sign x common x conjugate."""
    power = var(scalar.junctions[term.junction].variable) * term.conjugate
    return power if term.sign > 0 else -power


def integrands(scalar: ScalarGraph, *, guard: bool = True) -> Integrands:
    """The expressions to integrate for every term's activity and (guard) for the rms of its effort or flow."""
    numbers: dict[Expr, int] = {}

    def number(expression: Expr) -> int | None:
        return None if expression is ZERO else numbers.setdefault(expression, len(numbers))

    power: list[int | None] = []
    for term in scalar.terms:
        if term.other is not None and term.other < term.index:
            power.append(power[term.other])  # one bond, one power
        else:
            power.append(number(unary("abs", term_power(scalar, term))))
    square = [number(term.conjugate * term.conjugate) if guard else None for term in scalar.terms]
    return Integrands(tuple(numbers), tuple(power), tuple(square))


def grounded(expressions: Iterable[Expr], program: Program) -> tuple[Expr, ...]:
    """The expressions over what a program computes: variables that are mere values of others are replaced by those."""
    expressions = tuple(expressions)
    known = {record.name for record in (*program.states, *program.inputs)}
    known.update(name for step in program.steps for name in defined(step))
    for _ in range(64):  # aliases of aliases; each round goes one level down
        replaced: dict[Expr, Expr] = {}
        for leaf in leaves(expressions):
            if leaf.data not in known:
                value = program.values[leaf.data]
                if value is not leaf:
                    replaced[leaf] = value
        if not replaced:
            break
        expressions = substitute(expressions, replaced)
    return expressions


# ------------------------------------------------------------------------------------------------------------ activities


def activities(
    scalar: ScalarGraph,
    wanted: Integrands,
    integrals: Sequence[float],
    *,
    experiment: str | None,
    window: tuple[float, float],
    report: Reporter,
    errors: Sequence[float] | None = None,
) -> ActivityReport:
    """Activities from the integrals of `wanted.expressions`. errors: the quadrature's own estimate for each of them."""
    _check_finite(scalar, wanted, integrals, report)
    energy = [0.0 if k is None else max(0.0, float(integrals[k])) for k in wanted.power]
    size = [math.nan if k is None else math.sqrt(max(0.0, float(integrals[k]))) for k in wanted.square]
    largest = max(energy, default=0.0)
    error = max((float(errors[k]) for k in wanted.power if k is not None), default=0.0) if errors is not None else 0.0
    _check_resolved(scalar, largest, error, report)
    junctions = tuple(_junction(scalar, j, energy, size) for j in range(len(scalar.junctions)))
    relative = error / largest if largest else 0.0
    return ActivityReport(scalar.graph.model, experiment, window, junctions, _elements(scalar, energy), relative)


def _check_finite(scalar: ScalarGraph, wanted: Integrands, integrals: Sequence[float], report: Reporter) -> None:
    bad = {k for k, value in enumerate(integrals) if not math.isfinite(value)}
    for term, k in zip(scalar.terms, wanted.power, strict=True):
        if k in bad:
            name, where = term_name(term), scalar.junctions[term.junction].name
            report.fail(
                NOT_FINITE,
                f"the activity of `{name}` at `{where}` is not a number",
                term.origin.span,
                notes=("its power was infinite or undefined somewhere in the window",),
                helps=("choose a window in which the run is well behaved, or look at the run with `bgc simulate --vars`",),
            )


def _check_resolved(scalar: ScalarGraph, largest: float, error: float, report: Reporter) -> None:
    if error > LEAST_RESOLUTION * largest > 0.0:
        origin = scalar.terms[0].origin
        report.fail(
            UNRESOLVED,
            f"the quadrature error of {error:.2g} J is too large for a largest activity of {largest:.3g} J",
            origin.span,
            helps=("lower the experiment's tolerance, so that the solver takes smaller steps",),
        )


def _junction(scalar: ScalarGraph, j: int, energy: Sequence[float], size: Sequence[float]) -> JunctionActivity:
    at = scalar.terms_at[j]
    most = max((energy[t] for t in at), default=0.0)
    strongest = max((size[t] for t in at if not math.isnan(size[t])), default=0.0)
    names = unique_names(scalar, at)
    terms = tuple(
        _term(scalar.terms[t], names[t], energy[t], energy[t] / most if most else 0.0, size[t] / strongest if strongest else math.nan)
        for t in at
    )
    junction = scalar.junctions[j]
    return JunctionActivity(j, junction.name, junction.kind, most, terms)


def _term(term: Term, name: str, activity: float, rho: float, strength: float) -> TermActivity:
    return TermActivity(term.index, name, term.bond, term.entry, term.element, activity, rho, strength, term.parasitic, term.origin.span)


def term_name(term: Term) -> str:
    """What a term is called at its junction: its element with entry or component, else its bond with component."""
    if term.entry is not None:
        return f"{term.element}[{term.entry[0] + 1},{term.entry[1] + 1}]"
    if term.other is not None and not term.is_two_port:
        return term.bond if term.component is None else f"{term.bond}[{term.component + 1}]"
    base = term.element or term.bond
    return base if term.component is None else f"{base}[{term.spot + 1}]"


def unique_names(scalar: ScalarGraph, at: Iterable[int]) -> dict[int, str]:
    """Names of the terms of one junction; where two would be alike (two ends of one element), the port is added."""
    names = {t: term_name(scalar.terms[t]) for t in at}
    counts: dict[str, int] = {}
    for name in names.values():
        counts[name] = counts.get(name, 0) + 1
    return {t: name if counts[name] == 1 else f"{name}.p{scalar.terms[t].port + 1}" for t, name in names.items()}


def _elements(scalar: ScalarGraph, energy: Sequence[float]) -> tuple[ElementActivity, ...]:
    totals = {element.name: 0.0 for element in scalar.graph.elements if element.kind in _ENERGETIC}
    for term in scalar.terms:
        if term.element in totals:
            totals[term.element] += energy[term.index]
    whole = math.fsum(totals.values())
    kinds = {element.name: element.kind for element in scalar.graph.elements}
    return tuple(ElementActivity(name, kinds[name], total, total / whole if whole else 0.0) for name, total in totals.items())


# ----------------------------------------------------------------------------------------------------------------- shown


def to_json(report: ActivityReport) -> str:
    """The report as one JSON document with stable keys; activities in joules, rho and index as fractions."""
    return json.dumps(as_dictionary(report), indent=2)


def as_dictionary(report: ActivityReport) -> Mapping[str, object]:
    """The report as JSON has it: its head, the junctions with their terms, the elements."""
    return {
        "model": report.model,
        "experiment": report.experiment,
        "window": list(report.window),
        "error": report.error,
        "junctions": [
            {
                "name": junction.name,
                "kind": junction.kind,
                "max_activity": junction.max_activity,
                "terms": [_term_dictionary(term) for term in junction.terms],
            }
            for junction in report.junctions
        ],
        "elements": [{"name": e.name, "kind": e.kind, "activity": e.activity, "index": e.index} for e in report.elements],
    }


def _term_dictionary(term: TermActivity) -> Mapping[str, object]:
    return {
        "number": term.index,
        "term": term.name,
        "bond": term.bond,
        "entry": None if term.entry is None else [term.entry[0] + 1, term.entry[1] + 1],
        "element": term.element,
        "activity": term.activity,
        "rho": term.rho,
        "strength": None if math.isnan(term.strength) else term.strength,
        "parasitic": term.parasitic,
        "file": term.span.source.name,
        "line": term.span.line,
    }


def to_csv(report: ActivityReport) -> str:
    """One line a term: junction, kind, term, element, activity_J, rho, parasitic, file, line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("junction", "kind", "term", "bond", "element", "activity_J", "rho", "parasitic", "file", "line"))
    for junction in report.junctions:
        for term in junction.terms:
            place = (term.span.source.name, term.span.line)
            values = (repr(term.activity), repr(term.rho), int(term.parasitic))
            writer.writerow((junction.name, junction.kind, term.name, term.bond, term.element or "", *values, *place))
    return text.getvalue()


def table_rows(report: ActivityReport, threshold: float = 0.01) -> list[tuple[str, str, str, str, str]]:
    """Rows (junction, term, activity, rho, place) for people: each junction's largest first, its smallest last.

    A junction of which no term is below the threshold keeps its largest and smallest only.
    """
    rows: list[tuple[str, str, str, str, str]] = []
    for junction in sorted(report.junctions, key=lambda junction: (-junction.max_activity, junction.index)):
        terms = sorted(junction.terms, key=lambda term: (-term.activity, term.index))
        if len(terms) > 6:
            terms = [term for k, term in enumerate(terms) if k < 2 or k == len(terms) - 1 or term.rho < threshold]
        head = f"{junction.kind}-junction {junction.name}"
        for k, term in enumerate(terms):
            place = f"{term.span.source.name}:{term.span.line}"
            rows.append((head if k == 0 else "", term.name, f"{term.activity:.5g}", f"{100 * term.rho:.4g} %", place))
    return rows
