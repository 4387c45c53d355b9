"""The site: `make site` builds it into out/site with Sphinx, without the network.

The root of the checkout is Sphinx's source folder, so that links between pages are the same in the site and in the
checkout. Navigation, and which kind of page each is, come from the lists of docs/index.md. Sphinx, because it is
maintained and reads pages where they are; Material for MkDocs has announced its end for May 2027.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from taichisoft import __version__

ROOT = Path(__file__).parents[2]
KINDS = {
    "Tutorials": "Tutorial: to be followed step by step",
    "How-to": "How-to: a task, and what it takes",
    "Reference": "Reference: everything, in order",
    "Explanation": "Explanation: why it is so",
    "Laboratory": "Laboratory: what was tried and measured",
}

project = "taichisoft"
version = release = __version__
copyright = "the taichisoft developers"
extensions = ["myst_parser", "sphinx_copybutton"]
root_doc = "docs/index"
include_patterns = ["docs/*.md", "docs/*/*.md", "examples/README.md", "CHANGELOG.md", "CONTRIBUTING.md"]
exclude_patterns = ["docs/site/**"]

myst_heading_anchors = 4  # as GitHub makes them
myst_enable_extensions = ["attrs_block", "attrs_inline", "html_image"]
suppress_warnings = [
    "misc.highlighting_failure",
    "myst.header",
]  # pages may begin their second level where it suits them
pygments_style = "friendly"

html_theme = "furo"
html_title = f"taichisoft {version}"
html_static_path = ["static"]
html_extra_path = ["start_page"]  # leads from the root of the site to docs/index.html
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False


def lists_of_pages() -> dict[str, list[tuple[str, str]]]:
    """Title and path of the pages in each list of docs/index.md, by the list's heading."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    return {
        heading: [
            (title, posixpath.normpath(f"docs/{path}"))
            for title, path in re.findall(r"^- \[(.*?)\]\((.*?)\)", text, re.M)
        ]
        for heading, text in re.findall(r"^## (.+)\n((?:(?!## ).*\n?)*)", index, re.M)
    }


def add_navigation(_: Any, page: str, source: list[str]) -> None:
    """Make the lists of docs/index.md the site's navigation, and write the kind of every other page under its title."""
    lists = lists_of_pages()
    if page == root_doc:
        for heading, pages in lists.items():
            entries = "\n".join(f"{title} </{path}>" for title, path in pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{entries}\n```\n"
    for heading, pages in lists.items():
        if heading in KINDS and f"{page}.md" in [path for _, path in pages]:
            source[0] = re.sub(r"\A(# .*\n)", rf"\1\n{{.kind}}\n{KINDS[heading]}\n", source[0])


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", add_navigation)
