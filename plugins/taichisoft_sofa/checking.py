"""What becomes of a scene, without a run: what is understood of it, and whether its model can be built."""

import contextlib
import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_sofa.reader import kept_files, split_path, with_files_in
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.loading import load_tree


@dataclass
class Checked:
    """What was found of a scene, in lines.

    Attributes:
        problems: why it cannot be run; none where it can.
        remarks: what is to be known of it: files in Python 2, departures from SOFA, warnings of the model.
        said: what the scene itself printed.
        counts: number of components of each type, by what becomes of them.
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    counts: dict[str, Mapping[str, int]] = field(default_factory=dict)


def checked(scene: Path, python_path: str, exact: bool) -> Checked:
    """Load a scene, translate it, and build its model and controllers as a run does before its first step."""
    found = Checked()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", UserWarning)
        try:
            with _kept(found.said):
                tree = load_tree(scene, split_path(python_path))
                translation = translate(tree, exact)
            found.remarks += tree.converted
            found.counts = {"understood": translation.understood, "without effect": translation.ignored}
            found.remarks += [f"otherwise than in SOFA: {line}" for line in translation.departures]
            found.problems += translation.refused
            if not translation.refused:
                _build(scene, translation, python_path, exact, found)
        except TaichisoftError as error:
            found.problems.append(str(error))
    found.remarks += dict.fromkeys(f"warning: {one.message}" for one in warned if issubclass(one.category, UserWarning))
    return found


def _build(scene: Path, translation: Translation, python_path: str, exact: bool, found: Checked) -> None:
    from taichisoft.building.scene_files import scene_from_dict
    from taichisoft.building.simulation import make_model
    from taichisoft_sofa.controller.controller import SofaController

    tables = with_files_in(kept_files(translation, scene.stem), translation.tables)
    model = make_model(scene_from_dict(tables, str(scene)))
    folders = [str(folder) for folder in split_path(python_path)]
    with _kept(found.said):
        SofaController(str(scene), folders, exact).reset(model)


@contextlib.contextmanager
def _kept(said: list[str]) -> Iterator[None]:
    """Keep what a scene prints, once each: it need not be what a terminal should show as it is."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            yield
    finally:
        said += [line for line in dict.fromkeys(printed.getvalue().splitlines()) if line not in said]
