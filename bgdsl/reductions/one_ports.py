"""One-ports and users' elements of a part as declarations: what they are given, and how their laws are said."""

from __future__ import annotations

from bgdsl.expr import Expr, const, leaves, substitute, to_text, topological, var
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import Term
from bgdsl.reductions.places import ELEMENT, Piece, Spot, Value, flat_name, split, without_indices
from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.survey import Survey
from bgdsl.reductions.wording import Wording


class OnePorts:
    """Makes declarations from elements. classes: the texts of users' elements with `{}` for the name, and their names."""

    def __init__(self, left: Survey, wording: Wording, classes: dict[str, str]):
        self.left, self.wording, self.classes = left, wording, classes
        self.terms = {(term.element, term.spot): term.index for term in left.scalar.terms if term.other is None}
        self.class_names = {instance.path: instance.class_name for instance in left.scalar.graph.instances}

    def scalar(self, element: Element, term: Term, here: Spot) -> Piece:
        """A scalar one-port: its law in its own letters, starts, flags."""
        port, prepared = element.ports[term.port], self.wording.prepared
        piece = Piece(here, ELEMENT, element.kind, fixed=_flags(element), comment=element.comment)
        if element.linear is not None:
            parameter, rows = element.linear
            piece.values[parameter,] = Value(prepared((rows[term.spot][term.spot],)))
        else:
            letters = {port.variable(element.name, letter, term.spot): letter for letter in "efpq"}
            law = next((law for law in element.laws if any(leaf.data in letters for leaf in leaves((law.left, law.right)))), None)
            if law is None or law.left.op != "var" or law.left.data not in letters:
                raise UnwritableError((term.index,), f"the law of `{element.name}` is not given for one variable")
            right = prepared((law.right,), (term.index,), letters)
            if any(leaf.data in letters for leaf in leaves(right)):
                piece.law = letters[law.left.data], Value(right, letters=letters)
            else:
                piece.values[letters[law.left.data],] = Value(right)
        for letter in "efpq":
            start = element.starts.get(port.variable(element.name, letter, term.spot))
            if start is not None:
                piece.values[letter, "start"] = Value((self.wording.short(start),))
        return piece

    def vector(self, element: Element) -> Piece:
        """A vector one-port that stays whole."""
        port = element.ports[0]
        n, prepared = port.width, self.wording.prepared
        piece = Piece(split(element.name), ELEMENT, f"{element.kind}[{n}]", fixed=_flags(element), comment=element.comment)
        if element.linear is not None:
            parameter, rows = element.linear
            entries = prepared(tuple(entry for row in rows for entry in row))
            if all(entries[i * n + k].is_zero for i in range(n) for k in range(n) if i != k):
                piece.values[parameter,] = Value(entries[:: n + 1], (n,), diagonal=True)
            else:
                piece.values[parameter,] = Value(entries, (n, n))
        elif self.left.is_tied(element):
            raise UnwritableError((), f"the laws of `{element.name}` tie its components and are not linear")
        else:
            letter = element.laws[0].left.data.rpartition(".")[2].partition("[")[0]
            right = {law.left.data: law.right for law in element.laws}
            law = tuple(right[port.variable(element.name, letter, i)] for i in range(n))
            made = tuple(prepared((root,), (self.terms[element.name, i],))[0] for i, root in enumerate(law))
            piece.values[letter,] = Value(made, (n,))
        for letter in "efpq":
            starts = [element.starts.get(port.variable(element.name, letter, i)) for i in range(n)]
            if any(start is not None for start in starts):
                piece.values[letter, "start"] = Value(tuple(const(0.0) if s is None else self.wording.short(s) for s in starts), (n,))
        return piece

    def field(self, element: Element) -> Piece:
        """A user's element: its class, with what it reads as inputs and parameters, and the instance that binds them."""
        if element.name in self.left.torn:
            raise UnwritableError((), f"`{element.name}` would be cut in two")
        spots = [(port, x, i) for port in element.ports for x in "ef" for i in range(port.width)]
        local = {port.variable(element.name, x, i): port.variable("", x, i)[1:] for port, x, i in spots}
        roots = self.wording.prepared(tuple(side for law in element.laws for side in (law.left, law.right)), (), local)
        piece = Piece(split(element.name), ELEMENT, "", comment=element.comment)
        bound: dict[Expr, Expr] = {}
        lines: list[str] = []
        for leaf in [node for node in topological(roots) if node.op in ("var", "param")]:
            if leaf.data in local:
                bound[leaf] = var(local[leaf.data])
                continue
            own = flat_name(without_indices(leaf.data.removeprefix(f"{element.name}.").removeprefix(f"{piece.spot.owner}.")))
            bound[leaf] = var(own)
            lines.append(f"  {'parameter' if leaf.op == 'param' else 'input'} Real {own};")
            piece.values[own,] = Value((leaf,))
        texts = [to_text(root) for root in substitute(roots, bound)]
        for port in element.ports:
            lines.append(f"  port {'in' if port.inward else 'out'} Generic{'' if port.size is None else f'[{port.size}]'} {port.name};")
        laws = [f"  {left} = {right};" for left, right in zip(texts[::2], texts[1::2], strict=True)]
        text = "\n".join(["element {}", *lines, "equation", *laws, "end {};", ""])
        piece.type = self.element_class(text, self.class_names.get(element.name, "Field"))
        return piece

    def element_class(self, text: str, wanted: str) -> str:
        names = self.classes
        if text not in names:
            taken, name, k = set(names.values()), wanted, 2
            while name in taken:
                name, k = f"{wanted}_{k}", k + 1
            names[text] = name
        return names[text]


def _flags(element: Element) -> tuple[str, ...]:
    return ("parasitic = true",) if element.parasitic else ()
