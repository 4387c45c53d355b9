"""Errors of a run by its step and its mesh, where they are known."""

import csv
from pathlib import Path
from typing import Any

import pytest
from blocks import make_block
from conftest import Figures

from taichisoft import Scene, load_scene, scene_from_dict
from taichisoft.mesh import write_volume_mesh
from taichisoft_studies.errors import StudyError
from taichisoft_studies.finger_commands import TABLE
from taichisoft_studies.finger_commands import converge as command
from taichisoft_studies.refinement import changed, finer_meshes, refine, refinement_error

SIZE = (40.0, 10.0, 10.0)
TIP = "final_tip_positions_mm.block.2"
EVERYWHERE = {"box": [[-1e3, -1e3, -1e3], [1e3, 1e3, 1e3]]}


def block(folder: Path, cells: tuple[int, int, int], time: dict[str, Any], **keys: Any) -> Scene:
    mesh = folder / f"block-{cells[0]}.msh"
    write_volume_mesh(make_block(cells, SIZE), mesh)
    body = {"mesh": str(mesh), "element": "linear", "density": 1e-6, "young_modulus": 100.0, "poisson_ratio": 0.3}
    return scene_from_dict(
        {
            "time": time,
            "gravity": [0.0, 0.0, -9810.0],
            "controller": {"name": "scripted", "settings": {"script": "rest"}},
            "soft_bodies": {"block": {**body, **keys}},
        }
    )


@pytest.mark.parametrize("order", [1.0, 1.089, 2.0])
def test_error_of_a_power_is_exact(order: float) -> None:
    """v(h) = 3 + 0.7 h^p has the error 0.7 h^p, exactly, whatever the ratio."""
    for ratio in (1.4, 2.0):
        value, refined = 3.0 + 0.7 * 0.1**order, 3.0 + 0.7 * (0.1 / ratio) ** order
        assert refinement_error(value, refined, ratio, order) == pytest.approx(0.7 * 0.1**order, rel=1e-12)


def test_falling_block_is_half_a_step_too_low(tmp_path: Path, figures: Figures) -> None:
    """Implicit Euler falls by g T (T + h) / 2 where g T^2 / 2 is right: the error is -g T h / 2, to round-off.

    The mesh of a body that only falls has no error.
    """
    scene = block(tmp_path, (1, 1, 1), time={"step": 0.01, "duration": 0.1}, tip=EVERYWHERE)
    finer = block(tmp_path, (2, 1, 1), time={"step": 0.01, "duration": 0.1}, tip=EVERYWHERE)
    lines: list[str] = []
    found = refine(
        scene, tmp_path / "runs", [f"soft_bodies.block.mesh={finer.soft_bodies['block'].mesh.file}"], made=lines.append
    )
    (tip,) = [one for one in found.figures if one.name == TIP]
    figures.close("error by the step [mm]", tip.step_error, -9810.0 * 0.1 * 0.01 / 2.0, 1e-9)
    assert (found.order, found.nodes, found.remark) == (1, (8, 12), "")
    assert tip.mesh_error == pytest.approx(0.0, abs=1e-9)
    assert tip.error == pytest.approx(abs(tip.step_error), abs=1e-9)
    assert lines == ["run: completed", "half the step: completed", "finer mesh: completed"]
    again = refine(scene, tmp_path / "runs", [])
    assert again.nodes is None and again.figures[0].mesh_error is None


