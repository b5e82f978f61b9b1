"""Arguments that several commands share, and how their texts are read."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from enum import StrEnum
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any

import typer


class Format(StrEnum):
    """How a result is printed."""

    TEXT = "text"
    JSON = "json"


class TableFormat(StrEnum):
    """How a result that is one table is printed."""

    TEXT = "text"
    JSON = "json"
    CSV = "csv"


File = Annotated[Path, typer.Argument(metavar="FILE", help="A .bg file.", show_default=False)]
Files = Annotated[list[Path], typer.Argument(metavar="FILE...", help=".bg files, or folders of them.", show_default=False)]
ModelName = Annotated[str | None, typer.Option("--model", "-m", metavar="M", help="The model; needed where the file has several.")]
Search = Annotated[
    list[Path] | None,
    typer.Option("--path", metavar="DIR", exists=True, file_okay=False, help="A folder where imports are looked for; may be repeated."),
]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Change a parameter; may be repeated.")]
ExperimentName = Annotated[str | None, typer.Option("--experiment", "-e", metavar="E", help="A named run of the model.")]
Force = Annotated[bool, typer.Option("--force", metavar="", help="Replace a file that this command did not write.")]
Output = Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT", help="Where to write the result.")]
OutputFormat = Annotated[Format, typer.Option("--format", help="How to print the result.")]
TableOutputFormat = Annotated[TableFormat, typer.Option("--format", help="How to print the result.")]
Stop = Annotated[float | None, typer.Option("--stop", metavar="T", help="End time in s.")]
Interval = Annotated[float | None, typer.Option("--interval", metavar="H", help="Time between recorded points in s.")]
Tolerance = Annotated[float | None, typer.Option("--tolerance", metavar="R", help="Relative and absolute tolerance.")]
Method = Annotated[
    str | None, typer.Option("--method", metavar="M", help="cvode-bdf, cvode-bdf3, cvode-adams, lsoda, radau, rk45 or vode-adams.")
]
Window = Annotated[str | None, typer.Option("--window", metavar="T1,T2", help="The interval over which activity is measured.")]
Inputs = Annotated[Path | None, typer.Option("--inputs", metavar="FILE", help="CSV, netCDF or Parquet with `time` and the model's inputs.")]
Outputs = Annotated[str | None, typer.Option("--outputs", metavar="A,B", help="The outputs of interest; otherwise all.")]
Shaft = Annotated[
    str | None,
    typer.Option("--shaft", metavar="NAME", help="An output that is a shaft's angle: harmonics by order, errors at equal angles."),
]


def settings(texts: Iterable[str] | None) -> dict[str, Any]:
    """`path=value` texts as a mapping; values are numbers, true/false, arrays `{1,2}`, matrices `[1,2;3,4]`, else strings."""
    result: dict[str, Any] = {}
    for text in texts or ():
        path, sign, value = text.partition("=")
        if not sign or not path.strip() or not value.strip():
            raise typer.BadParameter(f"`{text}` is not PATH=VALUE", param_hint="--set")
        result[path.strip()] = _value(value.strip())
    return result


def _value(text: str) -> Any:
    if text in ("true", "false"):
        return text == "true"
    if text[0] + text[-1] == "[]" and len(rows := _parts(text[1:-1], ";")) > 1:
        return tuple(tuple(_value(entry) for entry in _parts(row)) for row in rows)
    if text[0] + text[-1] in ("{}", "[]"):
        return tuple(_value(part) for part in _parts(text[1:-1]))
    try:
        number = float(text)
    except ValueError:
        return text.strip("\"'")
    if not isfinite(number):
        raise typer.BadParameter(f"`{text}` is no finite number", param_hint="--set")
    return number


def _parts(text: str, separator: str = ",") -> list[str]:
    """The separated parts at the outer level of brackets."""
    parts, depth = [""], 0
    for character in text:
        depth += (character in "{[") - (character in "}]")
        if character == separator and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts if part.strip()]


def fraction(text: str, hint: str, most: float = 1.0) -> float:
    """`0.003` or `0.3%` as a fraction of one, not negative and not above `most`."""
    try:  # a percentage is the fraction that a person would write: 0.35% is 0.0035, not 0.0034999999999999996
        value = float(Decimal(text[:-1]) / 100) if text.endswith("%") else float(text)
    except (ValueError, InvalidOperation):
        value = -1.0
    if not 0 <= value < inf:
        raise typer.BadParameter(f"`{text}` is neither a fraction such as 0.003 nor a percentage such as 0.3%", param_hint=hint)
    if value > most:
        meant = "" if text.endswith("%") else f"; did you mean {text}%?"
        raise typer.BadParameter(f"`{text}` is more than {100 * most:g} %{meant}", param_hint=hint)
    return value


def window(text: str | None) -> tuple[float, float] | None:
    """`T1,T2` as two times."""
    if text is None:
        return None
    try:
        start, stop = (float(part) for part in text.split(","))
    except ValueError:
        start, stop = 1.0, 0.0
    if not start < stop:
        raise typer.BadParameter(f"`{text}` is not two times T1,T2 with T1 < T2", param_hint="--window")
    return start, stop


def names(text: str | None) -> tuple[str, ...] | None:
    """`a,b[1,2],c` as names; commas within brackets belong to the name."""
    found = None if text is None else tuple(_parts(text))
    if found == ():
        raise typer.BadParameter(f"`{text}` names nothing; wanted are names with commas between them: x,v.f,spring.q")
    return found
