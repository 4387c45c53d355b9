"""Detection of files in Python 2 that Python 3 can parse."""

import ast
import builtins
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

from taichisoft_sofa.tree.python2_names import GONE, OF_STRING

OLDER_CALLS = ("createObject", "createChild")
OLDER_CLASS = "PythonScriptController"
PRESENT_MODULES = ("Sofa.Core", "SofaRuntime")
VERSIONS = ("version_info", "hexversion", "PY2", "PY3", "version")
PRESENT_SYNTAX = (
    *(ast.JoinedStr, ast.AnnAssign, ast.Nonlocal, ast.YieldFrom, ast.AsyncFunctionDef, ast.Await),
    *(ast.NamedExpr, ast.Match, ast.MatMult),
)
"""Syntax that is not valid in Python 2."""


def is_older(tree: ast.Module) -> bool:
    """Whether a file uses a feature of SofaPython only, the generation before SofaPython3."""
    return any(_older_mark(node) for node in ast.walk(tree))


def why_python2(tree: ast.Module, path: Path, in_package: bool) -> str:
    """Reason why a file that Python 3 can parse is in Python 2, with the line; "" for Python 3.

    A file with syntax or imports of Python 3 or SofaPython3 only is in Python 3, regardless of the rest.

    Args:
        tree: the file, parsed by Python 3.
        path: the file.
        in_package: whether the file is in a package, within which Python 2 imports modules by their bare names.
    """
    if any(_only_python3(node) for node in ast.walk(tree)):
        return ""
    for node in ast.walk(tree):
        if mark := _older_mark(node) or _prints_to(node):
            return f"line {_line(node)}: {mark}"
    for name, node in _unguarded_names(tree):
        return f"line {node.lineno}: {name} is not defined, and Python 2 has it"
    for node in tree.body if in_package else ():
        if isinstance(node, ast.Import | ast.ImportFrom):
            for name in _imported(node):
                if _is_neighbour_alone(name, path):
                    return f"line {node.lineno}: imports '{name}', which is beside it in a package, by its name alone"
    return ""


def _line(node: ast.AST) -> int:
    return int(getattr(node, "lineno", 1))


def _only_python3(node: ast.AST) -> bool:
    """Whether a node is not valid in Python 2 or SofaPython."""
    if isinstance(node, PRESENT_SYNTAX):
        return True
    if isinstance(node, ast.FunctionDef):
        return node.returns is not None
    if isinstance(node, ast.arguments):
        every = (*node.posonlyargs, *node.args, *node.kwonlyargs)
        return bool(node.kwonlyargs or node.posonlyargs) or any(one.annotation is not None for one in every)
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id == "super" and not node.args
    if isinstance(node, ast.Raise):
        return node.cause is not None
    if isinstance(node, ast.Import):
        return any(alias.name in PRESENT_MODULES for alias in node.names)
    return isinstance(node, ast.ImportFrom) and node.module in PRESENT_MODULES


def _older_mark(node: ast.AST) -> str:
    """Feature of SofaPython only in a node, or ""."""
    if isinstance(node, ast.ClassDef) and any(ast.unparse(base).endswith(OLDER_CLASS) for base in node.bases):
        return OLDER_CLASS
    called = node.func if isinstance(node, ast.Call) else None
    if not isinstance(called, ast.Attribute) or called.attr not in OLDER_CALLS:
        return ""
    return called.attr


def _prints_to(node: ast.AST) -> str:
    """Detect the statement `print >> file`, which Python 3 parses as a shift."""
    shifts = isinstance(node, ast.BinOp) and isinstance(node.op, ast.RShift) and isinstance(node.left, ast.Name)
    return "print >>" if shifts and node.left.id == "print" else ""  # type: ignore[attr-defined]


def _unguarded_names(tree: ast.Module) -> Iterator[tuple[str, ast.expr | ast.ImportFrom]]:
    """Names of Python 2 that Python 3 does not have, except names whose absence the file handles.

    The file does so if it defines the name, has a star import, or uses the name within `try` or a check of the version.
    """
    bound = set(_bound(tree))
    guarded = {id(inside) for node in ast.walk(tree) if _guards(node) for inside in ast.walk(node)}
    stars = any(isinstance(node, ast.ImportFrom) and node.names[0].name == "*" for node in ast.walk(tree))
    string = any(isinstance(node, ast.Import) and "string" in map(_alias, node.names) for node in ast.walk(tree))
    for node in ast.walk(tree):
        if id(node) in guarded:
            continue
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and not stars:
            if node.id in GONE and node.id not in bound and not hasattr(builtins, node.id):
                yield f"'{node.id}'", node
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and string:
            if node.value.id == "string" and node.attr in OF_STRING:
                yield f"'string.{node.attr}'", node
        elif isinstance(node, ast.ImportFrom) and node.module == "string" and not node.level:
            yield from ((f"'string.{one.name}'", node) for one in node.names if one.name in OF_STRING)


def _alias(alias: ast.alias) -> str:
    return alias.asname or alias.name


def _guards(node: ast.AST) -> bool:
    """Whether a node guards its content: `try`, or a check of the version of Python."""
    if isinstance(node, ast.Try):
        return bool(node.handlers)
    if not isinstance(node, ast.If | ast.IfExp):
        return False
    words = {getattr(part, "id", getattr(part, "attr", "")) for part in ast.walk(node.test)}
    return not words.isdisjoint(VERSIONS)


def _bound(tree: ast.Module) -> Iterator[str]:
    """All names bound in a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from (_alias(alias).partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name


def _imported(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name.partition(".")[0] for alias in node.names]
    return [str(node.module).partition(".")[0]] if node.level == 0 else []


def _is_neighbour_alone(name: str, path: Path) -> bool:
    """Whether a module is beside a file, and not found elsewhere by Python 3."""
    beside = (path.parent / f"{name}.py").exists() or (path.parent / name / "__init__.py").exists()
    if not beside or name in sys.stdlib_module_names or name in sys.modules:
        return False
    return importlib.util.find_spec(name) is None
