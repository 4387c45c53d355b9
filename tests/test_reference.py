"""docs/reference is what its generator makes of the docstrings, and the docstrings name everything."""

import inspect
import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

import taichisoft
from taichisoft import Control, Controller, Observation, Session
from taichisoft.running import hook_names, hookspecs

ROOT = Path(__file__).resolve().parents[1]
GENERATOR = runpy.run_path(str(ROOT / "docs" / "write_reference.py"))


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return GENERATOR["pages"]()


@pytest.mark.parametrize("page", ["python.md", "environments.md", "hooks.md", "scenes.md", "figures.md"])
def test_page_is_what_code_says(pages: dict[str, str], page: str) -> None:
    written = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
    assert written == pages[page], "run: python docs/write_reference.py"


def test_public_names_alone_have_sections() -> None:
    described = [name for names in GENERATOR["SECTIONS"].values() for name in names]
    assert sorted([*described, "__version__", "errors"]) == dir(taichisoft)


def test_hooks_have_sections() -> None:
    sections = (ROOT / "docs" / "reference" / "hooks.md").read_text(encoding="utf-8").split("\n## ")[1:]
    assert [section.partition("(")[0] for section in sections] == [f"`{name}" for name in hook_names()]
    for name, section in zip(hook_names(), sections, strict=True):
        for argument in inspect.signature(getattr(hookspecs, name)).parameters:
            assert f"\n- `{argument}`: " in section, (name, argument)


def test_missing_docstring_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Observation, "__doc__", (Observation.__doc__ or "").replace(" flows: ", " flow: "))
    with pytest.raises(ValueError, match=r"^Observation has time, .*flows.*; its docstring has time, .*flow, "):
        GENERATOR["pages"]()
    monkeypatch.undo()
    hook = hookspecs.taichisoft_step_done
    monkeypatch.setattr(hook, "__doc__", (hook.__doc__ or "").partition("Args:")[0])
    with pytest.raises(ValueError, match=r"^taichisoft_step_done has session, report; its docstring has none$"):
        GENERATOR["pages"]()


def test_every_attribute_of_a_session_is_in_its_docstring() -> None:
    """It is no dataclass, so the generator does not compare them."""

    class Still(Controller):
        def control(self, observation: Observation) -> Control:
            return Control()

    model: Any = SimpleNamespace(scene=SimpleNamespace(time=SimpleNamespace(step=0.01)))
    session = Session(cast(Any, SimpleNamespace(model=model, state=None)), Still(), duration=1.0)
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    section = page.partition("\n### Session\n")[2].partition("\n## ")[0]
    for name in vars(session):
        assert name.startswith("_") or f"\n- `{name}`" in section, name
