"""Every command and every Python program that a document shows works, as it stands there.

A page's commands are run in its order, in one folder and in this process, and then its programs. What would take long
is smaller: shipped scenes are two pads and a cube that have their names, and end after some steps; pictures are blank,
plots empty, meshes of fingers are a pad's, runs of studies are made here, bodies are reduced by few runs, and pages
are not served. Tests of their own show that these things work. What is shown here is that whoever types a line gets
what it names, by the options that it gives.
"""

import re
import runpy
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import documents
import numpy as np
import pytest
import tomli_w
import trimesh
from blocks import make_block
from documents import ROOT, Command
from PIL import Image

from taichisoft import read_volume_mesh, write_volume_mesh
from taichisoft.command_line import EXIT_FAILED, main
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import plugins
from taichisoft_meshing.gmsh_session import gmsh_session

RUN_ELSEWHERE = {
    "README.md": "tests/test_docs.py",
    "docs/cables.md": "tests/test_plugin_docs.py",
    "docs/environments.md": "tests/controllers/test_environment_docs.py",
    "docs/plugins.md": "tests/test_plugin_docs.py",
    "docs/ros2.md": "tests/test_examples.py",
    "docs/studies.md": "tests/studies/test_workers.py",
    "docs/force-control.md": "tests/test_plugin_docs.py",
}
"""Pages whose programs a test of their own runs; those of docs/plugins.md and docs/force-control.md also run commands,
with the plug-ins of these pages. The commands of docs/gallery.md are run by the program that writes the page."""

PAGES = [
    page
    for page in documents.PAGES
    if page.name not in ("plugins.md", "force-control.md", "gallery.md")
    and (
        any(one.words[0] == "taichisoft" for one in documents.commands(page))
        or (documents.name_of(page) not in RUN_ELSEWHERE and "```python" in page.read_text(encoding="utf-8"))
    )
]

LEFT_OUT = {
    "taichisoft study optimise finger-tip-force": "minutes; tests/studies/test_optimise.py optimises something small",
    "taichisoft study calibrate beam.toml": "needs a measured beam; tests/studies/test_calibrate.py makes one up",
    "taichisoft study sweep study.toml -o /shared/study": "needs a cluster; tests/studies/test_workers.py starts one",
    "taichisoft run four.toml": "needs a real finger's mesh; tests/meshing/test_new_gripper.py runs such a scene",
    "taichisoft recording plot out/gripper/recording.h5 --format xlsx": "needs an extra; tests/outputs/test_plots.py",
    "taichisoft reduce gripper -o out/reduced --tolerance": "seconds; tests/reduction has models of a tolerance",
    "taichisoft doctor": "looks at the machine, which may lack something; tests/outputs/test_doctor.py",
}
"""Beginnings of commands, of a page or of all, that are only checked for their options, and why."""

SMALL_FINGER = " ".join(
    f"--set {one}"
    for one in ("body.length=55", "slots.count=1", "chambers.count=2", "channel.end=34", "stiff_layer.end=40")
)
"""A finger of two chambers, whose mould takes a third of the time."""
SHORTER = (
    (r"--pressure 40 --steps 5", "--pressure 2 --steps 2"),  # a pad bears no more
    (
        r"--set controller.settings.links=colliding",
        "",
    ),  # pads have no arm
    (r"--duration [\d.]+", "--duration 0.03"),
    (r"--steps \d+", "--steps 3"),
    (r"--line \S+", "--line -30,0,10:30,0,10"),
    (r"taichisoft mould tutorial", f"taichisoft mould tutorial {SMALL_FINGER}"),
    (r"taichisoft mould tendon", "taichisoft mould body.step"),  # whose many faces take seconds
    (r"--(at|time) [\d.]+", r"--\1 0.02"),
    (r"runs/1aaaa8ec010c7dbe out/study/runs/3c6447d2fcc3c084", "runs/FIRST out/study/runs/SECOND"),
)
"""What stands for a time of a whole run, and for names that depend on the version."""
SHORTER_IN_PROGRAMS = ((r"instant_at\([\d.]+\)", "instant_at(0.02)"), (r'("closed"|"end"): [\d.]+', r"\1: 0.02"))
BEFORE_PROGRAMS = {"docs/controllers.md": ("taichisoft run gripper --controller closed-loop --outputs csv",)}
"""Commands that a page describes in words."""

