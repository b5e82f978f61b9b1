"""`bgc compile` and `bgc simulate`: state equations, and their solution."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app


@app.command("compile")
def compile_(
    file: arg.File,
    model: arg.ModelName = None,
    target: Annotated[str, typer.Option("--target", help="What to write: `numpy`, a Python module that needs NumPy alone.")] = "numpy",
    output: arg.Output = None,
    path: arg.Search = None,
    set_: arg.Set = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Write the state equations of a model as a standalone module and print its sizes."""
    from bgdsl import pipeline
    from bgdsl.cli.files import write

    if target != "numpy":
        raise typer.BadParameter(f"`{target}` is no target; the one there is: numpy", param_hint="--target")
    began = time.perf_counter()
    loaded = pipeline.load(file, model, search=path or (), overrides=arg.settings(set_))
    text = loaded.module_text()
    out = output or file.with_suffix(".py")
    write(out, text, ours=pipeline.is_generated_module, force=force)
    sizes = {**loaded.sizes(), "seconds": round(time.perf_counter() - began, 3)}
    console.diagnostics(loaded.warnings)
    if format is arg.Format.JSON:
        console.out_json({"model": loaded.name, "output": str(out), **sizes})
    else:
        console.out(f"{out}: " + ", ".join(f"{value} {name}" for name, value in sizes.items()))
    return 0


@app.command()
def simulate(
    file: arg.File,
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    stop: arg.Stop = None,
    interval: arg.Interval = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    vars: Annotated[str | None, typer.Option("--vars", metavar="A,B", help="What to record; otherwise the outputs.")] = None,
    inputs: arg.Inputs = None,
    output: arg.Output = None,
    path: arg.Search = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Run a model and record its outputs (CSV, netCDF or Parquet by the ending of OUT), or print a summary."""
    from bgdsl import pipeline

    loaded = pipeline.load(file, model, search=path or ())
    if inputs is not None and not loaded.program.inputs:
        console.message(f"{loaded.name} has no inputs: {inputs} is not read")
    with console.progress(f"simulating {loaded.name}") as progress:
        run = loaded.compile().simulate(
            experiment=experiment,
            parameters=arg.settings(set_),
            stop=stop,
            interval=interval,
            tolerance=tolerance,
            method=method,
            vars=arg.names(vars),
            inputs=inputs,
            output=output,
            force=force,
            progress=progress,
            say=console.message,
        )
    statistics = run.statistics.as_dict()
    if format is arg.Format.JSON:
        console.out_json({"model": loaded.name, "experiment": run.experiment, "summary": run.summary(), "statistics": statistics})
    else:
        if output is None:
            console.out(_summary(run.summary()))
        console.message("  ".join(f"{name} {_short(value)}" for name, value in statistics.items()))
    return 0


def _summary(rows: list[dict[str, Any]]) -> str:
    header = ("variable", "unit", "start", "end", "min", "max", "mean")
    return console.table(header, [[_short(row[name]) for name in header] for row in rows], right=range(2, 7))


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
