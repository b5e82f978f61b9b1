"""A model, or a part of one, written in the author's instances and arrays, with scalar contents where vectors are cut.

Input        ScalarGraph, the part of it that is wanted
Output       text of one model in the language with its classes; the names of its inputs and outputs; where things have gone
Establishes  what `contents` does: the balances of the wanted junctions less the dropped terms, and all that belongs to them
Reports      nothing; UnwritableError where an element cannot be written by itself
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bgdsl.ir.graph import BondGraph, Experiment
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.classes import EMPTY, Child, Classes, Given, Kind, Steps, classify
from bgdsl.reductions.compact import statements
from bgdsl.reductions.contents import gather
from bgdsl.reductions.part import Part
from bgdsl.reductions.places import INPUT, JUNCTION, PARAMETER, SIGNAL, Contents, Piece, Value, without_indices
from bgdsl.reductions.source_map import UnwritableError

Describe = Callable[[list[tuple[str, tuple[int, ...]]]], str]
"""The comment on a dropped term, from (instance, the one term) of each instance that it is about."""

LINE = 120
"""Characters that declarations of one type may share."""


@dataclass(frozen=True, slots=True)
class StructuredText:
    """text: the model and its classes. inputs, outputs: names by the variables of the whole model. forward: flat paths that did not
    stay, with their new ones, None for what is not here."""

    text: str
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    forward: Mapping[str, str | None]


def needed(scalar: ScalarGraph, part: Part) -> tuple[str, ...]:
    """The variables of other parts that a part reads."""
    return tuple(gather(scalar, part).inputs)


def structured_text(
    scalar: ScalarGraph, part: Part, annotation: str, describe: Describe, *, folder: Path | None = None, name: str | None = None
) -> StructuredText:
    """The text. describe: what to say of dropped terms; folder: where the file goes (for paths of tables); name: of the model."""
    contents = gather(scalar, part)
    tables = table_names(scalar.graph)
    classes = classify(contents, scalar.graph.instances, tables)
    writer = _Writer(scalar.graph, classes, describe, folder, name or scalar.graph.model)
    return StructuredText(writer.text(annotation), contents.inputs, contents.outputs, moved(scalar.graph, contents, classes))


def moved(graph: BondGraph, contents: Contents, classes: Classes) -> dict[str, str | None]:
    """The variables that have other paths now, and the elements, junctions and signals that are not there."""
    forward: dict[str, str | None] = {}
    for variable, spot in contents.variables.items():
        if (text := classes.shown.text(spot, "")) != variable:
            forward[variable] = text
    for things in (graph.junctions, graph.elements):
        forward |= {thing.name: None for thing in things if thing.name not in contents.there}
    for signal in graph.signals:
        forward |= {name: None for name in signal.scalars() if name not in contents.variables}
    return forward


def table_names(graph: BondGraph) -> dict[str, str]:
    """What each table is called in the text: what the author called it."""
    names: dict[str, str] = {}
    for name, table in graph.tables.items():
        before = table.span.source.text[: table.span.start] if table.span is not None else ""
        found = re.search(r"(\w+)\s*=\s*$", before)
        wanted = found.group(1) if found else name
        names[name] = wanted if wanted not in names.values() else name
    return names


class _Writer:
    def __init__(self, graph: BondGraph, classes: Classes, describe: Describe, folder: Path | None, name: str):
        self.graph, self.classes, self.describe, self.folder = graph, classes, describe, folder
        self.contents: Contents = classes.contents
        self.names = self.class_names(name)

    def class_names(self, model: str) -> dict[int, str]:
        """The author's names; a further kind of one class is named after its first instance."""
        taken = {model, *self.contents.elements.values()}
        names = {self.classes.kinds[-1].number: model}
        for kind in sorted(self.classes.kinds[:-1], key=lambda kind: (-len(kind.members), -kind.number)):
            wanted = kind.instance.class_name
            steps = [step for step in without_indices(kind.members[0]).split(".") if step.lower() != wanted.lower()]
            tries = [wanted, *(f"{wanted}_{'_'.join(steps[k:])}" for k in reversed(range(len(steps))))]
            name = next((name for name in tries if name not in taken), tries[-1])
            k = 2
            while name in taken:
                name, k = f"{tries[-1]}_{k}", k + 1
            taken.add(name)
            names[kind.number] = name
        self.nothing = "Nothing" if "Nothing" not in taken else "Nothing_of_it"
        return names

    # ------------------------------------------------------------------------------------------------------ the whole

    def text(self, annotation: str) -> str:
        kinds = list(reversed(self.classes.kinds))
        parts = ["\n".join(self.lines(kind, annotation if k == 0 else "")) for k, kind in enumerate(kinds)]
        parts += [text.replace("{}", name) for text, name in self.contents.elements.items()]
        if any(self.is_bare(child) for kind in kinds for child in kind.children):
            parts.append(f'model {self.nothing} "an element of an array of which nothing is here"\nend {self.nothing};')
        return "\n\n".join(part.rstrip() for part in parts) + "\n"

    def lines(self, kind: Kind, annotation: str) -> Iterator[str]:
        """The lines of one class."""
        path = kind.members[0]
        name = self.names[kind.number]
        body = self.contents.bodies[path]
        yield f"model {name}{self.comment_of(kind)}"
        if annotation:
            yield f"  {annotation}"
        groups = self.declarations(kind)
        yield from (f"  {line}" for rank in (PARAMETER,) for line in groups[rank])
        yield from (f"  {self.table(table)}" for table in kind.tables)
        yield from (f"  {line}" for rank in (INPUT, JUNCTION, JUNCTION + 1) for line in groups[rank])
        yield from (f"  {line}" for child in kind.children for line in self.child(kind, child))
        yield from (f"  {line}" for rank in (SIGNAL, SIGNAL + 1) for line in groups[rank])
        if not path:
            yield from (f"  {line}" for e in self.graph.experiments for line in self.experiment(e))
        inside = [
            *statements(body.links, self.classes.shown, path, self.notes(kind)),
            *(f"{self.classes.shown.text(left, path)} = {self.classes.said(value, path)};" for left, value in body.equations),
            *(f"assert({self.classes.said(value, path)}, {_string(message)});" for message, value in body.lines),
        ]
        if inside:
            yield "equation"
            yield from (f"  {line}" for line in inside)
        if body.starts:
            yield "initial equation"
            yield from (f"  {self.classes.said(left, path)} = {self.classes.said(right, path)};" for left, right in body.starts)
        yield f"end {name};"

    def comment_of(self, kind: Kind) -> str:
        if not kind.members[0]:
            return _quoted(self.graph.comment)
        found = re.match(r'\s*(?:model|element)\s+\w+\s*("(?:[^"\\]|\\.)*")', kind.instance.class_span.text)
        return f" {found.group(1)}" if found else ""

    # --------------------------------------------------------------------------------------------------- declarations

    def declarations(self, kind: Kind) -> dict[int, list[str]]:
        """Lines by rank; what has one type and no comment shares them."""
        path = kind.members[0]
        body = self.contents.bodies[path]
        told: dict[int, list[tuple[str, str, str]]] = defaultdict(list)
        done: set[str] = set()
        for piece in body.pieces.values():
            array = piece.spot.key in self.classes.shown.arrays
            name = piece.spot.name if array else self.classes.shown.name(piece.spot)
            if name not in done:
                done.add(name)
                told[piece.rank].append(self.declared(kind, piece, name, array=array))
        return defaultdict(list, {rank: _shared(rows) for rank, rows in told.items()})

    def declared(self, kind: Kind, piece: Piece, name: str, *, array: bool) -> tuple[str, str, str]:
        """(type with prefixes, what is declared, comment)."""
        tree = _Tree()
        for steps in piece.values:
            if steps and (None, EMPTY, (name, *steps)) in kind.given:
                tree.put(steps, kind.given[None, EMPTY, (name, *steps)])
        arguments = list(tree.arguments())
        if piece.law is not None:
            arguments.insert(0, f"{piece.law[0]} = {self.classes.said(piece.law[1], kind.members[0])}")
        each = "each " if array else ""
        arguments += [f"{each}{text}" for text in piece.fixed]
        value = kind.given.get((None, EMPTY, (name,)))
        extent = f"[{', '.join(map(str, self.contents.extents[piece.spot.key]))}]" if array else ""
        prefix = "input " if piece.rank == SIGNAL and (name,) in kind.inputs else piece.prefix
        given = f"({', '.join(arguments)})" if arguments else ""
        shown = f"{name}{extent}{piece.dims}{given}{f' = {value.text}' if value else ''}"
        final = "final " if piece.final and value else ""
        return f"{'open ' if piece.open else ''}{final}{prefix}{piece.type}", shown, _quoted(piece.comment)

    def child(self, kind: Kind, child: Child) -> Iterator[str]:
        """The declaration of an instance or an array of them; elements of differing classes are redeclared."""
        size = [max(index[k] for index in child.kinds) for k in range(len(next(iter(child.kinds))))]
        dims = f"[{', '.join(map(str, size))}]" if size else ""
        if not child.several:
            number = next(iter(child.kinds.values()))
            yield f"{self.names[number]} {child.name}{dims}{self.modified(kind, child, number)}{_quoted(child.comment)};"
            return
        yield f"{self.nothing} {child.name}{dims}{_quoted(child.comment)};"
        for number in dict.fromkeys(child.kinds.values()):
            chosen = [index for index, k in child.kinds.items() if k == number]
            if number != EMPTY:
                yield f"redeclare {self.names[number]} {child.name}[{_chosen(chosen)}]{self.modified(kind, child, number)};"

    def is_bare(self, child: Child) -> bool:
        return child.several

    def modified(self, kind: Kind, child: Child, number: int) -> str:
        tree = _Tree()
        for (name, of, steps), given in kind.given.items():
            if name == child.name and of == number:
                tree.put(steps, given)
        arguments = list(tree.arguments())
        return f"({', '.join(arguments)})" if arguments else ""

    def table(self, name: str) -> str:
        span = self.graph.tables[name].span
        if span is None:
            raise UnwritableError((), f"where table `{name}` comes from is not known")
        text = span.text
        home = span.source.path.resolve().parent if span.source.path else None
        found = re.match(r'table\s*\(\s*"([^"]*)"', text)
        if found and home is not None and self.folder is not None and self.folder.resolve() != home:
            moved = Path(os.path.relpath(home / found.group(1), self.folder.resolve())).as_posix()
            text = text[: found.start(1)] + moved + text[found.end(1) :]
        return f"parameter Table {self.classes.tables[name]} = {text};"

    def experiment(self, experiment: Experiment) -> Iterator[str]:
        settings = {"stopTime": experiment.stop_time, "interval": experiment.interval, "tolerance": experiment.tolerance}
        parts = [f"{name} = {_shown(value)}" for name, value in settings.items() if value is not None]
        if experiment.method is not None:
            parts.append(f'method = "{experiment.method}"')
        if experiment.window is not None:
            parts.append(f"window = {{{', '.join(map(_shown, experiment.window))}}}")
        for scalar, value in experiment.changes.items():
            if scalar in self.contents.readings:
                parts.append(f"{self.classes.shown.text(self.contents.readings[scalar][0], '')} = {self.classes.said(Value((value,)), '')}")
        yield f"experiment {experiment.name}({', '.join(parts)}){_quoted(experiment.comment)};"

    # ---------------------------------------------------------------------------------------------------------- notes

    def notes(self, kind: Kind) -> dict[int, list[str]]:
        """Comments on dropped terms, by the link before which they stand; one for what is alike in all instances, or for the elements
        of an array, or for terms of a junction that are equally small."""
        rows: dict[str, list[tuple[int, str, int]]] = {}
        for path in kind.members:
            for position, term in self.contents.bodies[path].notes:
                text = self.describe([(path, (term,))]).rpartition(", rho")[0]
                rows.setdefault(text, []).append((position, path, term))
        groups: dict[str, list[str]] = defaultdict(list)
        for text in rows:
            groups[_ELEMENT.sub("[#]", text)].append(text)
        said: dict[tuple[str, str], list[tuple[int, str]]] = defaultdict(list)
        for texts in groups.values():
            together = _of_all(texts)
            for some in [texts] if together else [[text] for text in texts]:
                members = [row for text in some for row in rows[text]]
                told = self.describe([(path, (term,)) for _, path, term in members])
                what, _, name = (together or some[0]).partition(" of ")
                said[what, told.rpartition(", rho")[2]].append((min(position for position, _, _ in members), name))
        found: dict[int, list[str]] = defaultdict(list)
        for (what, rho), names in said.items():
            found[min(names)[0]].append(f"{what} of {', '.join(name for _, name in names)}, rho{rho}")
        return found


