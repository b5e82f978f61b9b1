"""bgdsl: a textual language for bond graphs, its compiler and its model reducer.

model = bgdsl.load("models/lever.bg")
run = model.compile().simulate(experiment="kick", mA=12.0)
run.time, run["vA.f"]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bgdsl.version import VERSION

__version__ = VERSION


if TYPE_CHECKING:
    from bgdsl.api import Model, Run, System, load, loads

__all__ = ["Model", "Run", "System", "__version__", "load", "loads"]


def __getattr__(name: str) -> Any:
    """What `bgdsl.api` offers, loaded when first asked for, so that importing the package costs nothing."""
    if name in __all__:
        from bgdsl import api

        return getattr(api, name)
    raise AttributeError(f"module 'bgdsl' has no attribute '{name}'")
