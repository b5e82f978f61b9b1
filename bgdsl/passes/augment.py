"""Repair of free choices: where they left a junction without a determiner, change some of them so that it gets one.

Only terms that were chosen freely (or followed from such choices) are touched. From a junction in need, a term takes over at
it; what that displaces at the next junction is either a resistor, and all is well, or a bond or two-port that leaves a further
junction in need: a path of exchanges, found by breadth-first search.
"""

from __future__ import annotations

from collections.abc import Iterator

from bgdsl.ir.causal import Reason
from bgdsl.passes.propagation import Assignment

Flips = tuple[tuple[int, int], ...]
"""Terms and their new values."""


def augment(state: Assignment, need: int, soft: list[bool]) -> bool:
    """Give junction `need` a determiner by changing soft terms only; False, with nothing changed, if there is no way."""
    came: dict[int, tuple[int, Flips]] = {need: (-1, ())}
    queue = [need]
    for j in queue:
        for flips, further in _exchanges(state, j, soft):
            if further is None:
                _apply(state, [*_path(came, j), flips])
                return True
            if further not in came:
                came[further] = (j, flips)
                queue.append(further)
    return False


def _path(came: dict[int, tuple[int, Flips]], j: int) -> list[Flips]:
    path: list[Flips] = []
    while came[j][0] >= 0:
        path.append(came[j][1])
        j = came[j][0]
    return path[::-1]


def _exchanges(state: Assignment, j: int, soft: list[bool]) -> Iterator[tuple[Flips, int | None]]:
    """The ways in which a term can take over at junction j: the values changed and the junction then in need, None for none."""
    for t in state.scalar.terms_at[j]:
        if not soft[t] or state.value[t] == 1:
            continue
        far = state.other[t]
        if far < 0:
            yield ((t, 1),), None
        elif not soft[far]:
            continue
        elif not state.alike[t]:
            yield ((t, 1), (far, 0)), state.junction[far] if state.value[far] == 1 else None
        else:
            present = state.determiner[state.junction[far]]
            taken = _displace(state, present, soft) if present >= 0 else ((), None)
            if taken is not None:
                yield ((t, 1), (far, 1), *taken[0]), taken[1]


def _displace(state: Assignment, present: int, soft: list[bool]) -> tuple[Flips, int | None] | None:
    """What happens if this determiner is displaced; None if it must not be."""
    far = state.other[present]
    if not soft[present] or (far >= 0 and not soft[far]):
        return None
    if far < 0:
        return ((present, 0),), None
    if state.alike[present]:
        return ((present, 0), (far, 0)), state.junction[far]
    beyond = state.determiner[state.junction[far]]
    if beyond < 0:
        return ((present, 0), (far, 1)), None
    if state.other[beyond] < 0 and soft[beyond]:
        return ((present, 0), (far, 1), (beyond, 0)), None
    return None


def _apply(state: Assignment, path: list[Flips]) -> None:
    for flips in path:
        for t, value in flips:
            state.value[t] = value
            state.reason[t] = Reason("chosen")
    touched = {state.junction[t] for flips in path for t, _ in flips}
    for j in touched:
        state.determiner[j] = next((t for t in state.scalar.terms_at[j] if state.value[t] == 1), -1)
        if state.determiner[j] >= 0:
            state.free.discard(j)
