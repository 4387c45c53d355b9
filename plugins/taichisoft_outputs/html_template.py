"""HTML from Jinja templates: every value is escaped, and a page is one file that needs no network."""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def render(template: Path, **values: Any) -> str:
    """The HTML that a template makes of values.

    Args:
        template: file of the template, which may extend page.html, the frame and style of all pages.
        values: values by their names in the template.
    """
    return _environment(template.parent).get_template(template.name).render(values)


@cache
def _environment(folder: Path) -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader([folder, Path(__file__).parent])
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def svg_element(drawing: str) -> Any:
    """The <svg> element of an SVG file, unescaped; the prolog of the file does not belong into a page."""
    from markupsafe import Markup

    return Markup(drawing[drawing.index("<svg") :])
