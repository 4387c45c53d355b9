"""`taichisoft recording export`: what ParaView opens has the positions, motion and stress of the recorded frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import pyvista
import tiny_run
import trimesh

from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import Stretches
from taichisoft.mesh import SIDES
from taichisoft_outputs import Recording, RecordingError, read_recording
from taichisoft_outputs.paraview import (
    ExportError,
    chosen_instants,
    export_glb,
    export_vtu,
    make_grid,
    write_pvd,
    write_vtu,
)
from taichisoft_outputs.stress import StressLaw, von_mises

ROOT = Path(__file__).resolve().parents[2]
FRAME = 37
"""A frame in which the cube is carried."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    tiny_run.tiny_run(folder)
    return folder / "recording.h5"


@pytest.fixture(scope="module")
def exported(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vtu")
    with read_recording(run) as recording:
        export_vtu(recording, [0, FRAME, tiny_run.STEPS], folder)
    return folder


@pytest.fixture
def recording(run: Path):
    with read_recording(run) as opened:
        yield opened


def grid(folder: Path, name: str, frame: int) -> pyvista.UnstructuredGrid:
    return pyvista.read(folder / name / f"{frame:05d}.vtu")


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """To the digits of single precision."""
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_every_list_has_the_times_of_the_frames(exported: Path, recording: Recording) -> None:
    names = sorted(path.stem for path in exported.glob("*.pvd"))
    assert names == ["cavities", "contacts", "rigid_bodies", "soft_bodies"]
    for name in names:
        reader = pyvista.PVDReader(exported / f"{name}.pvd")
        assert reader.time_values == pytest.approx(recording.times[[0, FRAME, tiny_run.STEPS]])
        reader.set_active_time_point(1)
        np.testing.assert_array_equal(reader.read()[0].points, grid(exported, name, FRAME).points)


def test_surfaces_are_gltf_in_metres(recording: Recording, tmp_path: Path) -> None:
    """Areas and heights are those of the scene, whose up is y in glTF."""
    (path,) = export_glb(recording, [FRAME], tmp_path)
    drawn = trimesh.load(path)
    assert set(drawn.geometry) >= {surface.name for surface in recording.surfaces}
    for surface in recording.surfaces:
        vertices = surface.vertices(FRAME)
        mesh = drawn.geometry[surface.name]
        assert mesh.area == pytest.approx(trimesh.Trimesh(vertices, surface.triangles).area / 1e6, rel=1e-4)
        np.testing.assert_allclose(
            np.sort(mesh.vertices[:, 1]), np.sort(vertices @ recording.scene.up) / 1e3, atol=1e-6
        )


def test_points_are_those_of_the_deformed_bodies(exported: Path, recording: Recording) -> None:
    soft = grid(exported, "soft_bodies", FRAME)
    position = recording.row("position", FRAME)
    rest = np.vstack([body.rest_position for body in recording.soft_bodies])
    close(soft.points, position)
    close(soft["displacement [mm]"], position - rest)
    close(soft["velocity [mm/s]"], recording.velocity(FRAME))
    assert np.ptp(soft["displacement [mm]"]) > 1.0, "there is something to see"


def test_cells_have_stress_material_body_and_groups(exported: Path, recording: Recording) -> None:
    soft = grid(exported, "soft_bodies", FRAME)
    left, right = recording.soft_bodies
    count = len(left.elements)
    np.testing.assert_array_equal(soft.cell_data["body"], [0] * count + [1] * len(right.elements))
    np.testing.assert_array_equal(soft.point_data["body"], [0] * len(left.mesh_nodes) + [1] * len(right.mesh_nodes))
    for body, cells in ((left, slice(0, count)), (right, slice(count, None))):
        position = recording.row("position", FRAME)[body.nodes]
        law = StressLaw(body.rest_position, body.elements, body.poisson_ratio, corotation="polar")
        stress = law.stress(position, np.full(len(body.elements), 100.0))
        close(soft.cell_data["von_mises [kPa]"][cells], von_mises(stress))
        stretches = Stretches(body.rest_position, body.elements)
        close(soft.cell_data["largest_stretch"][cells], stretches.largest(position))
        xx_yy_zz_xy_yz_xz = stress[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
        close(soft.cell_data["stress [kPa]"][cells], xx_yy_zz_xy_yz_xz)
    assert (soft.cell_data["young_modulus [kPa]"] == 100.0).all()
    np.testing.assert_array_equal(soft.cell_data["material_left"], soft.cell_data["body"] == 0)
    base = np.zeros(len(soft.points), dtype=bool)
    for body in (left, right):
        base[body.nodes.start + body.surface_groups["base"].ravel()] = True
    np.testing.assert_array_equal(soft.point_data["surface_base"], base)


def test_rotations_are_those_of_the_scene(tmp_path: Path) -> None:
    """A body with `corotation = "polar"` gets the stress of that law."""
    tiny_run.tiny_run(tmp_path, ['soft_bodies.left.corotation="polar"', 'soft_bodies.right.corotation="edges"'])
    with read_recording(tmp_path / "recording.h5") as recording:
        export_vtu(recording, [FRAME], tmp_path)
        found = grid(tmp_path, "soft_bodies", FRAME).cell_data["von_mises [kPa]"]
        expected = [
            von_mises(
                StressLaw(body.rest_position, body.elements, body.poisson_ratio, corotation).stress(
                    recording.row("position", FRAME)[body.nodes], np.full(len(body.elements), 100.0)
                )
            )
            for body, corotation in zip(recording.soft_bodies, ("polar", "edges"), strict=True)
        ]
    close(found, np.concatenate(expected))


def test_an_element_group_is_a_cell_array(tmp_path: Path, block) -> None:
    """Groups of one body only are 0 in the others, as is its silicone; elements of ten nodes stay cells."""
    from blocks import make_block

    from taichisoft import VolumeMesh, write_volume_mesh

    mesh = make_block((2, 1, 1), (20.0, 10.0, 10.0))
    grouped = VolumeMesh("block", mesh.nodes, mesh.elements, {}, {"stiff": np.array([1, 5, 6])})
    write_volume_mesh(grouped, tmp_path / "grouped.msh")
    write_volume_mesh(mesh, tmp_path / "plain.msh")
    body = "density = 1e-6, young_modulus = 100.0, poisson_ratio = 0.3"
    rubber = f'element = "quadratic", material = "{ROOT}/data/materials/dragon-skin-30.toml"'
    extra = [
        f'soft_bodies.one={{mesh = "{tmp_path}/plain.msh", translation = [0.0, 0.0, 60.0], {body}}}',
        f'soft_bodies.two={{mesh = "{tmp_path}/grouped.msh", translation = [0.0, 0.0, 80.0], {rubber}}}',
    ]
    tiny_run.tiny_run(tmp_path, extra)
    with read_recording(tmp_path / "recording.h5") as recording:
        export_vtu(recording, [0], tmp_path)
        before = sum(len(body.elements) for body in recording.soft_bodies[:3])
    found = grid(tmp_path, "soft_bodies", 0)
    np.testing.assert_array_equal(np.flatnonzero(found.cell_data["group_stiff"]), before + np.array([1, 5, 6]))
    assert found.celltypes.tolist() == [10] * before + [24] * len(mesh.elements)
    np.testing.assert_array_equal(found.cell_data["material_Dragon Skin 30"], found.celltypes == 24)


def test_cavities_bear_their_pressure(exported: Path, recording: Recording) -> None:
    cavities = grid(exported, "cavities", FRAME)
    for number, name in enumerate(recording.cavities):
        cells = cavities.cell_data["cavity"] == number
        surface = next(surface for surface in recording.surfaces if surface.name == name)
        close(
            cavities.points[cavities.cells.reshape(-1, 4)[cells, 1]], surface.vertices(FRAME)[surface.triangles[:, 0]]
        )
        close(
            cavities.cell_data["pressure [kPa]"][cells], np.full(cells.sum(), recording.row("pressure", FRAME)[number])
        )
        close(cavities.cell_data["volume [mm^3]"][cells], np.full(cells.sum(), recording.row("volume", FRAME)[number]))


def test_rigid_bodies_move_and_planes_are_squares_that_face_as_they_do(exported: Path, recording: Recording) -> None:
    bodies = grid(exported, "rigid_bodies", tiny_run.STEPS)
    cube = bodies.extract_cells(bodies.cell_data["body"] == 2)
    close(cube.center, recording.row("rigid_position", tiny_run.STEPS)[0])
    assert cube.center[2] > 6.0, "it was lifted"
    floor = bodies.extract_cells(bodies.cell_data["body"] == 3).extract_surface(algorithm=None)
    assert floor.bounds.z_min == floor.bounds.z_max == 0.0
    assert (floor.face_normals == [0.0, 0.0, 1.0]).all()
    soft = grid(exported, "soft_bodies", 0).bounds
    assert floor.bounds.x_min < soft.x_min and floor.bounds.x_max > soft.x_max


def test_contacts_are_points_with_forces(exported: Path, recording: Recording) -> None:
    points, forces = recording.contacts(FRAME)
    contacts = grid(exported, "contacts", FRAME)
    assert contacts.n_points == len(points) > 0
    close(contacts.points, points)
    close(contacts["force [mN]"], forces)
    assert grid(exported, "contacts", 0).n_points == 0


def test_meshio_reads_a_frame_too(exported: Path) -> None:
    import meshio

    read = meshio.read(exported / "soft_bodies" / f"{FRAME:05d}.vtu")
    soft = grid(exported, "soft_bodies", FRAME)
    np.testing.assert_array_equal(read.points, soft.points)
    np.testing.assert_array_equal(read.cell_data["stress [kPa]"][0], soft.cell_data["stress [kPa]"])


def test_which_frames(recording: Recording) -> None:
    assert chosen_instants(recording, None, None) == list(range(tiny_run.STEPS + 1))
    assert chosen_instants(recording, 15, None) == [0, 15, 30]
    assert chosen_instants(recording, None, [0.3, 0.0, 0.301]) == [0, 30]
    with pytest.raises(RecordingError, match=r"nothing at 3 s; the recording has from 0 s to 0\.4 s"):
        chosen_instants(recording, None, [3.0])
    with pytest.raises(ExportError, match="--every 0: must be 1 or more"):
        chosen_instants(recording, 0, None)
    with pytest.raises(ExportError, match="give one of them"):
        chosen_instants(recording, 2, [0.1])


def test_the_command_writes_beside_the_recording_and_names_what_to_open(run: Path) -> None:
    shown = tiny_run.command("recording", "export", run, "--every", 20)
    assert shown.exit_code == 0, shown.output
    assert str(run.parent / "vtu" / "soft_bodies.pvd") in shown.output
    assert len(list((run.parent / "vtu" / "contacts").glob("*.vtu"))) == 3


def test_of_a_run_that_was_started_anew_only_the_last_start_is_exported(tmp_path: Path) -> None:
    """ParaView's times cannot go back; the command says that it leaves something out."""
    tiny_run.tiny_run(tmp_path, restart_after=10)
    shown = tiny_run.command("recording", "export", tmp_path / "recording.h5", "--every", 10)
    assert "only the 5 instants after the last start are exported" in shown.output
    assert pyvista.PVDReader(tmp_path / "vtu" / "soft_bodies.pvd").time_values == pytest.approx(
        [0.0, 0.1, 0.2, 0.3, 0.4]
    )


def test_what_was_written_before_it_ended_can_be_opened(recording: Recording, tmp_path: Path) -> None:
    """Somebody presses Ctrl and c after two frames."""

    def frames() -> Iterator[int]:
        yield from (0, 10)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_vtu(recording, frames(), tmp_path)
    assert pyvista.PVDReader(tmp_path / "contacts.pvd").time_values == pytest.approx([0.0, 0.1])


# The files by themselves: VTK and meshio read every array as it was.

RANDOM = np.random.default_rng(3)
TABLES = {
    "points": RANDOM.normal(0.0, 50.0, (300, 3)),
    "cells": [np.array([RANDOM.choice(300, 4, replace=False) for _ in range(170)])],
    "point_data": {"displacement": RANDOM.normal(size=(300, 3)), "chosen": np.arange(300) % 2 == 0},
    "cell_data": {"stress": RANDOM.normal(size=(170, 6)), 'body <1> & "2"': np.arange(170, dtype=np.int32)},
}


def test_vtk_and_meshio_read_what_was_written(tmp_path: Path) -> None:
    import meshio

    write_vtu(tmp_path / "a.vtu", make_grid(**TABLES))
    read, again = pyvista.read(tmp_path / "a.vtu"), meshio.read(tmp_path / "a.vtu")
    for points in (read.points, again.points):
        np.testing.assert_array_equal(points, TABLES["points"].astype(np.float32))
    for cells in (read.cells.reshape(-1, 5)[:, 1:], again.cells_dict["tetra"]):
        np.testing.assert_array_equal(cells, TABLES["cells"][0])
    assert (read.celltypes == pyvista.CellType.TETRA).all()
    for name, values in TABLES["point_data"].items():
        np.testing.assert_array_equal(read.point_data[name], values.astype(np.float32))
    for name, values in TABLES["cell_data"].items():
        np.testing.assert_array_equal(read.cell_data[name], values.astype(np.float32))
        np.testing.assert_array_equal(again.cell_data[name][0], values.astype(np.float32))
    assert again.point_data["chosen"].dtype == np.uint8


def test_curved_tetrahedra_stand_beside_straight_ones(tmp_path: Path) -> None:
    """VTK's volume of a straight-sided tetrahedron of ten nodes is that of its corners: 1/6; its nodes are in order."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    ten = np.vstack([corners, corners[SIDES].mean(axis=1)])
    write_vtu(tmp_path / "a.vtu", make_grid(ten, [np.array([[0, 1, 2, 3]]), np.arange(10)[None]]))
    read = pyvista.read(tmp_path / "a.vtu")
    assert read.celltypes.tolist() == [pyvista.CellType.TETRA, pyvista.CellType.QUADRATIC_TETRA]
    np.testing.assert_allclose(read.compute_cell_sizes()["Volume"], 1 / 6, rtol=1e-6)


def test_a_grid_of_nothing(tmp_path: Path) -> None:
    """A frame without contacts."""
    nothing = make_grid(np.zeros((0, 3)), [np.zeros((0, 1), dtype=int)], {"force": np.zeros((0, 3))})
    write_vtu(tmp_path / "a.vtu", nothing)
    assert pyvista.read(tmp_path / "a.vtu").n_points == 0


def test_a_list_gives_the_file_of_each_time(tmp_path: Path) -> None:
    files = []
    for index, time in enumerate((0.0, 0.01, 0.3)):
        path = tmp_path / "of <run>" / f"{index}.vtu"
        write_vtu(path, make_grid(TABLES["points"] + index, TABLES["cells"]))
        files.append((time, path))
    write_pvd(tmp_path / "run.pvd", files)
    reader = pyvista.PVDReader(tmp_path / "run.pvd")
    assert reader.time_values == [0.0, 0.01, 0.3]
    reader.set_active_time_value(0.3)
    np.testing.assert_array_equal(reader.read()[0].points, (TABLES["points"] + 2).astype(np.float32))


def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(TaichisoftError, match=r"file/a\.vtu: cannot be written: "):
        write_vtu(tmp_path / "file" / "a.vtu", make_grid(**TABLES))
