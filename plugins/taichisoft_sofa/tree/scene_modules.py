"""Import of a scene's own modules and of SOFA's libraries, without lasting effects on this Python."""

import ast
import builtins
import functools
import importlib
import importlib.util
import io
import string
import sys
import tokenize
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import CodeType, ModuleType, SimpleNamespace
from typing import Any
from xml.parsers import expat

from taichisoft.base import extra, require
from taichisoft.errors import SceneError
from taichisoft_sofa.tree.place import ORIGIN, ModuleOrigin

# Names of Python 2, built in or in the module `string`, that Python 3 does not have.

GONE = {
    *("xrange", "unicode", "basestring", "raw_input", "unichr", "long", "execfile", "reduce", "reload", "cmp", "file"),
}
"""Built-in names that Python 3 does not have."""

DIVIDE = "__python2_divide__"
STRING = "__python2_string__"


def divide(dividend: Any, divisor: Any) -> Any:
    """Divide as in Python 2: the quotient of integers is an integer."""
    if isinstance(dividend, int) and isinstance(divisor, int):
        return dividend // divisor
    return dividend / divisor


def _join(words: Any, separator: str = " ") -> str:
    return separator.join(words)


OF_STRING: dict[str, Any] = {
    **{name: getattr(str, name) for name in dir(str) if not name.startswith("_")},
    "join": _join,
    "joinfields": _join,
    "splitfields": str.split,
    "atof": float,
    "atoi": int,
    "atol": int,
    "maketrans": str.maketrans,
    "letters": string.ascii_letters,
    "lowercase": string.ascii_lowercase,
    "uppercase": string.ascii_uppercase,
}
"""Functions of the module `string` that Python 3 does not have."""

NAMES: dict[str, Any] = {
    DIVIDE: divide,
    STRING: SimpleNamespace(**OF_STRING),
    "reduce": functools.reduce,
    "reload": importlib.reload,
    "intern": sys.intern,
    "cmp": lambda first, second: (first > second) - (first < second),
    "file": open,
}
"""Additional global variables of a module in Python 2."""


# Detection of files in Python 2 that Python 3 can parse.

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


RUNNING: list[Any] = []
"""The environments of running scenes, innermost last, since a scene may load another."""


def running() -> Any:
    """The environment of the running scene, a `SceneModules`."""
    if not RUNNING:
        raise RuntimeError("no scene is running")
    return RUNNING[-1]


# Scenes in XML (.scn) as programs: each element is a statement of `createScene` on its own line.

KEYWORD = b"<"
"""What a file of this kind begins with."""


def is_xml(source: bytes) -> bool:
    """Whether a file is a scene in XML."""
    return source.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(KEYWORD)


def xml_program(path: Path, source: bytes) -> ast.Module:
    """The module whose `createScene(root)` builds the nodes and components of a scene in XML.

    A `Node` is a child, the outermost the root itself; any other element a component of its type, or of its attribute
    `type` where it is an `Object`. Values are the texts of the attributes.
    """
    builder = _Builder()
    builder.read(path, source)
    module = ast.parse("def createScene(root):\n    pass")
    assert isinstance(module.body[0], ast.FunctionDef)
    module.body[0].body = builder.statements or module.body[0].body
    return module


class _Builder:
    """Makes the statements, element by element."""

    def __init__(self) -> None:
        self.statements: list[ast.stmt] = []
        self._files: list[Path] = []
        self._replaced: list[dict[str, str]] = []
        self._open: list[str] = []
        self._count = 0

    def read(self, path: Path, source: bytes, replaced: dict[str, str] | None = None) -> None:
        """Read a file, and those that it includes, with other values of attributes of its outermost node."""
        if path in self._files:
            raise SceneError(f"{self._files[-1]}: includes '{path}', which includes it")
        parser = expat.ParserCreate()
        parser.StartElementHandler = lambda tag, given: self.begin(tag, given, parser.CurrentLineNumber)
        parser.EndElementHandler = self.end
        self._files.append(path)
        self._replaced.append(replaced or {})
        try:
            parser.Parse(source, True)
        except expat.ExpatError as error:
            what = expat.ErrorString(error.code)
            raise SceneError(f"{path}, line {error.lineno}: no scene in XML: {what}") from error
        self._files.pop()

    def _include(self, given: dict[str, str], where: str) -> None:
        """Read the file that an `include` names; its other attributes replace those of the file's outermost node."""
        name = given.pop("href", "")
        beside = self._files[-1].parent / name
        path = beside if beside.is_file() else running().find_file(name)
        if path is None:
            raise SceneError(f"{where}: includes '{name}': no such file beside it or in the folders of the scene")
        if of_component := [key for key in given if "__" in key]:
            raise SceneError(f"{where}: {of_component[0]}: sets a datum inside an included file; set it in that file")
        self.read(path, path.read_bytes(), given)

    def begin(self, tag: str, given: dict[str, str], line: int) -> None:
        """An element begins: a node inside of which others are, or a component."""
        where, inside = f"{self._files[-1]}, line {line}", self._open[-1] if self._open else ""
        given = given | (self._replaced.pop() if self._replaced and tag != "include" else {})
        if tag == "include":
            self._open.append("component")
            self._open.append(inside)
            self._include(given, where)
            self._open.pop()
            return
        if not inside and tag != "Node":
            raise SceneError(f"{where}: begins with <{tag}>; a scene in XML begins with <Node>")
        if inside == "component":
            raise SceneError(f"{where}: <{tag}> is inside a component; it belongs beside it, in its <Node>")
        if tag == "Node":
            self._open.append("root" if not inside else f"node{self._count}")
            self._count += 1
            data = {key: value for key, value in given.items() if key != "name" and not key.startswith("show")}
            if not inside:
                lines = [f"root.findData({key!r}) and setattr(root, {key!r}, {value!r})" for key, value in data.items()]
                lines += [f"root.findData({key!r}) or root.set_all({ {key: value}!r})" for key, value in data.items()]
            else:
                lines = [f"{self._open[-1]} = {inside}.addChild({given.get('name', 'unnamed')!r}, **{data!r})"]
        else:
            self._open.append("component")
            data = {key: value for key, value in given.items() if tag != "Object" or key != "type"}
            kind = given.get("type", "") if tag == "Object" else tag
            lines = [f"{inside}.addObject({kind!r}, **{data!r})"]
        for text in lines:
            (statement,) = ast.parse(text).body
            for part in ast.walk(statement):
                if isinstance(part, ast.stmt | ast.expr | ast.keyword):
                    part.lineno = part.end_lineno = line
            self.statements.append(statement)

    def end(self, _tag: str) -> None:
        """An element ends."""
        self._open.pop()


