"""A reduced model reduced again: what falls in a part of a two-port or bond is another value of its `acts`.

Input        Plan, Writer of a model that has such parts
Output       the plan without what falls inside them; what is left of each
Establishes  no class of bonds/one_way.bg is copied or cut through
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bgdsl.reductions.one_way import fell_in
from bgdsl.reductions.part_bonds import ends_of
from bgdsl.reductions.plan import Cut, Entry, Plan, Removal, Split
from bgdsl.reductions.source_map import SourceMap, UnwritableError, indexed
from bgdsl.reductions.statements import Acts
from bgdsl.reductions.writer import Writer
from bgdsl.syntax import ast

ONE_WAY = Path(__file__).parent.parent / "library" / "bonds" / "one_way.bg"


@dataclass(slots=True)
class Part:
    """A part of a two-port or bond of the model at hand: its class and what is left of it, row by row; a bond's in one column."""

    kind: str
    rows: list[list[int]]

    @property
    def acts(self) -> Acts:
        if self.kind.startswith("Bond"):
            return tuple(row[0] for row in self.rows)
        return self.rows[0][0] if self.kind.startswith("One") else tuple(map(tuple, self.rows))


def parts_of(writer: Writer) -> dict[str, Part]:
    """The parts that the model has, by path."""
    given = {parameter.name: parameter for parameter in writer.graph.parameters if parameter.name.endswith(".acts")}
    found: dict[str, Part] = {}
    for instance in writer.graph.instances:
        source, acts = instance.class_span.source, given.get(f"{instance.path}.acts")
        if acts is None or source.path is None or source.path.resolve() != ONE_WAY.resolve():
            continue
        height, width = (*acts.shape, 1, 1)[:2]
        values = [int(writer.numbers[name]) for name in acts.scalars()]
        found[instance.path] = Part(instance.class_name, [values[i * width : (i + 1) * width] for i in range(height)])
    return found


def fold(task: Plan, parts: Mapping[str, Part], writer: Writer) -> tuple[Plan, dict[str, None]]:
    """Take what falls inside parts into what is left of them: the plan without it, and the parts that lost something."""
    lost: dict[str, None] = {}

    def inside(path: str) -> Part | None:
        part = parts.get(path)
        if part is not None:
            lost[path] = None
        return part

    splits, cuts, removals = list[Split](), list[Cut](), list[Removal]()
    for split in task.splits:
        part = inside(split.element.name.rpartition(".")[0])
        splits += [split] if part is None else _split(part, split, writer)
    for cut in task.cuts:
        part = inside(cut.bond.origins[0].path) if len(cut.bond.origins) == 1 and cut.bond.tail.node.rpartition(".")[0] in parts else None
        cuts += [cut] if part is None else _cut(part, cut, writer)
    for removal in task.removals:
        part = inside(removal.element.name.rpartition(".")[0])
        removals += [removal] if part is None else _silenced(part, removal, writer)
    junctions = tuple(name for name in task.junctions if name.rpartition(".")[0] not in parts)
    return replace(task, splits=tuple(splits), cuts=tuple(cuts), removals=tuple(removals), junctions=junctions), lost


def _split(part: Part, split: Split, writer: Writer) -> list[Split]:
    writer.tell(split.element.name.rpartition(".")[0], fell_in(split))
    for entry in split.entries:
        i, j = entry.row, entry.column
        if split.element.kind == "EJS":
            part.rows[i][j], part.rows[j][i] = (2, 2) if entry.two_way else (int(not entry.dropped[0]), int(not entry.dropped[1]))
        else:
            part.rows[i][j] = _left(entry)
    return []


def _left(entry: Entry) -> int:
    return 2 if entry.two_way else 0 if entry.gone else 1 if entry.dropped[0] else -1


def _cut(part: Part, cut: Cut, writer: Writer) -> list[Cut]:
    row = cut.bond.tail.components[0]
    for component, action in cut.actions.items():
        part.rows[row][0] = {"both": 0, "tail": 1, "head": -1}[action]
        for t in ends_of(cut.terms[component], action):
            writer.tell(cut.bond.origins[0].path, [(("flow", "effort")[writer.kinds[t]], f"[{row + 1}]", t)])
    return []


def _silenced(part: Part, removal: Removal, writer: Writer) -> list[Removal]:
    """Components of the source `forth` or `back` of a part that nothing feels any more."""
    forth = removal.element.name.endswith(".forth")
    for (_, component), t in zip(removal.spots, removal.terms, strict=True):
        what = ("flow", "effort")[writer.kinds[t]]
        writer.tell(removal.element.name.rpartition(".")[0], [(f"{what} {'to p2' if forth else 'to p1'}", f"[{component + 1}]", t)])
        by_row = forth or part.kind.startswith("Bond")
        for i, row in enumerate(part.rows):
            for j in range(len(row)):
                if (i if by_row else j) == component and row[j] == (1 if forth else -1):
                    row[j] = 0
    return []


def write_again(writer: Writer, parts: Mapping[str, Part], lost: Mapping[str, None]) -> dict[str, int]:
    """Say anew what is left of all parts, since each saying may go for several; the levels at which that is said (none, if nothing
    is lost)."""
    levels: dict[str, int] = {}
    for path, part in parts.items() if lost else ():
        parent, _, last = path.rpartition(".")
        name, index = indexed(last)
        site = writer.texts.site(path)
        if site.owner != parent or site.afar:
            raise UnwritableError((), f"`{path}` is redeclared from outside")
        writer.of(parent, site.unit).acts.setdefault((id(site.node), name), {})[index] = part.acts
        levels[path] = level_of(writer.texts, path)
    return levels


def level_of(texts: SourceMap, path: str) -> int:
    """How far out it is said what acts in a part: the number of steps to the instance whose text says so last."""
    steps = path.split(".")
    for k in range(len(steps)):
        here = ".".join(steps[: k + 1])
        wanted = [*(indexed(step)[0] for step in steps[k + 1 :]), "acts"]
        site = texts.site(here)
        member = texts.member(".".join(steps[:k]), indexed(steps[k])[0])
        nodes = [site.node, *([member[2]] if member else [])]
        if any(_says(node.arguments, wanted) for node in nodes):
            return k
    return len(steps) - 1


def _says(arguments: Sequence[ast.Argument], names: Sequence[str]) -> bool:
    for name in names:
        found = next((a for a in arguments if isinstance(a, ast.Modifier) and a.name.text == name), None)
        if found is None:
            return False
        arguments = found.nested
    return True
