"""Settings of controllers, plug-ins' too: what is not of the annotated type is refused before the run."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pytest
from conftest import Command
from pydantic import BaseModel, Field

from taichisoft import Controller, hookimpl, load_scene, make_controller
from taichisoft.errors import PluginError, SceneError
from taichisoft.running import plugins
from taichisoft.running.scene_files import checked_arguments

if TYPE_CHECKING:
    from fractions import Fraction


@dataclass
class Grip:
    """A dataclass of settings."""

    force: float = 20.0
    fingers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.fingers) > 3:
            raise ValueError("fingers has more than three names")


class Bounded(BaseModel):
    """A pydantic model of settings."""

    force: Annotated[float, Field(gt=0.0)] = 20.0


def by_arguments(
    force: float = 20.0,
    count: int = 3,
    kind: Literal["soft", "hard"] = "soft",
    way: "tuple[float, float]" = (0.0, 0.0),
    path: Path | None = None,
    grip: Grip | None = None,
    unknown: "Fraction | None" = None,
) -> None:
    """A factory with an argument for each setting."""


def by_defaults(force=20.0, name="x", flag=True) -> None:  # type: ignore[no-untyped-def]
    """One without annotations."""


def by_dataclass(settings: Grip) -> None:
    """One that takes them as a dataclass."""


def by_model(settings: Bounded) -> None:
    """One that takes them as a pydantic model."""


REFUSED: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
    (by_arguments, {"force": "abc"}, "force = 'abc': input should be a valid number"),
    (by_arguments, {"force": "5"}, "force = '5': input should be a valid number"),
    (by_arguments, {"force": True}, "force = True: input should be a valid number"),
    (by_arguments, {"force": [1.0]}, "force = [1.0]: input should be a valid number"),
    (by_arguments, {"count": 2.5}, "count = 2.5: input should be a valid integer"),
    (by_arguments, {"kind": "sof"}, "kind = 'sof': input should be 'soft' or 'hard'"),
    (by_arguments, {"way": [1.0, "b"]}, "way.1 = 'b': input should be a valid number"),
    (by_arguments, {"way": [1.0]}, "way = [1.0]: has 1 values; 2 are needed"),
    (by_arguments, {"path": 3}, "path = 3: input should be a valid string"),
    (by_arguments, {"forse": 3}, "forse: unknown key; did you mean 'force'?"),
    (by_defaults, {"force": "abc"}, "force = 'abc': must be a number"),
    (by_dataclass, {"force": "abc"}, "force = 'abc': input should be a valid number"),
    (by_dataclass, {"forse": 1.0}, "forse: unknown key; did you mean 'force'?"),
    (by_model, {"force": -1.0}, "force = -1.0: input should be greater than 0"),
    (by_model, {"forse": 1.0}, "forse: unknown key; did you mean 'force'?"),
]


@pytest.mark.parametrize(("factory", "settings", "problem"), REFUSED)
def test_a_wrong_setting_is_named(factory: Callable[..., Any], settings: dict[str, Any], problem: str) -> None:
    with pytest.raises(SceneError) as refused:
        checked_arguments(factory, settings)
    assert str(refused.value) == f"controller.settings.{problem}"


def test_rules_of_a_settings_class_are_heeded_and_named() -> None:
    with pytest.raises(SceneError, match=r"^controller\.settings: fingers has more than three names$"):
        checked_arguments(by_dataclass, {"fingers": ["a", "b", "c", "d"]})


def test_values_come_as_the_types_that_were_asked_for() -> None:
    """As files write them: a list for a tuple, text for a path, a whole number for a number, a table for a class."""
    settings = {"force": 5, "way": [1, 2], "path": "a/b", "grip": {"force": 7, "fingers": ["left"]}, "kind": "hard"}
    given = checked_arguments(by_arguments, settings)
    assert given == {"force": 5.0, "way": (1.0, 2.0), "path": Path("a/b"), "grip": Grip(7.0, ("left",)), "kind": "hard"}
    assert isinstance(given["force"], float)
    assert checked_arguments(by_dataclass, {"fingers": ["left"]}) == {"settings": Grip(fingers=("left",))}
    assert checked_arguments(by_dataclass, {}) == {"settings": Grip()}
    assert checked_arguments(by_model, {"force": 5}) == {"settings": Bounded(force=5.0)}
    assert checked_arguments(by_defaults, {"force": 5, "name": 3}) == {"force": 5, "name": 3}
    assert checked_arguments(by_arguments, {"unknown": 3}) == {"unknown": 3}  # a name that a type checker alone knows


class Plain(Controller):
    """A plug-in's controller, which would fail at its first step."""

    def __init__(self, force: float):
        self.force = force


@dataclass
class Odd:
    """Settings of a type that no file can give."""

    own: Plain


def by_odd(settings: Odd) -> None:
    """A factory that takes them."""


class _Plugin:
    @hookimpl
    def taichisoft_controllers(self) -> dict[str, Any]:
        return {"plain": Plain, "odd": by_odd}


@pytest.fixture
def plain() -> Any:
    with plugins.separate_registry():
        plugins.register_plugin(_Plugin(), "plain")
        yield


def test_a_plugins_setting_is_refused_before_the_run(plain: None, tmp_path: Path, command: Command) -> None:
    words = ["run", "gripper", "--controller", "plain", "--output", tmp_path, "--set", "controller.settings.force=abc"]
    code, _, errors = command(*words)
    problem = "taichisoft: gripper: controller.settings.force = 'abc': input should be a valid number"
    assert (code, errors.split()) == (2, problem.split())
    assert not (tmp_path / "metrics.json").exists()


def test_a_settings_class_that_nothing_can_check_is_the_plugins_fault(plain: None) -> None:
    with pytest.raises(PluginError, match=r"^controller 'odd' cannot be made: PydanticSchemaGenerationError: "):
        make_controller(load_scene("gripper", ["controller.settings.own=3"], "odd"))