SOFA_SCENE = """
def createScene(root):
    root.addObject("FreeMotionAnimationLoop")
    root.addObject("GenericConstraintSolver", tolerance=1e-7, maxIterations=1000)
    node = root.addChild("body")
    node.addObject("EulerImplicitSolver", rayleighStiffness=0.1, rayleighMass=0.2)
    node.addObject("SparseLDLSolver")
    node.addObject("MeshVTKLoader", name="loader", filename="block.vtk")
    node.addObject("MeshTopology", src="@loader", name="container")
    node.addObject("MechanicalObject", name="dofs", template="Vec3")
    node.addObject("UniformMass", totalMass=0.05)
    node.addObject("TetrahedronFEMForceField", youngModulus=500, poissonRatio=0.3, method="large")
    node.addObject("FixedConstraint", indices=[0, 1, 2])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, with the files of users that documents name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    make_small(tmp_path / "data", monkeypatch)
    write_files_of_a_user(tmp_path)
    with plugins.separate_registry():
        yield tmp_path


@pytest.mark.parametrize("page", PAGES, ids=documents.name_of)
def test_commands_of_a_page_do_what_it_says(
    page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    wanted = [one for one in documents.commands(page) if is_run(one) and not left_out(one)]
    problems = [problem for one in dict.fromkeys(wanted) if (problem := run(one, folder, monkeypatch, capfd))]
    assert problems == []

    for line in BEFORE_PROGRAMS.get(documents.name_of(page), ()):
        assert run(Command(documents.name_of(page), line), folder, monkeypatch, capfd) == ""
    names: dict[str, Any] = {"__name__": "shown"}
    if documents.name_of(page) not in RUN_ELSEWHERE:
        for language, program in documents.blocks(page):
            if language == "python":
                exec(compile(shorter(program, SHORTER_IN_PROGRAMS), documents.name_of(page), "exec"), names)
    if "bending" in names:  # docs/tuning.md calls it in processes
        assert names["bending"](5.0) != names["bending"](10.0)


def test_programs_of_pages_are_run() -> None:
    with_programs = {
        documents.name_of(page): page
        for page in documents.PAGES
        if any(language == "python" for language, _ in documents.blocks(page))
    }
    for name, page in with_programs.items():
        if name in RUN_ELSEWHERE:
            test = (ROOT / RUN_ELSEWHERE[name]).read_text(encoding="utf-8")
            assert page.name in test and re.search(r"exec\(|run_path|write_text\(program", test), name
        else:
            assert page in PAGES, name
    assert set(RUN_ELSEWHERE) <= set(with_programs)


def run(command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """What is wrong when a command is run, as short as it can be; empty when it succeeds."""
    line = shorter(command.line, SHORTER)
    if re.match(r"taichisoft run (?!.*--(duration|steps))", line):
        line += " --duration 0.03"
    for number, made in enumerate(sorted((folder / "out" / "study" / "runs").glob("*"))[:2]):
        line = line.replace(("FIRST", "SECOND")[number], made.name)
    monkeypatch.setattr(sys, "argv", Command(command.page, line).words)
    if command.words[0] == "python":
        monkeypatch.setattr(sys, "argv", [*sys.argv[1:], "--file", "drawn.svg"])
        with pytest.raises(SystemExit) as left:
            runpy.run_path(str(ROOT / command.words[1]), run_name="__main__")
        assert left.value.code == 0
        return ""
    with plugins.separate_registry(), pytest.raises(SystemExit) as left:
        main()
    _, errors = capfd.readouterr()
    missed = left.value.code == EXIT_FAILED and "is not lifted" in errors  # `--goal lifted`, in some steps
    return "" if left.value.code in (0, None) or missed else f"{command} (as {line}): {errors}"


def is_run(command: Command) -> bool:
    """Whether it is our own command, or a program of ours that draws from a run."""
    return command.line.startswith(("taichisoft ", "python docs/pictures.py closed-loop "))


def shorter(text: str, replacements: Sequence[tuple[str, str]]) -> str:
    for long, short in replacements:
        text = re.sub(long, short, text)
    return text


def left_out(command: Command) -> bool:
    return any(shown.startswith(beginning) for shown in (command.line, str(command)) for beginning in LEFT_OUT)


def test_omitted_commands_are_shown_somewhere() -> None:
    commands = [command for page in documents.PAGES for command in documents.commands(page)]
    shown = [text for command in commands for text in (command.line, str(command))]
    assert [one for one in LEFT_OUT if not any(line.startswith(one) for line in shown)] == []


def make_small(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shipped scenes of some elements in `data`, and stand-ins for what takes long."""
    from matplotlib.figure import Figure

    from taichisoft.scene import shipped
    from taichisoft_meshing import body_pictures, mesh_job
    from taichisoft_outputs.rendering import video
    from taichisoft_outputs.web import recording_page, web_output
    from taichisoft_reduction import shape_reduction, training_plan, training_run
    from taichisoft_studies import workers

    shutil.copytree(ROOT / "data", data)
    gripper = tiny_gripper()
    for scene in (data / "scenes").glob("*.toml"):
        scene.write_text(gripper if "gripper" in scene.stem else tiny_finger(gripper), encoding="utf-8")
    monkeypatch.setattr(shipped, "data_folder", lambda: data)
    monkeypatch.setattr(Figure, "savefig", save_nothing)
    monkeypatch.setattr(video, "draw_frames", draw_nothing)
    monkeypatch.setattr(body_pictures, "draw_parts", lambda parts: [])
    monkeypatch.setattr(mesh_job, "_known_elsewhere", lambda job: False)
    monkeypatch.setattr(mesh_job, "requested_mesh", mesh_of_a_pad)
    monkeypatch.setattr(mesh_job.MadeMesh, "problems", property(lambda made: []))
    for name, small in (("PRESSES", 1), ("UNSEEN_PRESSES", 1), ("RISE", 0.2), ("PAUSE", 0.1), ("FREQUENCY", 6.0)):
        monkeypatch.setattr(training_plan, name, small)
    monkeypatch.setattr(training_run, "Pool", RunsHere)
    monkeypatch.setattr(shape_reduction, "ATTEMPTS", 1)
    monkeypatch.setattr(workers, "study_workers", workers_here)
    monkeypatch.setattr(web_output.WebOutput, "follow", lambda self, session: None)
    monkeypatch.setattr(recording_page.RecordingPage, "serve", lambda self: None)


