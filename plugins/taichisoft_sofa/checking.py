"""Check of a scene without a run: understood components, and construction of the model."""

import contextlib
import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.errors import TaichisoftError
from taichisoft_sofa.scene_reader import kept_files, split_path, with_files_in
from taichisoft_sofa.translation.parts import NOTHING, Translation
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.loading import load_tree

if TYPE_CHECKING:
    from taichisoft import Simulation
    from taichisoft_sofa.controller.sofa_controller import SofaController


@dataclass
class Checked:
    """Results of a check, as lines of text.

    Attributes:
        problems: reasons why the scene cannot be run; empty if it can.
        remarks: files in Python 2, departures from SOFA, warnings of the model.
        said: lines printed by the scene.
        counts: number of components of each type, by "understood" and "without effect".
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    counts: dict[str, Mapping[str, int]] = field(default_factory=dict)


def checked(scene: Path, python_path: str, exact: bool, data_path: str = "", steps: int = 0) -> Checked:
    """Load and translate a scene, and build its model and controllers as a run does; make some steps of it."""
    found = Checked()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", UserWarning)
        try:
            with _kept(found.said):
                tree = load_tree(scene, split_path(python_path), split_path(data_path, "--data-path"))
                translation = translate(tree, exact)
            found.remarks += tree.converted
            found.counts = {"understood": translation.understood, "without effect": translation.ignored}
            found.remarks += [f"otherwise than in SOFA: {line}" for line in translation.departures]
            found.problems += translation.refused
            if translation.is_empty and not translation.refused:
                found.problems.append(f"{scene}: {NOTHING}")
            elif not translation.refused:
                _build(scene, translation, python_path, data_path, exact, steps, found)
        except TaichisoftError as error:
            found.problems.append(str(error))
    found.remarks += dict.fromkeys(f"warning: {one.message}" for one in warned if issubclass(one.category, UserWarning))
    return found


def _build(
    scene: Path,
    translation: Translation,
    python_path: str,
    data_path: str,
    exact: bool,
    steps: int,
    found: Checked,
) -> None:
    from taichisoft import Simulation, make_model, scene_from_dict
    from taichisoft_sofa.controller.sofa_controller import SofaController

    tables = with_files_in(kept_files(translation, scene.stem), translation.tables)
    model = make_model(scene_from_dict(tables, str(scene)))
    folders, data_folders = ([str(folder) for folder in split_path(path)] for path in (python_path, data_path))
    with _kept(found.said):
        controller = SofaController(str(scene), folders, exact, data_folders)
        controller.reset(model)
        if steps:
            _run(Simulation(model), controller, steps)


def _run(simulation: "Simulation", controller: "SofaController", steps: int) -> None:
    """Make steps, those before an error of which the error names."""
    for made in range(steps):
        try:
            simulation.step(controller.control(simulation.observe()))
        except TaichisoftError as error:
            raise TaichisoftError(f"after {made} of {steps} steps: {error}") from error


@contextlib.contextmanager
def _kept(said: list[str]) -> Iterator[None]:
    """Collect the distinct lines that a scene prints, since they may be unsafe for a terminal."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            yield
    finally:
        said += [line for line in dict.fromkeys(printed.getvalue().splitlines()) if line not in said]
