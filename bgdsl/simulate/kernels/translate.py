"""Kernels, Python's trees, to the text of LLVM: one function each, locals in slots that LLVM turns into registers."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from bgdsl.simulate.kernels.kinds import STRUCTS, Callee

_ELEMENTS = {"reals": "real", "sole": "real", "ints": "int", "octets": "byte", "places": "place", "wholes": "whole"}
_WIDTHS = {"reals": 8, "sole": 8, "ints": 4, "octets": 1, "places": 8, "wholes": 8, "place": 1}
_TYPES = {"real": "double", "whole": "i64", "int": "i32", "byte": "i8", "truth": "i1", "none": "void"}
_COMPARISONS = {
    ast.Lt: ("olt", "slt"),
    ast.LtE: ("ole", "sle"),
    ast.Gt: ("ogt", "sgt"),
    ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"),
    ast.NotEq: ("une", "ne"),
}
_ARITHMETIC = {
    ast.Add: ("fadd", "add"),
    ast.Sub: ("fsub", "sub"),
    ast.Mult: ("fmul", "mul"),
    ast.Div: ("fdiv", ""),
    ast.FloorDiv: ("", "sdiv"),
    ast.Mod: ("", "srem"),
}
Value = tuple[str, str]
"""The LLVM name of a value, and its kind."""


def definition(function: Callable[..., Any]) -> ast.FunctionDef:
    """The tree of a kernel, from its source."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


def annotation(node: ast.expr | None) -> str:
    """The kind that an annotation names."""
    match node:
        case ast.Name(id=name) | ast.Constant(value=str(name)):
            return name
        case _:
            return "None"


def returns_of(tree: ast.FunctionDef) -> str:
    """What a kernel returns: `none`, `real`, or `int` of 32 bits."""
    return {"None": "none", "real": "real"}.get(annotation(tree.returns), "int")


def ir_of(functions: Mapping[str, Callable[..., Any]]) -> str:
    """The LLVM text of the kernels."""
    trees = {name: definition(function) for name, function in functions.items()}
    kinds = {name: [annotation(arg.annotation) for arg in tree.args.args] for name, tree in trees.items()}
    returns = {name: returns_of(tree) for name, tree in trees.items()}
    bodies = [_Body(name, tree, kinds, returns, functions[name].__globals__).text() for name, tree in trees.items()]
    return "\n".join(("declare double @llvm.sqrt.f64(double)", "declare double @llvm.fabs.f64(double)", *bodies))


def _type(kind: str) -> str:
    return _TYPES.get(kind, "ptr")


