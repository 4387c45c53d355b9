"""The system's Chromium, driven by playwright; modules of tests that import this are skipped where there is none."""

import ctypes
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
PATH = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if PATH is None:
    pytest.skip("needs Chromium: sudo apt-get install chromium", allow_module_level=True)
if sys.platform == "linux":
    try:
        ctypes.CDLL("libatomic.so.1")
    except OSError:
        pytest.skip("playwright's node.js needs libatomic: sudo apt-get install libatomic1", allow_module_level=True)

WITHOUT_GRAPHICS_CARD = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser that draws without a graphics card."""
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=PATH, args=list(WITHOUT_GRAPHICS_CARD))
        yield browser
        browser.close()
