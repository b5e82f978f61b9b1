"""The names under which variables pass from one part of a model to another.

What the elements of an array of components pass alike is one array: `cyl[2].rod.v.f[3]` is `cyl_rod_v_f_3[2]`; else a scalar, `spin_e_1`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

from bgdsl.ir.graph import BondGraph
from bgdsl.reductions.places import COMPONENT_INDEX, LocalNames, Spot, flat_name, split


def passed_names(graph: BondGraph, asked: Sequence[Sequence[str]], giver: Callable[[str], int]) -> dict[str, Spot]:
    """Where each variable that is asked for stands, in the parts that read it and in the one that gives it.

    asked: the variables that each part reads; giver: the number of the part that gives a variable.
    """
    names = LocalNames(graph)
    variables = list(dict.fromkeys(v for some in asked for v in some))
    alike: dict[str, list[str]] = defaultdict(list)
    for v in variables:
        alike[COMPONENT_INDEX.sub("[#]", v)].append(v)
    found: dict[str, Spot] = {}
    for shape, group in alike.items():
        size = _whole(names, group, asked, giver)
        if size is None:
            for v in group:
                own = split(v)
                found[v] = own if not own.owner and flat_name(v) == v else Spot("", names.fresh("", flat_name(v), v))
            continue
        name = names.fresh("", flat_name(shape.replace("[#]", "")), shape)
        for v in group:
            found[v] = Spot("", name, (), "", (_index(v),), (size,))
    return {v: found[v] for v in variables}


def _index(variable: str) -> int:
    return int(COMPONENT_INDEX.findall(variable)[0])


def _whole(names: LocalNames, group: Sequence[str], asked: Sequence[Sequence[str]], giver: Callable[[str], int]) -> int | None:
    """The size of the array, if all of its elements pass from one part to each that reads any."""
    match = COMPONENT_INDEX.search(group[0])
    if match is None or len(COMPONENT_INDEX.findall(group[0])) > 1 or len({giver(v) for v in group}) > 1:
        return None
    (size,) = names.extents.get(split(group[0][: match.start()]).key, (0,))
    if sorted(map(_index, group)) != list(range(1, size + 1)) or size < 2:
        return None
    wanted = frozenset(group)
    return size if all(len(wanted & frozenset(some)) in (0, size) for some in asked) else None
