"""The documents as a site: links and anchors lead somewhere, all pages are in the navigation, and can be read."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import chromium
from documents import ROOT

pytest.importorskip("sphinx", reason="needs the extra 'site'")
PAGES = ("index.html", "docs/start.html", "docs/gallery.html", "docs/reference/scenes.html", "docs/validation.html")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built without a warning; Sphinx warns of links, anchors and pages that lead nowhere."""
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "--keep-going"]
    done = subprocess.run(
        [*build, "-c", "docs/site", "-d", str(folder / "trees"), ".", str(folder / "html")],
        cwd=ROOT,
        env=os.environ | {"NO_COLOR": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.mark.parametrize("width", [390, 1280])
def test_pages_fit_telephone_and_desk_without_network(site: Path, browser: Any, width: int) -> None:
    tab = browser.new_page(viewport={"width": width, "height": 800})
    asked: list[str] = []
    failed: list[str] = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("requestfailed", lambda request: failed.append(request.url))
    tab.on("pageerror", lambda error: failed.append(str(error)))
    for page in PAGES:
        tab.goto((site / page).as_uri())
        tab.wait_for_selector("h1")
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, page
        assert tab.evaluate("[...document.images].filter(one => one.complete && !one.naturalWidth).length") == 0, page
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert failed == []


def test_page_says_which_kind_it_is_and_leads_to_all_others(site: Path) -> None:
    """Sphinx warns of a page in no list, so that a list leads to each of them."""
    page = (site / "docs" / "controllers.html").read_text(encoding="utf-8")
    assert "How-to: a task" in page
    assert page.count('class="caption-text">') == 6 or page.count('class="caption"') == 6