class _Body:
    """One kernel being translated."""

    def __init__(
        self, name: str, tree: ast.FunctionDef, kinds: Mapping[str, list[str]], returns: Mapping[str, str], names: Mapping[str, Any]
    ):
        self.name, self.tree, self.kinds, self.returns, self.names = name, tree, kinds, returns, names
        self.slots: list[str] = []
        self.lines: list[str] = []
        self.locals: dict[str, Value] = {}
        self.loops: list[tuple[str, str]] = []
        self.count = 0
        self.ended = False

    def text(self) -> str:
        arguments = [
            f"{_type(kind)} {'noalias ' if kind == 'sole' else ''}%a.{arg.arg}"
            for arg, kind in zip(self.tree.args.args, self.kinds[self.name], strict=True)
        ]
        for arg, kind in zip(self.tree.args.args, self.kinds[self.name], strict=True):
            self._store_local(arg.arg, (f"%a.{arg.arg}", kind))
        self._statements(self.tree.body)
        result = self.returns[self.name]
        if not self.ended:
            self._end("ret void" if result == "none" else f"ret {_type(result)} {'0' if result == 'int' else '0.0'}")
        head = f"define {_type(result)} @{self.name}({', '.join(arguments)}) {{"
        return "\n".join((head, "entry:", *self.slots, *self.lines, "}"))

    # lines

    def _new(self) -> str:
        self.count += 1
        return f"%v{self.count}"

    def _emit(self, text: str) -> str:
        name = self._new()
        self.lines.append(f"  {name} = {text}")
        return name

    def _do(self, text: str) -> None:
        self.lines.append(f"  {text}")

    def _end(self, text: str) -> None:
        self._do(text)
        self.ended = True

    def _slot(self, kind: str) -> str:
        name = self._new()
        self.slots.append(f"  {name} = alloca {_type(kind)}")
        return name

    def _label(self) -> str:
        self.count += 1
        return f"b{self.count}"

    def _begin(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.ended = False

    def _jump(self, label: str) -> None:
        if not self.ended:
            self._end(f"br label %{label}")

    def _branch(self, condition: str, yes: str, no: str) -> None:
        self._end(f"br i1 {condition}, label %{yes}, label %{no}")

    # statements

    def _statements(self, body: Iterable[ast.stmt]) -> None:
        for statement in body:
            if self.ended:
                return
            self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value=value):
                self._expression(value)
            case ast.Assign(targets=[target], value=value):
                self._assign(target, self._expression(value))
            case ast.AugAssign(target=target, op=op, value=value):
                load = ast.parse(ast.unparse(target), mode="eval").body
                self._assign(target, self._binary(op, self._expression(load), self._expression(value)))
            case ast.If(test=test, body=body, orelse=orelse):
                self._if(test, body, orelse)
            case ast.While(test=test, body=body):
                self._loop(lambda: self._condition(test), body, None)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args), body=body):
                self._for(name, args, body)
            case ast.Return(value=None):
                self._end("ret void")
            case ast.Return(value=value):
                assert value is not None
                result = self.returns[self.name]
                self._end(f"ret {_type(result)} {self._cast(self._expression(value), result)}")
            case ast.Break():
                self._jump(self.loops[-1][1])
            case ast.Continue():
                self._jump(self.loops[-1][0])
            case _:
                raise SyntaxError(f"kernels cannot say {ast.unparse(node)!r}")

    def _assign(self, target: ast.expr, value: Value) -> None:
        match target:
            case ast.Name(id=name):
                self._store_local(name, value)
            case ast.Subscript(value=base, slice=index):
                self._store(*self._element(base, index), value)
            case ast.Attribute(value=base, attr=name):
                self._store(*self._field(base, name), value)
            case _:
                raise SyntaxError(f"kernels cannot assign to {ast.unparse(target)!r}")

    def _store(self, pointer: str, kind: str, value: Value) -> None:
        number = self._cast(value, kind)
        self._do(f"store {_type(kind)} {number}, ptr {pointer}")

    def _store_local(self, name: str, value: Value) -> None:
        kind = "whole" if value[1] in ("int", "truth", "byte") else value[1]
        if name not in self.locals:
            self.locals[name] = self._slot(kind), kind
        slot, kind = self.locals[name]
        self._store(slot, kind, value)

    def _if(self, test: ast.expr, body: list[ast.stmt], orelse: list[ast.stmt]) -> None:
        yes, no, after = (self._label() for _ in range(3))
        self._branch(self._condition(test), yes, no)
        for label, statements in ((yes, body), (no, orelse)):
            self._begin(label)
            self._statements(statements)
            self._jump(after)
        self._begin(after)

    def _for(self, name: str, args: list[ast.expr], body: list[ast.stmt]) -> None:
        bounds = [self._expression(arg) for arg in args]
        start, stop = (("0", "whole"), bounds[0]) if len(bounds) == 1 else bounds[:2]
        down = len(args) == 3
        assert not down or ast.unparse(args[2]) == "-1", "steps are 1 or -1"
        self._store_local(name, start)
        slot, limit = self.locals[name][0], self._cast(stop, "whole")

        def going() -> str:
            return self._emit(f"icmp {'sgt' if down else 'slt'} i64 {self._emit(f'load i64, ptr {slot}')}, {limit}")

        def advance() -> None:
            following = self._emit(f"add i64 {self._emit(f'load i64, ptr {slot}')}, {-1 if down else 1}")
            self._do(f"store i64 {following}, ptr {slot}")

        self._loop(going, body, advance)

    def _loop(self, condition: Callable[[], str], body: list[ast.stmt], advance: Callable[[], None] | None) -> None:
        head, inside, onward, after = (self._label() for _ in range(4))
        self._jump(head)
        self._begin(head)
        self._branch(condition(), inside, after)
        self.loops.append((onward, after))
        self._begin(inside)
        self._statements(body)
        self._jump(onward)
        self.loops.pop()
        self._begin(onward)
        if advance:
            advance()
        self._jump(head)
        self._begin(after)

    # expressions

    def _condition(self, node: ast.expr) -> str:
        return self._cast(self._expression(node), "truth")

    def _expression(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=bool(value)):
                return str(int(value)), "truth"
            case ast.Constant(value=int(value)):
                return str(value), "whole"
            case ast.Constant(value=float(value)):
                return _real(value), "real"
            case ast.Name(id=name):
                return self._name(name)
            case ast.BinOp(left=left, op=op, right=right):
                return self._binary(op, self._expression(left), self._expression(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._negative(self._expression(operand))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self._emit(f"xor i1 {self._condition(operand)}, 1"), "truth"
            case ast.BoolOp(op=op, values=values):
                return self._short_circuit(isinstance(op, ast.And), values)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self._compare(op, self._expression(left), self._expression(right))
            case ast.Subscript(value=base, slice=index):
                return self._load(*self._element(base, index))
            case ast.Attribute(value=base, attr=name):
                return self._load(*self._field(base, name))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self._select(self._condition(test), self._expression(body), self._expression(orelse))
            case ast.Call(func=ast.Name(id=name), args=args):
                return self._call(name, [self._expression(arg) for arg in args])
            case _:
                raise SyntaxError(f"kernels cannot say {ast.unparse(node)!r}")

    def _load(self, pointer: str, kind: str) -> Value:
        value = self._emit(f"load {_type(kind)}, ptr {pointer}")
        match kind:
            case "byte":
                return self._emit(f"zext i8 {value} to i64"), "whole"
            case "int":
                return self._emit(f"sext i32 {value} to i64"), "whole"
            case _:
                return value, kind

    def _name(self, name: str) -> Value:
        if name in self.locals:
            slot, kind = self.locals[name]
            return self._emit(f"load {_type(kind)}, ptr {slot}"), kind
        value = self.names[name]
        if isinstance(value, int):
            return str(value), "whole"
        assert isinstance(value, float), f"{name} is no number"
        return _real(value), "real"

    def _negative(self, value: Value) -> Value:
        if value[1] == "real":
            return self._emit(f"fneg double {value[0]}"), "real"
        return self._emit(f"sub i64 0, {self._cast(value, 'whole')}"), "whole"

    def _select(self, condition: str, yes: Value, no: Value) -> Value:
        kind = "real" if "real" in (yes[1], no[1]) else "whole" if {yes[1], no[1]} <= {"whole", "truth"} else yes[1]
        a, b = self._cast(yes, kind), self._cast(no, kind)
        return self._emit(f"select i1 {condition}, {_type(kind)} {a}, {_type(kind)} {b}"), kind

    def _binary(self, op: ast.operator, left: Value, right: Value) -> Value:
        if left[1] in _WIDTHS:
            assert isinstance(op, ast.Add)
            return self._shift(left[0], self._scaled(right, _WIDTHS[left[1]])), left[1]
        real = "real" in (left[1], right[1]) or isinstance(op, ast.Div)
        kind = "real" if real else "whole"
        a, b = self._cast(left, kind), self._cast(right, kind)
        return self._emit(f"{_ARITHMETIC[type(op)][0 if real else 1]} {_type(kind)} {a}, {b}"), kind

    def _compare(self, op: ast.cmpop, left: Value, right: Value) -> Value:
        floating, integral = _COMPARISONS[type(op)]
        if "real" in (left[1], right[1]):
            return self._emit(f"fcmp {floating} double {self._cast(left, 'real')}, {self._cast(right, 'real')}"), "truth"
        a = left[0] if left[1] in _TYPES else self._emit(f"ptrtoint ptr {left[0]} to i64")
        return self._emit(
            f"icmp {integral} i64 {self._cast((a, left[1] if left[1] in _TYPES else 'whole'), 'whole')}, {self._cast(right, 'whole')}"
        ), "truth"

    def _short_circuit(self, conjunction: bool, values: Sequence[ast.expr]) -> Value:
        slot, after = self._slot("truth"), self._label()
        for value in values:
            condition, more = self._condition(value), self._label()
            self._do(f"store i1 {condition}, ptr {slot}")
            self._branch(condition, *((more, after) if conjunction else (after, more)))
            self._begin(more)
        self._jump(after)
        self._begin(after)
        return self._emit(f"load i1, ptr {slot}"), "truth"

    def _element(self, base: ast.expr, index: ast.expr) -> tuple[str, str]:
        pointer, kind = self._expression(base)
        return self._shift(pointer, self._scaled(self._expression(index), _WIDTHS[kind])), _ELEMENTS[kind]

    def _scaled(self, index: Value, width: int) -> str:
        return self._emit(f"mul i64 {self._cast(index, 'whole')}, {width}")

    def _field(self, base: ast.expr, name: str) -> tuple[str, str]:
        pointer, kind = self._expression(base)
        struct = STRUCTS[kind]
        return self._shift(pointer, str(8 * list(struct.fields).index(name))), struct.fields[name]

    def _shift(self, pointer: str, offset: str) -> str:
        return self._emit(f"getelementptr inbounds i8, ptr {pointer}, i64 {offset}")

    def _call(self, name: str, values: list[Value]) -> Value:
        match name:
            case "real" | "whole":
                return self._cast(values[0], name), name
            case "sqrt" | "fabs":
                return self._emit(f"call double @llvm.{name}.f64(double {self._cast(values[0], 'real')})"), "real"
        if name in STRUCTS or name in _ELEMENTS:
            return values[0][0], name
        if name in self.kinds:
            target, kinds, result = f"@{name}", self.kinds[name], self.returns[name]
        else:
            callee = self.names[name]
            assert isinstance(callee, Callee), f"{name} cannot be called"
            target, kinds, result = values.pop(0)[0], list(callee.parameters), callee.result
        arguments = ", ".join(f"{_type(kind)} {self._cast(value, kind)}" for value, kind in zip(values, kinds, strict=True))
        if result == "none":
            self._do(f"call void {target}({arguments})")
            return "", "none"
        value = self._emit(f"call {_type(result)} {target}({arguments})")
        return (self._emit(f"sext i32 {value} to i64"), "whole") if result == "int" else (value, result)

    def _cast(self, value: Value, kind: str) -> str:
        number, own = value
        if own == kind or (own not in _TYPES and kind not in _TYPES):
            return number
        match own, kind:
            case "whole", "real":
                return self._emit(f"sitofp i64 {number} to double")
            case "truth", "real":
                return self._emit(f"uitofp i1 {number} to double")
            case "real", "whole":
                return self._emit(f"fptosi double {number} to i64")
            case "truth", ("whole" | "int"):
                return self._emit(f"zext i1 {number} to {_type(kind)}")
            case "whole", ("int" | "byte"):
                return self._emit(f"trunc i64 {number} to {_type(kind)}")
            case "int", "whole":
                return self._emit(f"sext i32 {number} to i64")
            case "whole", "truth":
                return self._emit(f"icmp ne i64 {number}, 0")
            case _, "truth":
                return self._emit(f"icmp ne ptr {number}, null")
            case "whole", _:
                return self._emit(f"inttoptr i64 {number} to ptr")
            case _:
                raise TypeError(f"in kernel {self.name}: {own} is no {kind}")


def _real(value: float) -> str:
    import struct

    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"
