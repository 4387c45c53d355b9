"""Errors of a run's figures by its step and its mesh: the same run with half the step, and on a finer mesh.

Richardson's extrapolation (Phil. Trans. R. Soc. A 210, 1911): where the error of v(h) goes with h^p, v(h) - v(h / r) is
1 - r^-p of it. Two runs cannot tell whether it does: a figure that jumps, such as a slip that starts in one run alone,
has an estimate without meaning.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from taichisoft import Scene
from taichisoft.scene import scene_from_toml, scene_to_toml
from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import flat
from taichisoft_studies.run_job import COMPLETED, RunJob, make_job, make_run
from taichisoft_studies.study_file import toml_value

Value = TypeVar("Value", float, np.ndarray)

MESH_ORDER = 2 * 0.5445
"""Order of convergence of a body with inner corners of 90 degrees under even refinement [-], for linear and for
quadratic elements: stresses are singular there, displacements go with the distance to the power 0.5445 (Williams,
Stress singularities in angular corners of plates in extension, J. Appl. Mech. 1952), and energies, and with them the
displacement under the load, with twice that."""
FINER = 0.7
"""Element size of the finer mesh over that of the scene's, where no finer preset is known [-]."""
PRESETS = {"coarse": "medium", "medium": "fine"}
"""The finer preset of a geometry's mesh; shipped meshes of the same names end so, too."""
ENDED = (COMPLETED, "goal missed")
"""Statuses of runs that came to their end."""
FIGURE = re.compile(r"_(mm|mm2|mm3|mN|kPa|degrees)(\.|$)|^largest_stretch\.")
NOT_PHYSICAL = ("rest_volumes", "max_penetration", "worst_newton_residual", "estimated_error")
"""Beginnings of figures with units that say something of the mesh or the solver."""


@dataclass(frozen=True)
class RefinedFigure:
    """A figure of a run, and what refinement makes of it, all in the unit that ends its name.

    Attributes:
        name: as in metrics.json ("final_tip_positions_mm.finger.0").
        value: of the run itself.
        half_step: with half the step.
        step_error: estimated error of `value` by the step, with its sign.
        finer_mesh: on the finer mesh; None without one.
        mesh_error: estimated error of `value` by the mesh, with its sign; None without one.
    """

    name: str
    value: float
    half_step: float
    step_error: float
    finer_mesh: float | None = None
    mesh_error: float | None = None

    @property
    def error(self) -> float:
        """The sizes of both errors, added."""
        return abs(self.step_error) + abs(self.mesh_error or 0.0)


@dataclass(frozen=True)
class Refinement:
    """A run beside finer ones.

    Attributes:
        figures: those that all runs have.
        step: of the run itself [s].
        order: order of its time steps [-].
        statuses: how each run ended, by name ("run", "half the step", "finer mesh").
        finer: changes of the scene that make the finer mesh; empty without one.
        nodes: numbers of nodes of the run's mesh and of the finer one; None without one.
        remark: why there is no finer mesh, or which body keeps its own; empty otherwise.
    """

    figures: list[RefinedFigure]
    step: float
    order: int
    statuses: dict[str, str]
    finer: Sequence[str]
    nodes: tuple[int, int] | None
    remark: str


def refinement_error(value: Value, refined: Value, ratio: float, order: float) -> Value:
    """Error of a value by its step or mesh: value minus limit, by Richardson's extrapolation.

    Args:
        value: with the step or element size h; a number or an array.
        refined: with h / ratio.
        ratio: above 1 [-].
        order: of convergence [-].
    """
    error: Value = (value - refined) / (1.0 - ratio**-order)
    return error


def time_order(scene: Scene) -> int:
    """Order of the time steps: first, but for the midpoint rule, `time.theta` = 0.5."""
    return 2 if scene.time.theta == 0.5 else 1


def refine(
    scene: Scene,
    folder: Path,
    finer: Sequence[str] | None = None,
    duration: float | None = None,
    plugins: Sequence[str] = (),
    made: Callable[[str], None] = lambda line: None,
) -> Refinement:
    """Run a scene as it is, with half the step, and on a finer mesh; runs that lie in the folder are not made again.

    Args:
        scene: with a controller.
        folder: gets the folders of the runs.
        finer: changes that make the mesh finer ("soft_bodies.finger.mesh.size=5"); None: see `finer_meshes`.
        duration: simulated time [s]; None: the scene's.
        plugins: paths of the plug-ins that the scene needs.
        made: called with a line after each run.
    """
    changes, remark = finer_meshes(scene) if finer is None else (list(finer), "")
    scenes = {"run": scene, "half the step": changed(scene, [f"time.step={scene.time.step / 2!r}"])}
    if changes:
        scenes["finer mesh"] = changed(scene, changes)
    nodes = node_counts(scene, scenes["finer mesh"]) if changes else None
    common: dict[str, Any] = {"parameters": {}, "duration": duration, "plugins": tuple(plugins)}
    jobs = {name: make_job(version, folder, source=name, **common) for name, version in scenes.items()}
    records = {name: _ended(name, job, made) for name, job in jobs.items()}
    values = {name: physical_figures(record["metrics"]) for name, record in records.items()}
    order, base = time_order(scene), values["run"]
    figures = []
    for name in [key for key in base if all(key in other for other in values.values())]:
        value, half = base[name], values["half the step"][name]
        of_step = (value, half, refinement_error(value, half, 2.0, order))
        if nodes is None:
            figures.append(RefinedFigure(name, *of_step))
            continue
        fine = values["finer mesh"][name]
        ratio = mesh_ratio(*nodes)
        figures.append(RefinedFigure(name, *of_step, fine, refinement_error(value, fine, ratio, MESH_ORDER)))
    statuses = {name: record["status"] for name, record in records.items()}
    return Refinement(figures, scene.time.step, order, statuses, changes, nodes, remark)


