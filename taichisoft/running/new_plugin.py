"""The project of a new plug-in: a controller, a test, and all that installing and publishing it needs."""

import importlib.util
import keyword
import re
import string
import sys
from pathlib import Path

from taichisoft import __version__
from taichisoft.base.files import named_os_errors
from taichisoft.errors import PluginError
from taichisoft.running.hooks import provided
from taichisoft.running.plugins import plugin_registry

TEMPLATES = Path(__file__).parent / "plugin_template"

# The file that each template makes; the names of files are templates, too.
FILES = {
    "pyproject.toml.template": "pyproject.toml",
    "README.md.template": "README.md",
    "plugin.py.template": "$module.py",
    "test_plugin.py.template": "tests/test_$module.py",
}


def write_project(name: str, folder: Path | None = None) -> Path:
    """Write a project for a plug-in called `name`, whose controller has the same name.

    Args:
        name: also of the distribution: letters, digits, "-", "_" and ".".
        folder: new or empty; by default `name` in the current folder.

    Returns:
        The folder.
    """
    module = check_name(name)
    folder = folder or Path(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise PluginError(f"{folder}: exists already; choose another name")
    values = {"name": name, "module": module, "taichisoft_version": __version__}
    for template, path in FILES.items():
        text = (TEMPLATES / template).read_text(encoding="utf-8")
        written = folder / string.Template(path).substitute(values)
        with named_os_errors(written, PluginError):
            written.parent.mkdir(parents=True, exist_ok=True)
            written.write_text(string.Template(text).substitute(values), encoding="utf-8")
    return folder


def check_name(name: str) -> str:
    """The module for a plug-in called `name`."""
    if not re.fullmatch(r"[A-Za-z](?:[A-Za-z0-9._-]*[A-Za-z0-9])?", name):
        raise PluginError(
            f"'{name}' cannot be the name of a plug-in: it must begin with a letter, end with a letter or a digit, and "
            "have only letters, digits, '-', '_' and '.' in it, such as soft-touch"
        )
    registry = plugin_registry()
    if name in registry.origins:
        raise PluginError(f"a plug-in is called '{name}' already: {registry.origins[name]}; choose another name")
    if name in provided("controller"):
        raise PluginError(f"a controller is called '{name}' already; choose another name")
    module = re.sub(r"[-_.]+", "_", name).lower()
    if keyword.iskeyword(module) or module in sys.stdlib_module_names or importlib.util.find_spec(module) is not None:
        raise PluginError(f"'{name}' cannot be the name of a plug-in: Python has a '{module}' already")
    return module
