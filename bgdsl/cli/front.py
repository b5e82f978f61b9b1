"""`bgc check`, `fmt`, `show`, `explain`: what the compiler says about a source."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app
from bgdsl.diagnostics import BgError, Diagnostic, Reporter, counted, to_json


def sources(paths: Iterable[Path]) -> Iterator[Path]:
    """The files named, and every `.bg` file in the folders named, in order of name. RefusedError for a folder without one."""
    for path in paths:
        found = sorted(path.rglob("*.bg")) if path.is_dir() else [path]
        if not found:
            raise console.RefusedError(f"there is no .bg file in the folder {path}")
        yield from found


@app.command()
def check(
    files: arg.Files,
    model: arg.ModelName = None,
    path: arg.Search = None,
    set_: arg.Set = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Check syntax, names, domains, units, causality and structure, and print all findings."""
    from bgdsl import pipeline

    found: list[Diagnostic] = []
    for file in list(sources(files)):
        found += pipeline.check_file(file, model=model, search=path or (), overrides=arg.settings(set_))
    errors = sum(d.severity == "error" for d in found)
    if format is arg.Format.JSON:
        console.out(to_json(found))
    elif found:
        console.diagnostics(found)
        console.message(f"\n{counted(errors, 'error')}, {counted(len(found) - errors, 'warning')}")
    return 2 if errors else 0


@app.command()
def fmt(
    files: arg.Files,
    check: Annotated[bool, typer.Option("--check", metavar="", help="Change nothing; status 1 if a file is not formatted.")] = False,
    diff: Annotated[bool, typer.Option("--diff", metavar="", help="Show what would change, and change nothing.")] = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Bring files into the canonical layout; every comment stays."""
    from bgdsl.cli.files import write

    states: dict[Path, str] = {}
    for file in list(sources(files)):
        found = _formatted(file)
        if found is None:
            states[file] = "unreadable"
            continue
        text, tidy = found
        states[file] = "formatted" if text == tidy else "unformatted" if check or diff else "reformatted"
        if diff and format is arg.Format.TEXT:
            console.out("".join(difflib.unified_diff(text.splitlines(True), tidy.splitlines(True), str(file), str(file))))
        if states[file] == "reformatted":
            write(file, tidy, ours=lambda _: True, force=True)
        if states[file] != "formatted" and not (diff and not check):
            console.message(f"would reformat {file}" if check else f"reformatted {file}")
    if format is arg.Format.JSON:
        console.out_json({"files": [{"file": str(file), "state": state} for file, state in states.items()]})
    found_states = set(states.values())
    return 2 if "unreadable" in found_states else int(check and "unformatted" in found_states)


def _formatted(file: Path) -> tuple[str, str] | None:
    """A file's text and its canonical layout; None where it cannot be parsed, which is told."""
    from bgdsl.syntax.formatter import format_source
    from bgdsl.syntax.parser import read_source

    report = Reporter()
    try:
        source = read_source(file, report)
        tidy = format_source(source, report)
        report.stop_if_errors()
    except BgError as error:
        console.diagnostics(error.diagnostics)
        return None
    return source.text, tidy


VIEWS = ("tree", "bonds", "causality", "equations", "states")


@app.command()
def show(
    file: arg.File,
    model: arg.ModelName = None,
    what: Annotated[str, typer.Option("--what", metavar="WHAT", help=f"Any of {','.join(VIEWS)}.")] = "tree,causality,states",
    path: arg.Search = None,
    set_: arg.Set = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Show what the compiler made of a model."""
    from bgdsl import pipeline
    from bgdsl.show import VIEWS as RENDER

    wanted = [part.strip() for part in what.split(",")]
    if unknown := [part for part in wanted if part not in VIEWS]:
        raise typer.BadParameter(f"`{unknown[0]}` is none of {', '.join(VIEWS)}", param_hint="--what")
    loaded = pipeline.load(file, model, search=path or (), overrides=arg.settings(set_))
    views = {part: RENDER[part](loaded) for part in wanted}
    if format is arg.Format.JSON:
        console.out_json({"model": loaded.name, **views})
        return 0
    console.out("\n\n".join("\n".join([f"{part} of {loaded.name}", *("  " + line for line in views[part])]) for part in wanted))
    console.diagnostics(loaded.warnings)
    return 0


@app.command()
def explain(
    code: Annotated[str | None, typer.Argument(metavar="CODE", help="A diagnostic's code, such as BG401.", show_default=False)] = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Say what a diagnostic's code means, with an example and the cure; without a code, list all of them."""
    from bgdsl.explanations import explanation, titles

    as_json = format is arg.Format.JSON
    if code is None:
        if as_json:
            console.out_json([{"code": number, "title": title} for number, title in titles().items()])
        else:
            console.out("\n".join(f"{number}  {title}" for number, title in titles().items()))
        return 0
    text = explanation(code.upper())
    if text is None:
        raise typer.BadParameter(f"there is no code {code}; `bgc explain` lists all codes", param_hint="CODE")
    if as_json:
        console.out_json({"code": code.upper(), "title": titles()[code.upper()], "text": text})
    else:
        console.out(text)
    return 0
