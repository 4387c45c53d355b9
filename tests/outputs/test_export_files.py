"""Files for ParaView are read by VTK and by meshio, with every array as it was."""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from taichisoft.errors import TaichisoftError
from taichisoft.mesh import SIDES
from taichisoft_outputs import paraview
from taichisoft_outputs.paraview import CELL_TYPES, Grid, write_pvd, write_vtu


@pytest.fixture
def grid() -> Grid:
    """Random points, and cells between them."""
    random = np.random.default_rng(3)
    return Grid(
        points=random.normal(0.0, 50.0, (300, 3)),
        cells=[np.array([random.choice(300, 4, replace=False) for _ in range(170)])],
        point_data={"displacement": random.normal(size=(300, 3)), "chosen": np.arange(300) % 2 == 0},
        cell_data={"stress": random.normal(size=(170, 6)), 'body <1> & "2"': np.arange(170, dtype=np.int32)},
    )


@pytest.mark.parametrize("block_bytes", [1 << 20, 1000, 900 * 4], ids=["one block", "several", "full ones only"])
def test_vtk_reads_what_was_written(
    grid: Grid, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    """900 numbers of 4 bytes are the displacements: the last block is full, where VTK wants the size 0 written."""
    monkeypatch.setattr(paraview, "BLOCK_BYTES", block_bytes)
    write_vtu(tmp_path / "a.vtu", grid)
    read = pyvista.read(tmp_path / "a.vtu")
    np.testing.assert_array_equal(read.points, grid.points.astype(np.float32))
    np.testing.assert_array_equal(read.cells.reshape(-1, 5)[:, 1:], grid.cells[0])
    assert (read.celltypes == CELL_TYPES[4]).all()
    for name, values in grid.point_data.items():
        np.testing.assert_array_equal(read.point_data[name], values.astype(np.float32))
    for name, values in grid.cell_data.items():
        np.testing.assert_array_equal(read.cell_data[name], values.astype(np.float32))
    stress = read.GetCellData().GetArray("stress")
    assert [stress.GetComponentName(i) for i in range(6)] == ["XX", "YY", "ZZ", "XY", "YZ", "XZ"]


def test_meshio_reads_what_was_written(grid: Grid, tmp_path: Path) -> None:
    import meshio

    write_vtu(tmp_path / "a.vtu", grid)
    read = meshio.read(tmp_path / "a.vtu")
    np.testing.assert_array_equal(read.points, grid.points.astype(np.float32))
    np.testing.assert_array_equal(read.cells_dict["tetra"], grid.cells[0])
    np.testing.assert_array_equal(read.cell_data["stress"][0], grid.cell_data["stress"].astype(np.float32))
    assert read.point_data["chosen"].dtype == np.uint8


def test_curved_tetrahedra_stand_beside_straight_ones(tmp_path: Path) -> None:
    """VTK's volume of a straight-sided tetrahedron of ten nodes is that of its corners: 1/6; its nodes are in order."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    ten = np.vstack([corners, corners[SIDES].mean(axis=1)])
    write_vtu(tmp_path / "a.vtu", Grid(ten, [np.array([[0, 1, 2, 3]]), np.arange(10)[None]]))
    read = pyvista.read(tmp_path / "a.vtu")
    assert read.celltypes.tolist() == [CELL_TYPES[4], CELL_TYPES[10]]
    np.testing.assert_allclose(read.compute_cell_sizes()["Volume"], 1 / 6, rtol=1e-6)


def test_a_grid_of_nothing(tmp_path: Path) -> None:
    """A frame without contacts."""
    nothing = Grid(np.zeros((0, 3)), [np.zeros((0, 1), dtype=int)], {"force": np.zeros((0, 3))})
    write_vtu(tmp_path / "a.vtu", nothing)
    assert pyvista.read(tmp_path / "a.vtu").n_points == 0


def test_a_list_gives_the_file_of_each_time(grid: Grid, tmp_path: Path) -> None:
    files = []
    for index, time in enumerate((0.0, 0.01, 0.3)):
        path = tmp_path / "of <run>" / f"{index}.vtu"
        write_vtu(path, Grid(grid.points + index, grid.cells))
        files.append((time, path))
    write_pvd(tmp_path / "run.pvd", files)
    reader = pyvista.PVDReader(tmp_path / "run.pvd")
    assert reader.time_values == [0.0, 0.01, 0.3]
    reader.set_active_time_value(0.3)
    np.testing.assert_array_equal(reader.read()[0].points, (grid.points + 2).astype(np.float32))


def test_a_file_that_cannot_be_written(grid: Grid, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(TaichisoftError, match=r"file/a\.vtu: cannot be written: "):
        write_vtu(tmp_path / "file" / "a.vtu", grid)
