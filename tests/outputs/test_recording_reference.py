"""docs/reference/recording.md says what lies where in the file: it and a recording name the same things."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block
from tiny_run import tiny_run

from taichisoft import VolumeMesh, write_volume_mesh
from taichisoft.mesh import boundary_triangles
from taichisoft_outputs.recording.layout import LAYOUT

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "recording.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A run with a body that has an element group and cables, and with an obstacle that has a surface."""
    import h5py

    folder = tmp_path_factory.mktemp("run")
    mesh = make_block((2, 1, 1), (20.0, 10.0, 10.0))
    surfaces, stiff = {"side": boundary_triangles(mesh.elements)[:2]}, {"stiff": np.array([1])}
    write_volume_mesh(VolumeMesh("", mesh.nodes, mesh.elements, surfaces, stiff), folder / "a.msh")
    trimesh.creation.box([9.0, 9.0, 9.0]).export(folder / "box.stl")
    points = [[-9.0, 0.0, 0.0], [-3.0, 1.0, 0.0], [3.0, 1.0, 0.0], [9.0, 0.0, 0.0]]
    cables = ", ".join(f"c{n} = {{points = {points[:count]}, friction = 0.1}}" for n, count in enumerate((2, 3, 4, 4)))
    body = "density = 1e-6, young_modulus = 100.0, poisson_ratio = 0.3, translation = [0.0, 0.0, 80.0]"
    threads = 'membranes = {a = {group = "side", thickness = 0.1, young_modulus = 1e3}}, '
    threads += f"fibres = {{a = {{points = {points}, diameter = 0.1, young_modulus = 1e3}}}}"
    added = [
        f'soft_bodies.block={{mesh = "{folder}/a.msh", {body}, cables = {{{cables}}}, {threads}}}',
        "frames={" + ", ".join(f"frame{n} = {{}}" for n in range(12)) + "}",
        "sensors.pressure={delay = 0.04}",
        'soft_bodies.right.cavities.cavity={group = "cavity", air = "network"}',
        f"air={network()}",
        f'obstacles.table={{surface = "{folder}/box.stl", translation = [90.0, 0.0, 0.0]}}',
    ]
    tiny_run(folder, added)
    with h5py.File(folder / "recording.h5") as opened:
        yield opened


def network() -> str:
    """Six tanks in a row, filled through ten valves with a delay of 14 steps, the last one joined to a cavity."""
    ends = [("bottle", f"tank{number}") for number in range(5)]
    ends += [(f"tank{number}", f"tank{number + 1}") for number in range(5)]
    valves = ", ".join(
        f'valve{number} = {{inlet = "{inlet}", outlet = "{outlet}", conductance = 0.1, delay = 0.14}}'
        for number, (inlet, outlet) in enumerate(ends)
    )
    tanks = ", ".join(f"tank{number} = {{volume = 100.0}}" for number in range(6))
    leak = 'leak = {inlet = "tank5", outlet = "right.cavity", conductance = 0.1}'
    kinds = {"sources": "bottle = {pressure = 9.0}", "tanks": tanks, "valves": valves, "orifices": leak}
    return "{" + ", ".join(f"{kind} = {{{tables}}}" for kind, tables in kinds.items()) + "}"


def rows(heading: str) -> list[list[str]]:
    """Cells of the table below a heading, without the signs of code; names that share a row get one each."""
    section = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (text,) = (part for part in section if part.startswith(heading))
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] for line in lines]
    return [
        [name.strip("`"), *(cell.strip("`") for cell in others)]
        for names, *others in cells
        for name in names.split(", ")
    ]


def test_the_attributes_of_the_file(file: Any) -> None:
    assert [name for name, _ in rows("Attributes")] != []
    assert {name for name, _ in rows("Attributes")} == set(file.attrs)
    assert file.attrs["layout"] == LAYOUT and f"**layout {LAYOUT}**" in PAGE


def test_the_paths_of_bodies_and_cables(file: Any) -> None:
    """Every dataset that is no frame is described, and what is described is there; names and numbers stand for all."""
    surfaces = r"soft_bodies/\d+/(surface|(cavities|membranes|fibres)/\d+)(?=/)"
    patterns = {
        path: re.sub("NAME", "[^/]+", re.sub(r"\b[IJ]\b", r"\\d+", path.replace("SURFACE", surfaces)))
        for path, _ in [*rows("Scene"), *rows("Cables")]
    }
    paths: list[str] = []
    file.visit(paths.append)
    bodies = [
        path for path in paths if path.split("/")[0] not in ("steps", "states", "controls", "controllers", "contacts")
    ]
    for path, pattern in patterns.items():
        assert any(re.fullmatch(pattern, found) for found in bodies), f"{path} is not in the file"
    for found in bodies:
        if hasattr(file[found], "shape"):
            assert any(re.fullmatch(pattern, found) for pattern in patterns.values()), f"{found} is not on the page"


@pytest.mark.parametrize(
    ("heading", "group"),
    [
        ("Instants", "steps"),
        ("States", "states"),
        ("Controllers", "controllers"),
        ("Contacts", "contacts"),
    ],
)
def test_the_datasets_of_frames(file: Any, heading: str, group: str) -> None:
    """Their names, units and shapes."""
    sizes = {
        "nodes": len(file["steps/position"][0]),
        "anchors": len(file["steps/anchor_position"][0]),
        "materials": len(file["columns/materials"]),
        "rigid_bodies": len(file["rigid_bodies"]),
        "cavities": len(file["columns/cavities"]),
        "cables": len(file["columns/cables"]),
        "rubbing_points": 5,
        "delayed_steps": 0,
        "air_nodes": len(file["columns/air_nodes"]),
        "air_parts": len(file["columns/air_parts"]),
        "air_drives": len(file["columns/air_drives"]),
        "air_volumes": 6,
        "air_delayed_steps": 14,
        "sensor_numbers": 2 + 5 * 2,
        "pairs": len(file["columns/pairs"]),
        "carriers": len(file["frames/names"]),
        "pushed": sum(len(file[key]) for key in ("soft_bodies", "rigid_bodies", "frames/names")),
    }
    assert len(set(sizes.values())) == len(sizes), "equal sizes would tell nothing"
    described = {name: (unit, eval(shape, sizes)) for name, unit, shape, _ in rows(heading)}
    assert described == {name: (values.attrs["unit"], values.shape[1:]) for name, values in file[group].items()}


def test_controls_are_datasets_of_steps(file: Any) -> None:
    section = PAGE.partition("\n## Controls\n")[2].partition("\n## ")[0]
    assert set(re.findall(r"`(\w+)`", section)) == {"controls", "steps", *file["controls"]}
    for name, values in file["controls"].items():
        same = file["steps"][name]
        assert (values.attrs["unit"], values.shape[1:]) == (same.attrs["unit"], same.shape[1:])
