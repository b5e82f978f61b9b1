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
    return _search(state, [((), need)], soft)


def augment_two_port(state: Assignment, term: int, soft: list[bool]) -> bool:
    """Do without the surplus relation of a two-port; False if there is no way.

    Where one end has to determine its junction and neither does, one takes over; where only one of two does, it gives way.
    """
    starts: list[tuple[Flips, int | None]] = []
    for t in (term, state.other[term]):
        j = state.junction[t]
        present = state.determiner[j]
        if not soft[t] or not soft[state.other[t]]:
            continue
        if state.alike[t]:
            starts += [(((t, 0),), j)] if present == t else []
            continue
        taken = _displace(state, present, soft) if present >= 0 else ((), None)
        starts += [(((t, 1), *taken[0]), taken[1])] if taken is not None else []
    return _search(state, starts, soft)


def _search(state: Assignment, starts: list[tuple[Flips, int | None]], soft: list[bool]) -> bool:
    """Breadth-first search from the junctions that the first changes leave in need."""
    came: dict[int, tuple[int, Flips]] = {}
    queue: list[int] = []
    for flips, further in starts:
        if _reach(state, came, queue, -1, flips, further):
            return True
    for j in queue:
        for flips, further in _exchanges(state, j, soft):
            if _reach(state, came, queue, j, flips, further):
                return True
    return False


def _reach(state: Assignment, came: dict[int, tuple[int, Flips]], queue: list[int], before: int, flips: Flips, further: int | None) -> bool:
    """Note a junction reached; where none is left in need, apply the path and say so."""
    if further is None:
        changed = _after(state, [*_path(came, before), flips])
        if changed is not None:
            _apply(state, changed)
        return changed is not None
    if further not in came:
        came[further] = (before, flips)
        queue.append(further)
    return False


def _path(came: dict[int, tuple[int, Flips]], j: int) -> list[Flips]:
    path: list[Flips] = []
    while j >= 0:
        j, flips = came[j]
        path.append(flips)
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


def _after(state: Assignment, path: list[Flips]) -> dict[int, int] | None:
    """The values that a path changes, or None if it crosses itself: not one determiner at a junction, or ends that disagree."""
    changed: dict[int, int] = {}
    for flips in path:
        changed.update(flips)

    def value(t: int) -> int:
        return changed.get(t, state.value[t])

    for t in changed:
        if sum(value(other) == 1 for other in state.scalar.terms_at[state.junction[t]]) != 1:
            return None
        far = state.other[t]
        if far >= 0 and (value(t) == value(far)) != state.alike[t]:
            return None
    return changed


def _apply(state: Assignment, changed: dict[int, int]) -> None:
    for t, value in changed.items():
        state.value[t] = value
        state.reason[t] = Reason("chosen")
    for j in {state.junction[t] for t in changed}:
        state.determiner[j] = next((t for t in state.scalar.terms_at[j] if state.value[t] == 1), -1)
        if state.determiner[j] >= 0:
            state.free.discard(j)