def tiny_gripper() -> str:
    """The scene of the plug-ins' fixture with the names of the shipped gripper, and a goal that it has reached."""
    text = TINY_GRIPPER.read_text(encoding="utf-8").replace('"pad.msh"', f'"{TINY_GRIPPER.with_name("pad.msh")}"')
    text = text.replace("duration = 0.5", "duration = 0.06").replace('script = "rest"', 'script = "grasp"')
    text = re.sub(r"\bleft\b", "finger1", text)
    goal = 'goal = { object = "cube", kind = "placed", position = [0.0, 0.0, 5.2], hold = 0.02 }\n'
    return goal + re.sub(r"\bright\b", "finger2", text)


def tiny_finger(gripper: str) -> str:
    """One of the pads alone, with the name of the shipped finger."""
    document = tomllib.loads(gripper)
    pad = document["soft_bodies"]["finger1"]
    return (
        'time = { duration = 0.06 }\ncontroller = { name = "scripted", settings = { script = "inflate" } }\n'
        f'[soft_bodies.finger]\nmesh = "{pad["mesh"]}"\ndensity = 1e-6\nyoung_modulus = 100.0\npoisson_ratio = 0.3\n'
        'rayleigh_mass = 0.1\nrayleigh_stiffness = 0.02\nanchors = [{ group = "base" }]\n'
        'cavities = { cavity = { group = "cavity" } }\n'
    )


def draw_nothing(recording: Path, style: Any, frames: Sequence[int], take: Callable[..., None], stop: Any) -> None:
    from taichisoft_outputs import read_recording

    with read_recording(recording) as opened:
        style.check(opened.scene)
    for _ in frames:
        take(np.full((style.size[1], style.size[0], 3), 200, dtype=np.uint8))


