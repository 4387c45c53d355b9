"""Scenes in Python 2: converted when they are loaded, line by line, so that errors name the lines as they stand."""

import ast
import functools
import importlib
import io
import sys
import tokenize
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

from taichisoft.errors import SceneError

# What Python 2 had without an import; a module that uses one of these and does not define it is in Python 2.
GONE = {"xrange", "unicode", "basestring", "raw_input", "unichr", "long", "execfile", "reduce", "reload", "cmp"}
# Fixers of fissix's that only tidy up, that add a line for an import, which `names_for` makes needless, or that take
# away what decides over division.
TIDY = {"idioms", "set_literal", "ws_comma", "asserts"}
LEFT_OUT = TIDY | {"intern", "reduce", "reload", "operator", "types", "buffer", "future"}
DIVIDE = "__python2_divide__"


@dataclass(frozen=True)
class Program:
    """The code of a file.

    Attributes:
        code: to be executed as a module.
        python2: whether the file is in Python 2.
        older: whether it is written for SofaPython, the generation before SofaPython3.
    """

    code: CodeType
    python2: bool
    older: bool


def compiled(path: Path) -> Program:
    """The program in a file.

    Raises:
        SceneError: it is in neither Python 3 nor Python 2.
    """
    source = path.read_bytes()
    try:
        tree = ast.parse(source, str(path))
    except (SyntaxError, ValueError) as error:
        return Program(_converted(path, source, error), python2=True, older=True)
    if is_python2(tree, path):
        return Program(_converted(path, source, None), python2=True, older=True)
    older = path.suffix == ".pyscn" or any(map(_is_older, ast.walk(tree)))
    return Program(compile(tree, str(path), "exec"), python2=False, older=older)


def _is_older(node: ast.AST) -> bool:
    """Whether this is something that only the generation of SofaPython has."""
    if isinstance(node, ast.ClassDef):
        return any(ast.unparse(base).endswith("PythonScriptController") for base in node.bases)
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(called, ast.Attribute) and called.attr in ("createObject", "createChild")


def is_python2(tree: ast.Module, path: Path) -> bool:
    """Whether a file that Python 3 understands is in Python 2, by names that are gone, or by its imports."""
    used: set[str] = set()
    bound: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            (used if isinstance(node.ctx, ast.Load) else bound).add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            bound.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            bound |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.arg):
            bound.add(node.arg)
    imports = (node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
    return bool(used & GONE - bound) or any(_is_sibling(name, path) for node in imports for name in _imported(node))


def _imported(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name.partition(".")[0] for alias in node.names]
    return [str(node.module).partition(".")[0]] if node.level == 0 else []


def _is_sibling(name: str, path: Path) -> bool:
    """Whether a module of a package imports one beside it by its name alone, which Python 3 does not find."""
    folder = path.parent
    beside = (folder / f"{name}.py").exists() or (folder / name / "__init__.py").exists()
    return (folder / "__init__.py").exists() and beside and name not in sys.stdlib_module_names


def names_for(python2: bool) -> dict[str, Any]:
    """Global variables that a module needs besides its own."""
    if not python2:
        return {}
    return {
        DIVIDE: divide,
        "reduce": functools.reduce,
        "reload": importlib.reload,
        "intern": sys.intern,
        "cmp": lambda first, second: (first > second) - (first < second),
    }


def divide(dividend: Any, divisor: Any) -> Any:
    """A quotient as Python 2 takes it: that of integers is an integer."""
    if isinstance(dividend, int) and isinstance(divisor, int):
        return dividend // divisor
    return dividend / divisor


class _Division(ast.NodeTransformer):
    """Calls `divide` for every division."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        return _quotient(node.left, node.right, node) if isinstance(node.op, ast.Div) else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Div):
            return node
        read = ast.parse(ast.unparse(node.target), mode="eval").body
        return ast.copy_location(ast.Assign([node.target], _quotient(read, node.value, node)), node)


def _quotient(left: ast.expr, right: ast.expr, place: ast.AST) -> ast.expr:
    call = ast.Call(ast.Name(DIVIDE, ast.Load()), [left, right], [])
    return ast.fix_missing_locations(ast.copy_location(call, place))


@functools.cache
def _tool() -> Any:
    from fissix.refactor import RefactoringTool, get_fixers_from_package

    every = get_fixers_from_package("fissix.fixes")
    return RefactoringTool([name for name in every if name.rpartition("fix_")[2] not in LEFT_OUT])


def _converted(path: Path, source: bytes, error: Exception | None) -> CodeType:
    from fissix.pgen2.parse import ParseError
    from fissix.pgen2.tokenize import TokenError

    try:
        text = _without_tabs(_decoded(source))
        tree = ast.parse(str(_tool().refactor_string(text.rstrip() + "\n", str(path))), str(path))
    except (ParseError, TokenError, SyntaxError, IndentationError) as second:
        line = getattr(error, "lineno", None) or getattr(second, "lineno", None) or 1
        what = getattr(error, "msg", None) or str(second)
        raise SceneError(f"{path}, line {line}: neither Python 3 nor Python 2: {what}; mend the line") from second
    imports = (node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module == "__future__")
    if not any(alias.name == "division" for node in imports for alias in node.names):
        tree = ast.fix_missing_locations(_Division().visit(tree))
    return compile(tree, str(path), "exec")


def _decoded(source: bytes) -> str:
    encoding, _ = tokenize.detect_encoding(io.BytesIO(source).readline)
    return io.TextIOWrapper(io.BytesIO(source), encoding, errors="replace").read()


def _without_tabs(text: str) -> str:
    """The text with its indentation in spaces; a tab goes to the next multiple of 8, as in Python 2."""
    from fissix.pgen2 import tokenize as python2

    inside: set[int] = set()
    try:
        for kind, _token, (first, _), (last, _), _line in python2.generate_tokens(io.StringIO(text).readline):
            if kind == python2.STRING:
                inside |= set(range(first + 1, last + 1))
    except (python2.TokenError, IndentationError):
        pass  # the conversion finds it again, and says so
    lines = text.split("\n")
    return "\n".join(line if number in inside else _spaces(line) for number, line in enumerate(lines, 1))


def _spaces(line: str) -> str:
    rest = line.lstrip(" \t\f")
    return line[: len(line) - len(rest)].expandtabs(8) + rest
