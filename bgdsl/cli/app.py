"""The application: global options, the commands, and what becomes of an error."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from bgdsl.cli import console
from bgdsl.diagnostics import BgError, as_records
from bgdsl.version import VERSION

# typer carries its own click in newer releases and the package in older ones: the base of its errors is found through it
UsageProblem: type[typer.BadParameter] = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")

PANELS = {
    "Sources": ("check", "explain", "fmt", "show", "lsp"),
    "Runs": ("compile", "simulate", "test"),
    "Reductions": ("activity", "condition", "partition", "compare", "verify", "tune"),
}
"""The commands as `bgc --help` groups them."""


class Grouped(TyperGroup):
    """Commands in the order in which one meets them, each on its panel."""

    def list_commands(self, ctx: Any) -> list[str]:
        ordered = [name for names in PANELS.values() for name in names]
        return sorted(self.commands, key=lambda name: ordered.index(name) if name in ordered else len(ordered))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            command.rich_help_panel = next((panel for panel, names in PANELS.items() if cmd_name in names), None)  # type: ignore[attr-defined]
        return command


app = typer.Typer(
    name="bgc",
    cls=Grouped,
    help="Compile, run, test and reduce bond-graph models written in the .bg language.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(show: bool) -> None:
    if show:
        console.out(f"bgc {VERSION}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", metavar="", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", metavar="", help="Show the traceback of an error.")] = False,
) -> None:
    """Options before the command."""
    console.debug = debug


def run(arguments: Sequence[str]) -> int:
    """Carry out a command line and return its exit status."""
    from bgdsl.cli import against, editor, front, reduce, run, tests  # noqa: F401  (their import registers the commands)

    console.debug = False
    arguments = list(arguments)
    if "--debug" in arguments:  # it may stand anywhere
        arguments.remove("--debug")
        arguments.insert(0, "--debug")
    try:
        if "" in arguments:  # a path that is empty would be the working folder
            raise typer.BadParameter("an argument is empty")
        result = app(arguments, standalone_mode=False, prog_name="bgc")
        return _status(result if isinstance(result, int) else 0, arguments)
    except typer.Exit as stop:
        return _status(stop.exit_code, arguments)
    except BrokenPipeError:
        raise
    except (Exception, KeyboardInterrupt) as error:
        _failed(error, arguments)
        if console.debug:
            traceback.print_exception(error)
    return 2


INTERRUPTED = 130
"""What Typer makes of Ctrl-C."""


def _status(code: int, arguments: Sequence[str]) -> int:
    """The exit status: an interrupt means that the work could not be done."""
    if code != INTERRUPTED:
        return code
    _failed(KeyboardInterrupt(), arguments)
    return 2


def _failed(error: BaseException, arguments: Sequence[str]) -> None:
    """Say on stderr why the work could not be done, and in a document on stdout to whom asked for JSON."""
    found = error.diagnostics if isinstance(error, BgError) else ()
    if found:
        console.diagnostics(found)
    elif isinstance(error, UsageProblem):
        error.show(sys.stderr)
    else:
        console.message(_why(error))
    if _asks_for_json(arguments):
        console.out_json({"error": found[0].message if found else _why(error).removeprefix("error: "), "diagnostics": as_records(found)})


def _why(error: BaseException) -> str:
    match error:
        case UsageProblem():
            return str(error.format_message())
        case OSError():
            where = f": {error.filename}" if error.filename else ""
            return f"error: {error.strerror or error}{where}"
        case RecursionError():
            return "error: the model is nested too deeply"
        case KeyboardInterrupt() | typer.Abort():
            return "stopped"
        case console.RefusedError():
            return f"error: {error}"
        case _:
            return f"error: this is a fault of bgc, not of the model: {type(error).__name__}: {error}; `--debug` shows where"


def _asks_for_json(arguments: Sequence[str]) -> bool:
    return "--format=json" in arguments or ("--format", "json") in pairwise(arguments)