# Conversion of scenes in Python 2 at loading, line by line, so that errors have the original line numbers.

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


# Libraries of scenes, always executed with our modules in place of SOFA's.
LIBRARIES = ("stlib3", "splib3", "softrobots", "stlib", "splib")


class OurLoader(Loader):
    """Base class of loaders, which marks modules loaded for a scene."""

    def create_module(self, _spec: ModuleSpec) -> ModuleType | None:
        """None: Python makes the module."""
        return None


class SceneLoader(OurLoader):
    """Executes a file, which may be in Python 2, and records the origin of the module.

    Args:
        file: the file.
        of_scene: whether the file is the scene's own, not a library's.
        converted: receives the file and the reason if the file is in Python 2.
        in_package: whether the file is a package or in one.
    """

    def __init__(self, file: Path, of_scene: bool, converted: dict[Path, str], in_package: bool = False) -> None:
        self.file = file
        self.of_scene = of_scene
        self._converted = converted
        self._in_package = in_package

    def exec_module(self, module: ModuleType) -> None:
        """Execute the file."""
        program = compiled(self.file, self._in_package)
        vars(module)[ORIGIN] = ModuleOrigin(self.of_scene, program.older)
        if program.python2:
            self._converted[self.file] = program.python2
            vars(module).update(NAMES)
        exec(program.code, vars(module))

    def get_source(self, _name: str) -> str:
        """Text of the file, for tracebacks."""
        return self.file.read_text(encoding="utf-8", errors="replace")


class SceneFinder(MetaPathFinder):
    """Finds the modules in the scene's folder and in its libraries.

    Attributes:
        folders: folders to search, besides sys.path for libraries.
        converted: files in Python 2, with the reason.
    """

    def __init__(self, folder: Path, python_path: Sequence[Path]) -> None:
        self.folder = folder
        self.folders = [folder, *python_path]
        self.converted: dict[Path, str] = {}
        self._python_path = python_path

    def find_spec(self, name: str, path: Sequence[str] | None, _target: Any = None) -> ModuleSpec | None:
        """Specification of a module; None for other modules."""
        above, _, last = name.rpartition(".")
        if above:
            # Check the top package: the direct parent may be a folder without an __init__.py.
            if not is_ours(sys.modules.get(name.partition(".")[0])):
                return None
            folders = [Path(entry) for entry in path or ()]
        else:
            folders = self.folders + ([Path(entry) for entry in sys.path] if name in LIBRARIES else [])
        for folder in folders:
            for file, inside in ((folder / last / "__init__.py", [str(folder / last)]), (folder / f"{last}.py", None)):
                if file.is_file():
                    in_package = bool(above or inside)
                    loader = SceneLoader(file, self._is_of_scene(name, file), self.converted, in_package)
                    return importlib.util.spec_from_file_location(
                        name, file, loader=loader, submodule_search_locations=inside
                    )
        return None

    def _is_of_scene(self, name: str, file: Path) -> bool:
        """Whether a module is the scene's own and not part of a library, even of one in the scene's folder."""
        of_library = name.partition(".")[0] in LIBRARIES or any(
            file.is_relative_to(folder) and folder.is_relative_to(self.folder) for folder in self._python_path
        )
        return file.is_relative_to(self.folder) and not of_library


def is_ours(module: ModuleType | None) -> bool:
    """Whether a module was loaded for a scene."""
    return isinstance(getattr(getattr(module, "__spec__", None), "loader", None), OurLoader)