def test_error_of_a_coarse_beam_is_estimated(tmp_path: Path, figures: Figures) -> None:
    """A cantilever of one cell over its height is too stiff: its tip is too high, by what two cells tell of four.

    The estimate from one and two cells lies within a factor of two of what four cells, which lack little, differ by.
    """
    clamp = [{"box": [[-20.1, -6.0, -6.0], [-19.9, 6.0, 6.0]]}]
    scenes = [
        block(tmp_path, (4 * n, n, n), time={"step": 0.5, "duration": 0.5, "dynamics": "static"}, anchors=clamp)
        for n in (1, 2, 4)
    ]
    files = [one.soft_bodies["block"].mesh.file for one in scenes]
    found = refine(scenes[0], tmp_path / "runs", [f"soft_bodies.block.mesh={files[1]}"])
    (tip,) = [one for one in found.figures if one.name == TIP]
    assert tip.step_error == pytest.approx(0.0, abs=1e-5), "rest does not depend on the step"
    finest = refine(scenes[0], tmp_path / "runs", [f"soft_bodies.block.mesh={files[2]}"])
    (fine,) = [one for one in finest.figures if one.name == TIP]
    assert tip.mesh_error is not None and fine.finer_mesh is not None
    lacking = fine.value - fine.finer_mesh
    figures.close("estimated error over what four cells differ by", tip.mesh_error / lacking, 1.4, 0.6)


def test_finer_meshes_are_known() -> None:
    """A file by its name, a geometry by preset, size or nodes; what cannot be finer is told."""

    def finer(mesh: str, *others: str) -> tuple[list[str], str]:
        return finer_meshes(load_scene("finger-inflated", [f"soft_bodies.finger.mesh={mesh}", *others]))

    medium = load_scene("finger-inflated", ["soft_bodies.finger.mesh=tutorial-medium"]).soft_bodies["finger"].mesh.file
    assert finer("tutorial-coarse") == ([f'soft_bodies.finger.mesh="{medium}"'], "")
    assert finer('{ file = "tutorial.toml", preset = "coarse" }') == (['soft_bodies.finger.mesh.preset="medium"'], "")
    assert finer('{ file = "tutorial.toml", nodes = 1000 }') == (["soft_bodies.finger.mesh.nodes=2915"], "")
    (sized,), _ = finer('{ file = "tutorial.toml", size = 10.0 }')
    assert sized == "soft_bodies.finger.mesh.size=7"
    (finest,), _ = finer('{ file = "tutorial.toml", preset = "fine" }')
    assert "preset" not in finest and changed(load_scene("finger-inflated"), [finest])
    for reason in (
        finer("tutorial-medium"),
        finer("tutorial-coarse", "soft_bodies.finger.anchors=[{ nodes = [0, 1, 2] }]"),
    ):
        assert reason[0] == [] and reason[1].startswith("finger ")


def test_coarser_mesh_and_failed_run_are_refused(tmp_path: Path) -> None:
    scene = block(tmp_path, (2, 1, 1), time={"step": 0.01, "duration": 0.02}, tip=EVERYWHERE)
    coarser = block(tmp_path, (1, 1, 1), time={"step": 0.01, "duration": 0.02}, tip=EVERYWHERE)
    with pytest.raises(StudyError, match="the finer mesh has 8 nodes, not more than the 12"):
        refine(scene, tmp_path / "runs", [f"soft_bodies.block.mesh={coarser.soft_bodies['block'].mesh.file}"])
    clamp = [{"box": [[-20.1, -6.0, -6.0], [-19.9, 6.0, 6.0]]}]
    flowing = block(tmp_path, (2, 1, 1), time={"step": 0.5, "duration": 2.0}, anchors=clamp, young_modulus=0.01)
    with pytest.raises(StudyError, match=r"^run: (diverged|beyond the law): "):
        refine(flowing, tmp_path / "runs", [])


def test_converge_writes_what_it_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from taichisoft.pytest_fixtures import TINY_GRIPPER

    command(str(TINY_GRIPPER), tmp_path, duration=0.02)
    said = capsys.readouterr().out
    assert (
        "steps of 10 ms, order 1" in said
        and "error by mesh" not in said
        and "left has a mesh that cannot be made finer" in said
    )
    with (tmp_path / TABLE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows and all(row["step_error"] and not row["mesh_error"] for row in rows)
    with pytest.raises(StudyError, match="--duration nan"):
        command(str(TINY_GRIPPER), tmp_path, duration=float("nan"))