def changed(scene: Scene, changes: Sequence[str]) -> Scene:
    """The scene with other values ("KEY=VALUE")."""
    return scene_from_toml(scene_to_toml(scene), " with ".join(["scene", *changes]), changes)


def finer_meshes(scene: Scene, body: str | None = None) -> tuple[list[str], str]:
    """The changes that make the meshes of soft bodies finer, and why those of others stay.

    A geometry gets its next preset or 0.7 of its size, a file NAME-coarse.msh the file NAME-medium.msh beside it.

    Args:
        scene: the scene.
        body: name of one body; None: all.
    """
    changes, kept = [], []
    for name, settings in scene.soft_bodies.items():
        if body not in (None, name):
            continue
        chosen = settings.model_dump(exclude_none=True, exclude={"mesh"})
        if settings.reduced is not None:
            kept.append(f"{name} is reduced to modes of its mesh")
        elif any(key.rpartition(".")[0].endswith("nodes") for key in flat(chosen)):
            kept.append(f"{name} names nodes of its mesh by their numbers")
        elif change := _finer_mesh(settings.mesh.file, settings.mesh.request):
            changes.append(f"soft_bodies.{name}.mesh{change}")
        else:
            kept.append(f"{name} has a mesh that cannot be made finer here, {Path(settings.mesh.file).name}")
    return changes, "; ".join(kept)


def physical_figures(metrics: Mapping[str, Any]) -> dict[str, float]:
    """The figures of metrics.json that describe what is simulated."""
    return {
        name: float(value)
        for name, value in flat(metrics).items()
        if isinstance(value, int | float) and FIGURE.search(name) and not name.startswith(NOT_PHYSICAL)
    }


def _finer_mesh(file: str, request: Mapping[str, Any]) -> str:
    """The change of the table `mesh` of a body, what follows its name; empty where nothing finer is known."""
    from taichisoft_meshing.geometry_file import is_geometry, make_geometry, read_tables
    from taichisoft_meshing.mesh_job import merge_tables

    path = Path(file)
    if not is_geometry(file):
        name, _, size = path.stem.rpartition("-")
        finer = path.with_name(f"{name}-{PRESETS.get(size)}{path.suffix}")
        return f"={toml_value(str(finer))}" if size in PRESETS and finer.is_file() else ""
    if "nodes" in request:
        return f".nodes={round(request['nodes'] / FINER**3)}"
    kind, tables = read_tables(path)
    tables = merge_tables(tables, request.get("set", {}))
    presets, preset = make_geometry(kind, tables, path).presets, request.get("preset", "")
    if PRESETS.get(preset) in presets:
        return f".preset={toml_value(PRESETS[preset])}"
    known = (request.get("size"), presets.get(preset), tables.get("mesh", {}).get("largest"))
    sizes = [float(size) for size in known if size is not None]
    if not sizes:
        return ""
    if "size" in request and not preset:
        return f".size={FINER * sizes[0]:g}"
    others = {key: value for key, value in request.items() if key != "preset"}
    return f"={toml_value({'file': file, **others, 'size': FINER * sizes[0]})}"


def mesh_ratio(nodes: int, finer: int) -> float:
    """Element size of a mesh over that of a finer one, from their numbers of nodes [-]."""
    return float((finer / nodes) ** (1.0 / 3.0))


def node_counts(scene: Scene, finer: Scene) -> tuple[int, int]:
    """Numbers of nodes of both scenes."""
    from taichisoft.running import make_model

    first, second = make_model(scene).node_count, make_model(finer).node_count
    if second <= first:
        raise StudyError(f"the finer mesh has {second} nodes, not more than the {first} of the scene's")
    return first, second


def _ended(name: str, job: RunJob, made: Callable[[str], None]) -> dict[str, Any]:
    record = make_run(job)
    if record["status"] not in ENDED:
        raise StudyError(f"{name}: {record['status']}: {record['message']}")
    made(f"{name}: {record['status']}")
    return record
