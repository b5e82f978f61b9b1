"""Options that several commands share, written once: a parameter that is a dataclass stands for its fields."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from bgdsl.cli import arguments as arg


def grouped(command: Callable[..., int]) -> Callable[..., int]:
    """The command as typer is to read it: each parameter that is a dataclass is replaced by the dataclass's fields."""
    signature = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {name: p.annotation for name, p in signature.parameters.items() if is_dataclass(p.annotation)}

    @functools.wraps(command)
    def ungrouped(**given: Any) -> int:
        made = {name: group(**{f.name: given.pop(f.name) for f in fields(group)}) for name, group in groups.items()}
        return command(**given, **made)

    own = [p for name, p in signature.parameters.items() if name not in groups]
    shown = [p.replace(kind=p.KEYWORD_ONLY) for p in own] + [p for group in groups.values() for p in _parameters(group)]
    ungrouped.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
    ungrouped.__annotations__ = {p.name: p.annotation for p in shown} | {"return": int}
    return ungrouped


def _parameters(group: Any) -> Iterator[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        yield inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[field.name])


@dataclass(frozen=True, slots=True)
class RunGroup:
    """A run as a command line describes it. `settings`: those of `System.simulate` that were given."""

    experiment: arg.ExperimentName = None
    set_: arg.Set = None
    window: arg.Window = None
    stop: arg.Stop = None
    tolerance: arg.Tolerance = None
    method: arg.Method = None
    path: arg.Search = None

    @property
    def changes(self) -> dict[str, Any]:
        """The changed parameters."""
        return arg.settings(self.set_)

    @property
    def span(self) -> tuple[float, float] | None:
        """The window."""
        return arg.window(self.window)

    def settings(self, **more: Any) -> dict[str, Any]:
        """Settings of the run, and `more` of them; those not given are left out. The window is not one of them here."""
        every = {"stop": self.stop, "tolerance": self.tolerance, "method": self.method, **more}
        return {name: value for name, value in every.items() if value is not None}

    @property
    def folders(self) -> list[Path]:
        """Where imports are looked for."""
        return self.path or []
