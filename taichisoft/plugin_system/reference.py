"""The reference part of docs/plugins.md, written from the docstrings of the hooks and of what belongs to them.

python -m taichisoft.plugin_system.reference docs/plugins.md
"""

import dataclasses
import inspect
import re
import sys
from pathlib import Path
from typing import Any

from taichisoft.control.control import Control
from taichisoft.control.controller import Controller, Slider
from taichisoft.control.keys import KeyEvent
from taichisoft.control.observation import Observation
from taichisoft.plugin_system import hookspecs
from taichisoft.plugin_system.geometry import Geometry
from taichisoft.plugin_system.hookspecs import RunOption
from taichisoft.plugin_system.registry import hook_names
from taichisoft.session.output import Output
from taichisoft.session.session import Session
from taichisoft.step.report import StepReport

COMMAND = "python -m taichisoft.plugin_system.reference docs/plugins.md"
MARK = f"<!-- From here on written by `{COMMAND}`; a test compares. -->\n"
INTERFACES = (
    *(Controller, Observation, Control, KeyEvent, Slider),
    *(Output, RunOption, Geometry),
)
RUN = (Session, StepReport)


def plugin_reference() -> str:
    """The reference as Markdown.

    Raises:
        ValueError: an argument or an attribute is not in its docstring, or something else is.
    """
    hooks = [_function(getattr(hookspecs, name), "###") for name in hook_names()]
    parts = ["", "## Reference: hooks", *hooks, "## Reference: what plug-ins make and are given"]
    parts += [*map(_class, INTERFACES), "## Reference: what life-cycle hooks see", *map(_class, RUN)]
    return re.sub(r"\n{3,}", "\n\n", "\n\n".join(parts)).rstrip() + "\n"


def _function(function: Any, heading: str) -> str:
    """Heading with the signature, what the docstring says, and a list of the arguments."""
    signature = inspect.signature(function)
    names = [name for name in signature.parameters if name != "self"]
    text, entries = _parse(inspect.cleandoc(function.__doc__ or ""), "Args")
    if entries:
        _compare(function.__qualname__, names, entries)
    elif names and heading == "###":  # of a hook; a method's first line says it all
        raise ValueError(f"{function.__qualname__}: its docstring has no Args")
    shown = ", ".join(f"{name}: {_type(signature.parameters[name].annotation)}" for name in names)
    answer = "" if signature.return_annotation is None else f" -> {_type(signature.return_annotation)}"
    lines = [f"{heading} `{function.__name__}({shown}){answer}`\n", text]
    lines += [f"- `{name}`: {meaning}" for name, meaning in entries.items()]
    return "\n".join(lines) + "\n"


def _class(made: type) -> str:
    """Heading, what the docstring says, a table of the attributes, and the methods."""
    text, entries = _parse(inspect.getdoc(made) or "", "Attributes")
    lines = [f"### {made.__name__}\n", f"`{made.__module__}.{made.__name__}`. {text}"]
    types: dict[str, str] = {}
    if dataclasses.is_dataclass(made):
        types = {field.name: _type(field.type) for field in dataclasses.fields(made)}
        _compare(made.__name__, list(types), entries)
    if entries:
        lines.append("| attribute | type | |\n|---|---|---|" if types else "| attribute | |\n|---|---|")
    for name, meaning in entries.items():
        cells = [f"`{name}`", *([f"`{types[name]}`"] if types else []), meaning]
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    lines += [""] if entries else []
    lines += [_function(method, "####") for name, method in vars(made).items() if _is_public_method(name, method)]
    return "\n".join(lines)


def _is_public_method(name: str, method: Any) -> bool:
    return inspect.isfunction(method) and (not name.startswith("_") or name == "__call__")


def _parse(docstring: str, section: str) -> tuple[str, dict[str, str]]:
    """The text of a docstring without its sections, and the entries of one section by name."""
    blocks = re.split(r"^(Args|Attributes|Returns|Raises):\n", docstring, flags=re.MULTILINE)
    sections = dict(zip(blocks[1::2], blocks[2::2], strict=True))
    found = re.split(r"^    (\w[\w, ]*): ", sections.get(section, ""), flags=re.MULTILINE)
    entries: dict[str, str] = {}
    for names, meaning in zip(found[1::2], found[2::2], strict=True):
        entries |= dict.fromkeys(names.split(", "), " ".join(meaning.split()))
    rest = [f"{title}: {' '.join(sections[title].split())}\n" for title in ("Returns", "Raises") if title in sections]
    return "\n".join([blocks[0].strip() + "\n", *rest]), entries


def _compare(where: str, names: list[str], entries: dict[str, str]) -> None:
    if names != list(entries):
        raise ValueError(f"{where} has {', '.join(names)}; its docstring has {', '.join(entries) or 'none'}")


def _type(annotation: Any) -> str:
    """A type without the modules."""
    shown = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    return re.sub(r"\b(?:[a-z_]+\.)+(?=\w)", "", shown)


if __name__ == "__main__":
    document = Path(sys.argv[1])
    written, _, _ = document.read_text(encoding="utf-8").partition(MARK)
    document.write_text(written + MARK + plugin_reference(), encoding="utf-8")
