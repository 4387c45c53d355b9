"""Conversion of scenes in Python 2 at loading, line by line, so that errors have the original line numbers."""

import ast
import functools
import io
import tokenize
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

from taichisoft.errors import SceneError
from taichisoft.optional_packages import extra, require
from taichisoft_sofa.tree.python2_marks import is_older, why_python2
from taichisoft_sofa.tree.python2_names import DIVIDE, OF_STRING, STRING
from taichisoft_sofa.tree.xml_scenes import is_xml, xml_program

# Excluded fixers of fissix: fixers of style; fixers that add a line for an import, for which `NAMES` suffices; and
# fixers that remove the information on division.
TIDY = {"idioms", "set_literal", "ws_comma", "asserts"}
LEFT_OUT = TIDY | {"intern", "reduce", "reload", "operator", "types", "buffer", "future"}


@dataclass(frozen=True)
class Program:
    """A compiled file.

    Attributes:
        code: code of the module.
        python2: reason why the file is in Python 2, with the line; "" for Python 3.
        older: whether the file is written for SofaPython, the generation before SofaPython3.
    """

    code: CodeType
    python2: str
    older: bool


def compiled(path: Path, in_package: bool = False) -> Program:
    """Compile a file, converted from Python 2 if necessary.

    Args:
        path: the file.
        in_package: whether the file is in a package, within which Python 2 imports modules by their bare names.

    Raises:
        SceneError: the file is in neither Python 3 nor Python 2, nor a scene in XML.
    """
    source = path.read_bytes()
    if is_xml(source):
        return Program(compile(xml_program(path, source), str(path), "exec"), python2="", older=False)
    try:
        tree = ast.parse(source, str(path))
    except (SyntaxError, ValueError) as error:
        why = f"line {getattr(error, 'lineno', None) or 1}: Python 3 does not take it"
        return Program(_converted(path, source, error, in_package), python2=why, older=True)
    if why := why_python2(tree, path, in_package):
        return Program(_converted(path, source, None, in_package), python2=why, older=True)
    older = path.suffix == ".pyscn" or is_older(tree)
    return Program(compile(tree, str(path), "exec"), python2="", older=older)


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


class _String(ast.NodeTransformer):
    """Replaces functions of the module `string` that Python 3 does not have, see `OF_STRING`."""

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.value, ast.Name) and node.value.id == "string" and node.attr in OF_STRING:
            node.value.id = STRING
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.stmt | list[ast.stmt]:
        gone = [one for one in node.names if node.module == "string" and not node.level and one.name in OF_STRING]
        if not gone:
            return node
        names = [one for one in node.names if one not in gone]
        taken: list[ast.stmt] = [
            ast.copy_location(ast.parse(f"{one.asname or one.name} = {STRING}.{one.name}").body[0], node)
            for one in gone
        ]
        return [*([ast.copy_location(ast.ImportFrom("string", names, 0), node)] if names else []), *taken]


@functools.cache
def _tool(in_package: bool) -> Any:
    from fissix.refactor import RefactoringTool, get_fixers_from_package

    # Relative imports are possible in packages only.
    left_out = LEFT_OUT if in_package else LEFT_OUT | {"import"}
    every = get_fixers_from_package("fissix.fixes")
    return RefactoringTool([name for name in every if name.rpartition("fix_")[2] not in left_out])


def _converted(path: Path, source: bytes, error: Exception | None, in_package: bool) -> CodeType:
    # A file that Python 3 does not take may also be a scene in Python 3 with a mistake.
    mistake = f", line {getattr(error, 'lineno', None) or 1}: not Python 3" if error is not None else ""
    require(f"{path}{mistake}: a scene in Python 2", "fissix", install=extra("sofa"))
    from fissix.pgen2.parse import ParseError
    from fissix.pgen2.tokenize import TokenError

    try:
        text = _without_tabs(_decoded(source))
        tree = ast.parse(str(_tool(in_package).refactor_string(text.rstrip() + "\n", str(path))), str(path))
    except (ParseError, TokenError, SyntaxError, IndentationError) as second:
        line = getattr(error, "lineno", None) or getattr(second, "lineno", None) or 1
        what = getattr(error, "msg", None) or str(second)
        raise SceneError(f"{path}, line {line}: neither Python 3 nor Python 2: {what}; correct the line") from second
    imports = (node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module == "__future__")
    if not any(alias.name == "division" for node in imports for alias in node.names):
        tree = _Division().visit(tree)
    return compile(ast.fix_missing_locations(_String().visit(tree)), str(path), "exec")


def _decoded(source: bytes) -> str:
    encoding, _ = tokenize.detect_encoding(io.BytesIO(source).readline)
    return io.TextIOWrapper(io.BytesIO(source), encoding, errors="replace").read()


def _without_tabs(text: str) -> str:
    """Replace tabs in the indentation by spaces, up to the next multiple of 8 as in Python 2."""
    from fissix.pgen2 import tokenize as python2

    inside: set[int] = set()
    try:
        for kind, _token, (first, _), (last, _), _line in python2.generate_tokens(io.StringIO(text).readline):
            if kind == python2.STRING:
                inside |= set(range(first + 1, last + 1))
    except (python2.TokenError, IndentationError):
        pass  # the conversion reports the error
    lines = text.split("\n")
    return "\n".join(line if number in inside else _spaces(line) for number, line in enumerate(lines, 1))


def _spaces(line: str) -> str:
    rest = line.lstrip(" \t\f")
    return line[: len(line) - len(rest)].expandtabs(8) + rest
