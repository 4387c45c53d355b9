"""Membranes and fibres in pictures and pages: closed slabs and tubes that move with the elements around them."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from blocks import make_block
from PIL import Image
from tiny_run import make_run

from taichisoft import Simulation, VolumeMesh, write_volume_mesh
from taichisoft.mechanics import SurfaceKind, body_surfaces
from taichisoft.mechanics.reinforcements import LEAST, SIDES
from taichisoft.mesh import boundary_triangles, count_open_edges, enclosed_volume
from taichisoft.scene import scene_from_dict
from taichisoft_outputs import Style, read_recording, render_pictures
from taichisoft_outputs.drawing.colouring import PLAIN
from taichisoft_outputs.recording.recording_output import RecordingOutput

SIZE = (40.0, 10.0, 2.0)
HALF = LEAST * float(np.linalg.norm(SIZE))
LINE = [[-18.0, 0.0, 0.0], [18.0, 0.0, 0.0]]
SHEAR = np.array([[1.0, 0.2, 0.0], [0.0, 1.1, 0.0], [0.1, 0.0, 1.3]])


@pytest.fixture(scope="module")
def simulation(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    """A strip with paper on top, half of whose triangles are turned over, and a fibre, in a sheared state."""
    block = make_block((8, 2, 1), SIZE)
    walls = boundary_triangles(block.elements)
    top = walls[(block.nodes[walls][..., 2] == 1.0).all(axis=1)]
    top[::2] = top[::2, ::-1]
    path = tmp_path_factory.mktemp("strip") / "strip.msh"
    write_volume_mesh(VolumeMesh("strip", block.nodes, block.elements, {"top": top}).check(), path)
    strip = {
        "mesh": str(path),
        "density": 1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "membranes": {"sheet": {"group": "top", "thickness": 1e-3, "young_modulus": 1e5}},
        "fibres": {"sheet": {"points": LINE, "diameter": 1e-3, "young_modulus": 1e6}},
    }
    simulation = Simulation(scene_from_dict({"soft_bodies": {"strip": strip}, "time": {"duration": 0.01}}))
    state = simulation.state
    simulation.restore(replace(state, position=state.position @ SHEAR.T))
    return simulation


def test_slab_and_tube_move_with_the_elements(simulation: Simulation, tmp_path: Path) -> None:
    """Volumes at rest: area times thickness, and the hexagon (3 / 2) sqrt(3) r^2 times the length."""
    model, state = simulation.model, simulation.state
    at_rest = replace(state, position=model.rest_position)
    slab, tube = (one for one in body_surfaces(model.soft_bodies, (), ()) if one.kind in ("membrane", "fibre"))
    volumes = {"membrane": SIZE[0] * SIZE[1] * 2.0 * HALF, "fibre": 1.5 * np.sqrt(3.0) * HALF**2 * 36.0}
    assert SIDES == 6 and [slab.name, tube.name] == ["strip.sheet|membrane", "strip.sheet|fibre"]
    for surface in (slab, tube):
        assert count_open_edges(surface.triangles) == 0
        vertices = surface.vertices(at_rest)
        assert enclosed_volume(vertices, surface.triangles) == pytest.approx(volumes[surface.kind])
        assert surface.vertices(state) == pytest.approx(vertices @ SHEAR.T)
    make_run(simulation, [RecordingOutput(tmp_path)], [])
    style = Style(size=(160, 90), view="top", axes=False, caption=False)
    (path,) = render_pictures(tmp_path / "recording.h5", {"end": 0.0}, tmp_path, style)
    red, _, blue = np.asarray(Image.open(path).convert("RGB"), dtype=int).transpose(2, 0, 1)
    assert (red - blue > 60).sum() > 1000, "paper covers the strip"
    with read_recording(tmp_path / "recording.h5") as recording:
        for surface in (slab, tube):
            (recorded,) = (one for one in recording.surfaces if one.name == surface.name)
            assert recorded.kind == surface.kind
            assert recorded.vertices(0) == pytest.approx(surface.vertices(state))


def test_every_kind_of_surface_has_a_colour() -> None:
    assert set(get_args(SurfaceKind)) == set(PLAIN)
