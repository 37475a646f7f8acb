"""How an equation is made wrong: every mutation of a source file that the rules allow.

Python is changed along its syntax tree, C and Cython token by token.  Left out is what is no
equation: texts, types, declarations, and the checks of arguments.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Mutant", "mutants_of"]

#: Functions that check, show, copy, read or write, and compute nothing.
NO_EQUATIONS = re.compile(r"__\w+__|_?check\w*|to_dict|from_dict|is_sound|describe|plot\w*|fitted_from\w*")

SWAPPED = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
COMPARED = {ast.Gt: ">=", ast.GtE: ">", ast.Lt: "<=", ast.LtE: "<", ast.Eq: "!=", ast.NotEq: "=="}

#: Functions that give way to their first argument.
REMOVED = {"abs", "maximum", "minimum", "max", "min", "symmetrize", "swapaxes", "moveaxis", "sqrt", "cumsum"}


@dataclass(frozen=True)
class Mutant:
    """One change of a source file: the bytes from start to stop become ``new``."""

    file: str
    line: int
    start: int
    stop: int
    new: str
    rule: str

    def applied(self, source: bytes) -> bytes:
        """Return the source with the change in it."""
        return source[: self.start] + self.new.encode() + source[self.stop :]

    def lines(self, source: bytes) -> tuple[str, str]:
        """Return the line that is changed, before and after, without its margins."""
        first = source.rfind(b"\n", 0, self.start) + 1
        old = source[first:].split(b"\n", 1)[0]
        new = self.applied(source)[first:].split(b"\n", 1)[0]
        return old.decode().strip(), new.decode().strip()


def mutants_of(file: str, source: bytes, functions: str = "") -> list[Mutant]:
    """All mutants of a file, or of those of its functions whose names match a regular expression."""
    made = _python(file, source, functions) if file.endswith(".py") else _tokens(file, source, functions)
    return sorted(set(made), key=lambda mutant: (mutant.start, mutant.stop, mutant.new))


# --------------------------------------------------------------------------- Python


class _Finder(ast.NodeVisitor):
    """Collects the mutants of a module."""

    def __init__(self, file: str, source: bytes, functions: str) -> None:
        self.file, self.source, self.functions = file, source, functions
        self.begins = [0]
        for line in source.splitlines(keepends=True):
            self.begins.append(self.begins[-1] + len(line))
        self.found: list[Mutant] = []
        self.inside = not functions

    def span(self, node: ast.expr) -> tuple[int, int]:
        stop = self.begins[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        return self.begins[node.lineno - 1] + node.col_offset, stop

    def text(self, node: ast.expr) -> str:
        start, stop = self.span(node)
        return self.source[start:stop].decode()

    def put(self, start: int, stop: int, new: str, rule: str) -> None:
        if self.inside:
            line = self.source.count(b"\n", 0, start) + 1
            self.found.append(Mutant(self.file, line, start, stop, new, rule))

    def replace(self, node: ast.expr, new: str, rule: str) -> None:
        self.put(*self.span(node), new, rule)

    def between(self, left: ast.expr, right: ast.expr, pattern: str, new: str, rule: str) -> None:
        """Replace the operator that stands between two operands."""
        start, stop = self.span(left)[1], self.span(right)[0]
        found = re.search(pattern.encode(), self.source[start:stop])
        if found:
            self.put(start + found.start(), start + found.end(), new, rule)

    # what is no equation

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if NO_EQUATIONS.fullmatch(node.name):
            return
        before = self.inside
        self.inside = before or bool(re.fullmatch(self.functions, node.name))
        for statement in node.body:
            self.visit(statement)
        self.inside = before

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            if isinstance(statement, ast.FunctionDef):
                self.visit(statement)

    def ignore(self, node: ast.AST) -> None:
        """Text, names, types and errors are not changed."""

    visit_Raise = visit_Assert = visit_Import = visit_ImportFrom = visit_JoinedStr = ignore

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg == "axis" and self.text(node.value) in ("0", "1", "-1", "-2"):
            new = {"0": "1", "1": "0", "-1": "-2", "-2": "-1"}[self.text(node.value)]
            self.replace(node.value, new, "axis")
        elif node.arg not in ("axis", "dtype", "axis1", "axis2"):
            self.visit(node.value)

    def visit_With(self, node: ast.With) -> None:
        for statement in node.body:
            self.visit(statement)

    # what is one

    def visit_If(self, node: ast.If) -> None:
        if (isinstance(node.body[-1], ast.Raise) and not node.orelse) or self.text(
            node.test
        ) == "TYPE_CHECKING":
            return
        self.replace(node.test, f"not ({self.text(node.test)})", "negate")
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self.replace(node.test, f"(not ({self.text(node.test)}))", "negate")
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        literal = (ast.List, ast.Tuple, ast.JoinedStr)
        texts = isinstance(node.left, literal) or isinstance(node.right, literal)
        if type(node.op) in SWAPPED and not texts:
            new = SWAPPED[type(node.op)]
            self.between(node.left, node.right, r"[-+*/]", new, "operator")
            if isinstance(node.op, ast.Add | ast.Sub):
                self.replace(node, self.text(node.left), "drop term")
        elif isinstance(node.op, ast.MatMult):
            left, right = self.text(node.left), self.text(node.right)
            self.replace(node, f"({right}) @ ({left})", "operands")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if type(node.op) in SWAPPED:
            new = SWAPPED[type(node.op)] + "="
            self.between(node.target, node.value, r"[-+*/]=", new, "operator")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if type(node.ops[0]) in COMPARED:
            new = COMPARED[type(node.ops[0])]
            self.between(node.left, node.comparators[0], r"[<>!=]=?", new, "comparison")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        new = "or" if isinstance(node.op, ast.And) else "and"
        self.between(node.values[0], node.values[1], r"\b(and|or)\b", new, "and, or")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not | ast.Invert) and not isinstance(
            node.operand, ast.Constant
        ):
            self.replace(node, f"({self.text(node.operand)})", "drop sign")
        self.visit(node.operand)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, int | float) and not isinstance(node.value, bool):
            new = "0.8" if node.value == 0.5 else repr(node.value + 1)
            self.replace(node, new, "constant")

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr == "T":
            self.replace(node, self.text(node.value), "transpose")
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) > 1:
            first, second, *rest = [self.text(element) for element in node.slice.elts]
            if first != second:
                self.replace(node.slice, ", ".join([second, first, *rest]), "indices")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        first = node.args[0] if node.args else None
        if name in REMOVED and first is not None and self.text(node.func) in (name, f"np.{name}"):
            self.replace(node, self.text(first), "drop call")
        if name == "einsum" and isinstance(first, ast.Constant):
            operand = re.match(r"\w+", first.value.replace("...", ""))
            if operand and len(set(operand[0])) > 1:
                new = first.value.replace(operand[0], operand[0][::-1], 1)
                self.replace(first, f'"{new}"', "einsum")
        if name != "cast":
            self.generic_visit(node)


def _python(file: str, source: bytes, functions: str) -> list[Mutant]:
    finder = _Finder(file, source, functions)
    finder.visit(ast.parse(source))
    return [mutant for mutant in finder.found if _parses(mutant.applied(source))]


def _parses(source: bytes) -> bool:
    try:
        ast.parse(source)
    except SyntaxError:
        return False
    return True


# --------------------------------------------------------------------------- C and Cython

#: Operators have a space on either side here; a star without one makes a pointer.
TOKENS = (
    (re.compile(r" ([-+*/])(?= )"), {"+": "-", "-": "+", "*": "/", "/": "*"}, "operator"),
    (re.compile(r" ([-+*/]=)(?= )"), {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*="}, "operator"),
    (
        re.compile(r" ([<>!=]=?)(?= )"),
        {">": ">=", "<": "<=", "==": "!=", "!=": "==", ">=": ">", "<=": "<"},
        "",
    ),
    (re.compile(r" (&&|\|\|)(?= )"), {"&&": "||", "||": "&&"}, "and, or"),
    (re.compile(r"\b(fabs|sqrt)\b(?=\()"), {"fabs": "", "sqrt": ""}, "drop call"),
    (re.compile(r"(?<![\w.])(\d+\.\d+|\d+)(?![\w.])"), None, "constant"),
)

#: Lines that declare, copy, allocate, or say something.
NO_ARITHMETIC = re.compile(
    r"^\s*#|^\s*(FK_STATIC|FK_TARGET|FK_INLINE|typedef|case|cdef|def|from|import|raise)\b"
    r"|while \(0\)|double \*\w+ = |memcpy|memset|sizeof|__attribute__|Error\(|FK_SIZE"
    r"|^\s*(const )?(double|FK_V|int) \w+\[[^=]*$"
)
#: Loops and places in memory: a mutant there fails at random, or crashes.
PLACES = re.compile(r"\bfor \([^;]*;[^;]*;[^)]*\)|\[[^\[\]]*\]|\(size_t\)\([^()]*\) \* ld|\bFK_CELL\([^)]*\)")
COMMENT = re.compile(r'/\*.*?\*/|"""(?:.|\n)*?"""|"[^"\n]*"', re.DOTALL)
BEGINS = re.compile(r"^(?:FK_STATIC|FK_INLINE\w*|FK_TARGET|def|cdef)\b")
NAME = re.compile(r"FK_NAME\((\w+)\)\(|\b(?!__attribute__)(\w+)\(")


def _tokens(file: str, source: bytes, functions: str) -> Iterator[Mutant]:
    text = source.decode("ascii", "replace")  # one character per byte
    plain = COMMENT.sub(lambda found: re.sub(r"[^\n]", "~", found[0]), text)
    at, wide, name, body = 0, False, "", True
    for number, line in enumerate(plain.splitlines(keepends=True), 1):
        if BEGINS.match(line):
            named = NAME.search(line.replace("FK_NAME(fk", "~FK_NAME(fk", 1).split("~")[-1])
            name, body = next(filter(None, named.groups())) if named else "", False
        if re.match(r"#if.*FK_WIDTH == 8", line):  # only some processors have vectors of eight
            wide = True
        elif re.match(r"#el|#endif", line):
            wide = False
        if body and not wide and not NO_ARITHMETIC.search(line) and re.fullmatch(functions or ".*", name):
            yield from _of_line(file, number, at, line)
        if re.search(r"[{:]\s*$|\{.*\}\s*$", line):  # the signature is over
            body = True
        at += len(line)


def _of_line(file: str, number: int, at: int, line: str) -> Iterator[Mutant]:
    for _ in range(2):  # brackets in brackets
        line = PLACES.sub(lambda found: "~" * len(found[0]), line)
    for pattern, table, rule in TOKENS:
        for found in pattern.finditer(line):
            old = found[1]
            if table is None:
                new = "0.8" if old == "0.5" else repr(float(old) + 1.0) if "." in old else str(int(old) + 1)
            elif old not in table:
                continue
            else:
                new = table[old]
            yield Mutant(file, number, at + found.start(1), at + found.end(1), new, rule or "comparison")
