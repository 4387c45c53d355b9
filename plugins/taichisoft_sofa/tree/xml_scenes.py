"""Scenes in XML (.scn) as programs: each element is a statement of `createScene` on its own line."""

import ast
from pathlib import Path
from xml.parsers import expat

from taichisoft.errors import SceneError

KEYWORD = b"<"
"""What a file of this kind begins with."""


def is_xml(source: bytes) -> bool:
    """Whether a file is a scene in XML."""
    return source.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(KEYWORD)


def xml_program(path: Path, source: bytes) -> ast.Module:
    """The module whose `createScene(root)` builds the nodes and components of a scene in XML.

    A `Node` is a child, the outermost the root itself; any other element a component of its type, or of its attribute
    `type` where it is an `Object`. Values are the texts of the attributes.

    Raises:
        SceneError: the file is not well-formed, or it includes another one.
    """
    builder = _Builder(path)
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, given: builder.begin(tag, given, parser.CurrentLineNumber)
    parser.EndElementHandler = builder.end
    try:
        parser.Parse(source, True)
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise SceneError(f"{path}, line {error.lineno}: no scene in XML: {what}") from error
    module = ast.parse("def createScene(root):\n    pass")
    assert isinstance(module.body[0], ast.FunctionDef)
    module.body[0].body = builder.statements or module.body[0].body
    return module


class _Builder:
    """Makes the statements, element by element."""

    def __init__(self, path: Path) -> None:
        self.statements: list[ast.stmt] = []
        self._path = path
        self._open: list[str] = []
        self._count = 0

    def begin(self, tag: str, given: dict[str, str], line: int) -> None:
        """An element begins: a node inside of which others are, or a component."""
        where, inside = f"{self._path}, line {line}", self._open[-1] if self._open else ""
        if tag == "include":
            raise SceneError(f"{where}: includes '{given.get('href', '')}'; write its nodes into this file instead")
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
