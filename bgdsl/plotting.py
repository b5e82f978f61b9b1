"""Pictures of runs and of activities, with matplotlib (the extra `plot`).

plotting.signals(run, "vA.f", "vB.f").savefig("velocities.png")
plotting.activities(run.activity(), threshold=0.025).savefig("activities.png")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bgdsl.ir.activity import ActivityReport, TermActivity
    from bgdsl.simulate.result import Run

INCHES_PER_TERM = 0.2


def signals(run: Run, *names: str) -> Any:
    """A figure of signals over time, one axis each, by name; without names of all that were recorded. BgError for unknown names."""
    chosen = names or run.names
    units = dict(zip(run.names, run.trajectory.units, strict=True))
    figure, rows = _figure(len(chosen), 1.6 * len(chosen) + 0.6)
    for axis, name in zip(rows, chosen, strict=True):
        axis.plot(run.time, run[name], linewidth=1)
        axis.set_ylabel(f"{name} / {units[name]}" if units.get(name) else name)
        axis.grid(visible=True, alpha=0.3)
    rows[-1].set_xlabel("time / s")
    return figure


def activities(report: ActivityReport, *, threshold: float | None = None) -> Any:
    """A figure of every term's rho (percent, logarithmic), junction by junction; those below `threshold` (a fraction) are pale."""
    terms = [(junction.name, term) for junction in report.junctions for term in sorted(junction.terms, key=lambda t: -t.rho)]
    figure, (axis,) = _figure(1, INCHES_PER_TERM * len(terms) + 1)
    colours = [_colour(term, threshold) for _, term in terms]
    axis.barh(range(len(terms)), [max(100 * term.rho, 1e-6) for _, term in terms], color=colours)
    axis.set_yticks(range(len(terms)), [f"{junction}: {term.name}" for junction, term in terms], fontsize=7)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xlabel("rho / %")
    if threshold:
        axis.axvline(100 * threshold, color="black", linewidth=0.8, linestyle="--")
    return figure


def _colour(term: TermActivity, threshold: float | None) -> str:
    return "lightsteelblue" if threshold is not None and term.rho < threshold else "steelblue"


def _figure(rows: int, height: float) -> tuple[Any, list[Any]]:
    """A figure that belongs to no window, with its axes one above the other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, height), layout="constrained")
    return figure, list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
