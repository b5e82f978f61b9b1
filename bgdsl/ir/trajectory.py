"""What a run leaves behind: recorded columns, states at the recorded times, integrals, statistics. Data only.

Times are in seconds; every array is float64; rows are recorded times, columns are variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Status = Literal["complete", "partial"]


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a run cost. Equal runs have equal statistics: the wall time (seconds from the start to the stop time, machine code having
    been made) is left out of the comparison.

    steps: accepted; rejected: steps thrown away by the error test or by a corrector that did not converge; factorisations: of
    the iteration matrix; events: located sign changes; projections: accepted steps after which the states were moved back
    onto the invariants; drift: the largest relative residual of the invariants that was left.
    """

    method: str
    steps: int = 0
    rejected: int = 0
    rhs_calls: int = 0
    jacobian_calls: int = 0
    factorisations: int = 0
    events: int = 0
    projections: int = 0
    drift: float = 0.0
    wall_time: float = field(default=0.0, compare=False)

    def as_dict(self) -> dict[str, str | int | float]:
        """By name, in the order above."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


@dataclass(frozen=True, slots=True)
class Integrals:
    """Integrals over the window, one per integrand, with an estimate of their own quadrature error (same units).

    largest: value of each integrand at the places where it was evaluated.
    """

    window: tuple[float, float]
    values: Floats
    errors: Floats
    largest: Floats
    evaluations: int = 0


@dataclass(frozen=True, slots=True)
class Crossing:
    """A located event: `event` is its index in `program.events`, `rising` the direction in which its function went."""

    time: float
    event: int
    rising: bool


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A run. `values` is (rows, len(names)); `states` is (rows, n) and `inputs` (rows, m) at the same times, or None where they
    were not kept. `parameters` are all scalar parameters by name. status `partial`: stopped before `stop_time` on request."""

    model: str
    experiment: str
    time: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    statistics: Statistics
    parameters: Mapping[str, float]
    states: Floats | None = None
    inputs: Floats | None = None
    integrals: Integrals | None = None
    crossings: tuple[Crossing, ...] = ()
    status: Status = "complete"
    digest: str = ""

    def verify(self) -> None:
        """Assert: one row a time, one column a name, times ascending."""
        assert self.values.shape == (len(self.time), len(self.names))
        assert len(self.units) == len(self.names) == len(set(self.names))
        assert all(a <= b for a, b in zip(self.time, self.time[1:], strict=False))