def save_nothing(figure: Any, target: Any, format: str = "png", **_: Any) -> None:
    """A file of the right kind with nothing in it: most of the time of a plot is that of its letters."""
    if isinstance(target, Path):
        target.write_bytes(b"")
    elif format == "svg":
        target.write(b'<svg xmlns="http://www.w3.org/2000/svg"/>')
    else:
        Image.new("RGB", (1, 1)).save(target, format="PNG")


def mesh_of_a_pad(geometry: Any, file: Path, size: Any = None, preset: str | None = None, nodes: Any = None) -> Any:
    assert preset is None or preset in geometry.presets, f"{file}: {preset}"
    return read_volume_mesh(TINY_GRIPPER.with_name("pad.msh"))


@contextmanager
def workers_here(cluster: Any, tasks: int) -> Iterator[Any]:
    """Workers that are this process."""

    class Here:
        count, about = 1, "here"

        def __init__(self) -> None:
            self.done: list[tuple[str, Any]] = []

        def submit(self, key: str, job: Any) -> None:
            self.done.append((key, job.make()))

        def next_done(self) -> tuple[str, Any]:
            return self.done.pop()

    yield Here()


class RunsHere:
    """A pool of processes that is this process."""

    def __init__(self, *_: Any) -> None:
        self.done: list[Path] = []

    def submit(self, path: Path, job: Any, *_: Any) -> None:
        from taichisoft_reduction.training_run import make_run

        make_run(*job)
        self.done.append(path)

    def next_done(self) -> tuple[Path, None]:
        return self.done.pop(), None

    def __exit__(self) -> None:
        """There is nothing to end."""


def write_files_of_a_user(folder: Path) -> None:
    """Files that documents name and that their readers have."""
    box = trimesh.creation.box
    box([30.0, 20.0, 20.0]).export(folder / "outer.stl")
    box([20.0, 10.0, 10.0]).export(folder / "cavity.stl")
    with gmsh_session("body.step") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 30, 20, 20)
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / "body.step"))
    write_volume_mesh(make_block((2, 1, 1), (20.0, 10.0, 10.0)), folder / "block.vtk")
    strip = {"mesh": "block.vtk", "mass": 0.002, "young_modulus": 100.0, "poisson_ratio": 0.3}
    clamps = [
        {"box": [[-99, -99, z], [99, 99, z]]} | follows for z, follows in ((-5, {}), (5, {"follows": "crosshead"}))
    ]
    tables = {"frames": {"crosshead": {}}, "soft_bodies": {"strip": strip | {"anchors": clamps}}}
    (folder / "strip.toml").write_text(tomli_w.dumps(tables))
    for name in ("scene.py", "other.pyscn"):
        (folder / name).write_text(SOFA_SCENE)
    (folder / "keys.jsonl").write_text("")
    (folder / "my-script.csv").write_text("time,pressure\n0.0,0.0\n0.5,5.0\n")
    strain = np.linspace(0.0, 2.0, 40)
    stress = 0.05 * ((1.0 + strain) - (1.0 + strain) ** -2.0)
    rows = [f"{one:.4f},{value:.6f}" for one, value in zip(strain, stress, strict=True)]
    (folder / "test.csv").write_text("\n".join(["strain,stress [MPa]", *rows]) + "\n")
    rows = [f"Probe 1;{100 * one:.2f};{12.5 * value:.6f}" for one, value in zip(strain, stress, strict=True)]
    (folder / "machine.csv").write_text("\n".join(["Probe;Dehnung;Zugkraft", *rows]).replace(".", ",") + "\n")
    for name in ("tube.py", "tube.toml"):
        shutil.copy(ROOT / "data" / "plugins" / name, folder / name)
    pages = {name: (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("plugins", "studies")}
    (folder / "squeeze.py").write_text(
        re.findall(r"```python\n(# squeeze\.py\n.*?)```", pages["plugins"], re.DOTALL)[0]
    )
    study = re.findall(r"```toml\n(scene = \"finger-inflated\".*?)```", pages["studies"], re.DOTALL)[0]
    (folder / "study.toml").write_text(re.sub(r"duration = [\d.]+", "duration = 0.03", study))
