"""Matching, strong components and tearing against plain references on random graphs."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from bgdsl.passes.blocks import strong_components
from bgdsl.passes.matching import FREE, match, overdetermined, underdetermined
from bgdsl.passes.tearing import tear


@st.composite
def bipartite(draw: st.DrawFn) -> tuple[list[list[int]], int]:
    columns = draw(st.integers(1, 8))
    reads = st.lists(st.integers(0, columns - 1), unique=True, max_size=4)
    return draw(st.lists(reads, max_size=8)), columns


def rank(rows: list[list[int]], columns: int) -> int:
    """The size of a maximum matching, by the plain augmenting-path recursion."""
    owner: dict[int, int] = {}

    def place(i: int, seen: set[int]) -> bool:
        for j in rows[i]:
            if j not in seen:
                seen.add(j)
                if j not in owner or place(owner[j], seen):
                    owner[j] = i
                    return True
        return False

    return sum(place(i, set()) for i in range(len(rows)))


@given(bipartite(), st.randoms())
def test_maximum_and_consistent(graph: tuple[list[list[int]], int], random: object) -> None:
    rows, columns = graph
    first, taken = [], set()
    for reads in rows:
        column = reads[0] if reads and reads[0] not in taken else FREE
        taken.add(column)
        first.append(column)
    matching = match(rows, columns, first)
    pairs = [(i, j) for i, j in enumerate(matching.column_of) if j != FREE]
    assert len(pairs) == rank(rows, columns)
    assert all(j in rows[i] and matching.row_of[j] == i for i, j in pairs)
    over = overdetermined(rows, matching)
    assert len({j for i in over for j in rows[i]}) == len(over) - len(matching.unmatched_rows)
    under = underdetermined(rows, matching)
    readers = {i for i, reads in enumerate(rows) if set(reads) & set(under)}
    assert len(readers) == len(under) - len(matching.unmatched_columns)


@st.composite
def digraph(draw: st.DrawFn) -> list[list[int]]:
    n = draw(st.integers(1, 9))
    return draw(st.lists(st.lists(st.integers(0, n - 1), unique=True, max_size=3), min_size=n, max_size=n))


def reach(reads: list[list[int]], root: int) -> set[int]:
    seen: set[int] = set()
    stack = [root]
    while stack:
        for node in reads[stack.pop()]:
            if node not in seen:
                seen.add(node)
                stack.append(node)
    return seen


@given(digraph())
def test_components(reads: list[list[int]]) -> None:
    components = strong_components(reads)
    at = {node: k for k, component in enumerate(components) for node in component}
    assert sorted(at) == list(range(len(reads)))
    reached = [reach(reads, node) for node in range(len(reads))]
    for i in range(len(reads)):
        assert all(at[j] <= at[i] for j in reads[i])
        for j in range(len(reads)):
            assert (at[i] == at[j]) == (i == j or (j in reached[i] and i in reached[j]))


@given(digraph())
def test_tearing_leaves_no_cycle(reads: list[list[int]]) -> None:
    torn, order = tear(reads)
    assert sorted((*torn, *order)) == list(range(len(reads)))
    done = set(torn)
    for node in order:
        assert set(reads[node]) <= done
        done.add(node)


def test_tears_are_few() -> None:
    ring = [[(i + 1) % 1000] for i in range(1000)]
    assert len(tear(ring)[0]) == 1
    ladder = [[j for j in (i - 1, i + 1) if 0 <= j < 1000] for i in range(1000)]
    assert len(tear(ladder)[0]) == 500