_ELEMENT = re.compile(r"\[\d+\](?=[.\[])|(?<=[a-z]_)\d+(?=_)")
"""The number of an element of an array of components in a path, or in the name of a bond."""


def _of_all(texts: Sequence[str]) -> str | None:
    """One text for those that differ in the element of an array that they are about."""
    if len(texts) < 2:
        return None
    rows = [[int(number) for match in _ELEMENT.findall(text) for number in re.findall(r"\d+", match)] for text in texts]
    columns = list(zip(*rows, strict=True))
    running = {column for column in columns if len(set(column)) > 1}
    if len(running) != 1:
        return None
    chosen = _chosen([(number,) for number in running.pop()])
    shown = iter(chosen if len(set(column)) > 1 else str(column[0]) for column in columns)
    return _ELEMENT.sub(lambda match: f"[{next(shown)}]" if match.group().startswith("[") else next(shown).replace(":", ".."), texts[0])


class _Tree:
    """Modifications by name, nested."""

    def __init__(self) -> None:
        self.value: Given | None = None
        self.inside: dict[str, _Tree] = {}

    def put(self, steps: Steps, given: Given) -> None:
        node = self
        for step in steps:
            node = node.inside.setdefault(step, _Tree())
        node.value = given

    def arguments(self) -> Iterator[str]:
        for name, node in self.inside.items():
            nested = ", ".join(node.arguments())
            if nested:
                yield f"{name}({nested})"
            if node.value is not None:
                yield f"{'each ' if node.value.each else ''}{'final ' if node.value.final else ''}{name} = {node.value.text}"


def _shared(rows: Sequence[tuple[str, str, str]]) -> list[str]:
    """Declarations of one type after each other on one line, as far as it is wide."""
    lines: list[str] = []
    before = ""
    for kind, shown, comment in rows:
        if lines and kind == before and not comment and not kind.startswith("parameter") and len(lines[-1]) + len(shown) < LINE:
            lines[-1] = f"{lines[-1][:-1]}, {shown};"
        else:
            lines.append(f"{kind} {shown}{comment};")
        before = kind if not comment else ""
    return lines


def _chosen(indices: Sequence[tuple[int, ...]]) -> str:
    """The subscripts that choose elements of an array with one dimension (or one element of a larger one)."""
    if len(indices) == 1:
        return ", ".join(map(str, indices[0]))
    numbers = sorted(index[0] for index in indices)
    if numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}:{numbers[-1]}"
    return f"{{{', '.join(map(str, numbers))}}}"


def _shown(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _quoted(comment: str) -> str:
    return f" {_string(comment)}" if comment else ""


def _string(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
