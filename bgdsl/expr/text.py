"""Expressions as text in the language's own notation."""

from __future__ import annotations

from bgdsl.expr.nodes import Expr
from bgdsl.expr.walk import topological

_PRECEDENCE = {"or": 1, "and": 2, "not": 3, "lt": 4, "le": 4, "eq": 4, "ne": 4, "add": 5, "neg": 5, "mul": 6, "div": 6, "pow": 7}
_SIGNS = {"or": " or ", "and": " and ", "lt": " < ", "le": " <= ", "eq": " == ", "ne": " <> ", "mul": "*", "div": "/", "pow": "^"}


def to_text(root: Expr) -> str:
    """The expression in the language's own notation, with no more parentheses than it needs."""
    shown: dict[Expr, tuple[str, int]] = {}

    def wrapped(node: Expr, least: int) -> str:
        text, precedence = shown[node]
        return text if precedence >= least else f"({text})"

    def added(node: Expr) -> str:
        """A further term of a sum, with its sign."""
        if node.op == "neg":
            return f" - {wrapped(node.args[0], 6)}"
        text, precedence = shown[node]
        return f" - {text[1:]}" if text.startswith("-") and precedence >= 5 else f" + {wrapped(node, 6)}"

    for node in topological((root,)):
        own = _PRECEDENCE.get(node.op, 8)
        args = node.args
        match node.op:
            case "const":
                text = repr(int(node.data)) if node.data.is_integer() and abs(node.data) < 1e15 else repr(node.data)
                own = 5 if node.data < 0 else 8
            case "param" | "var":
                text = node.data
            case "time":
                text = "time"
            case "add":
                text = wrapped(args[0], 5) + "".join(added(arg) for arg in args[1:])
            case "neg":
                text = f"-{wrapped(args[0], 6)}"
            case "not":
                text = f"not {wrapped(args[0], 4)}"
            case "if":
                text = f"if {shown[args[0]][0]} then {shown[args[1]][0]} else {shown[args[2]][0]}"
                own = 0
            case "table":
                text = f"{node.data[0]}{chr(39) * node.data[1]}({shown[args[0]][0]})"
            case op if op in _SIGNS:
                right = own + 1 if op in ("div", "pow", "lt", "le", "eq", "ne", "mul") else own
                left = own + 1 if op in ("pow", "lt", "le", "eq", "ne") else own
                text = _SIGNS[op].join((wrapped(args[0], left), wrapped(args[1], right)))
                if op == "mul" and text.startswith("-"):
                    own = 5
            case op:
                text = f"{op}({', '.join(shown[arg][0] for arg in args)})"
        shown[node] = (text, own)
    return shown[root][0]
