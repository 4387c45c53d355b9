"""Stress along a line: a beam in bending, a bar of two materials, the table, and what is refused."""

import csv
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_run

from taichisoft import Control
from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.one_body import TO_REST, settle, simulation_of
from taichisoft_benchmarks.regular_meshes import bar
from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.stress import StressLine, parse_line, stress_along

YOUNG, SIZE = 100.0, np.array([40.0, 10.0, 10.0])
ENDS = [{"box": ((x - 0.1, -99.0, -99.0), (x + 0.1, 99.0, 99.0))} for x in (0.0, SIZE[0])]


def stress_of(folder: Path, element: str, place: Any, line: str, cells: int = 4, **body: Any) -> StressLine:
    """Of a bar whose ends are put to `place(rest)`, at its start and at rest; lines begin at a corner of the bar."""
    mesh = bar((4 * cells, cells, cells), tuple(SIZE), "hexahedral" if element == "hexahedral" else "linear")
    mesh.nodes[:] -= mesh.nodes.min(axis=0)
    simulation = simulation_of(mesh, TO_REST, young_modulus=YOUNG, element=element, anchors=ENDS, **body)
    output = RecordingOutput(folder)
    output.begin(simulation.model, simulation.state)
    anchored, rest = simulation.model.anchored_nodes, simulation.model.rest_position
    settle(simulation, lambda _: Control(anchor_positions={"body": place(rest)[anchored]}), 1)
    output.record(simulation.state, simulation.report)
    output.end("completed")
    with read_recording(folder / "recording.h5") as recording:
        return stress_along(recording, parse_line(line), [0, recording.instant_count - 1])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("element", "poisson", "bound"),
    [("hexahedral", 0.3, 0.03), ("quadratic", 0.49, 0.01), ("smoothed", 0.3, 0.12), ("linear", 0.3, 0.12)],
)
def test_bent_beam_has_stress_linear_in_its_height(tmp_path: Path, element: str, poisson: float, bound: float) -> None:
    """sigma_xx = E kappa y up to the surface, by the ends of a beam in pure bending, and nothing else.

    Tolerances, of the stress at the surface, on four cells over the height: quadratic elements hold linear strains,
    hexahedra those of shape alone, tetrahedra of four nodes none. The mean around nodes is off by 12 to 25 % there.
    """
    curvature = 1e-4

    def bent(rest: np.ndarray) -> np.ndarray:
        x, y, z = (rest - SIZE / 2).T
        turned = -0.5 * x**2 - 0.5 * poisson * (y**2 - z**2)
        return rest + curvature * np.column_stack([x * y, turned, -poisson * y * z])

    line = stress_of(tmp_path, element, bent, "20.3,-5,5.2:20.3,15,5.2", poisson_ratio=poisson)
    height = line.along - 5.0
    inside = (height > -1e-9) & (height < 10.0 + 1e-9)
    np.testing.assert_array_equal(np.isnan(line.stress).all(axis=(0, 2, 3)), ~inside)
    assert np.abs(line.stress[0, inside]).max() < 1e-9
    peak, expected = YOUNG * curvature * SIZE[1] / 2, np.zeros((inside.sum(), 3, 3))
    expected[:, 0, 0] = YOUNG * curvature * (height[inside] - SIZE[1] / 2)
    assert np.abs(line.stress[1, inside] - expected).max() < bound * peak
    figures = line.figures()
    np.testing.assert_allclose(figures["von Mises"][1, inside], np.abs(expected[:, 0, 0]), atol=1.5 * bound * peak)
    np.testing.assert_allclose(
        figures["largest principal"][1, inside], np.maximum(expected[:, 0, 0], 0.0), atol=1.5 * bound * peak
    )


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("element", ["smoothed", "quadratic", "hexahedral"])
def test_materials_keep_their_own_stress_up_to_where_they_meet(tmp_path: Path, element: str) -> None:
    """A bar pulled by 0.1 %, of two layers, one three times as stiff: E times the strain in each, at Poisson's 0."""
    layer = {"box": ((-1.0, 5.0, -1.0), (41.0, 11.0, 11.0)), "young_modulus": 3.0 * YOUNG}
    line = stress_of(
        tmp_path, element, lambda rest: rest * [1.001, 1.0, 1.0], "20,0,5:20,10,5", poisson_ratio=0.0, regions=[layer]
    )
    stress, height = line.stress[1, :, 0, 0], line.along
    np.testing.assert_allclose(stress[height < 4.99], 1e-3 * YOUNG, rtol=1e-3)
    np.testing.assert_allclose(stress[height > 5.01], 3e-3 * YOUNG, rtol=1e-3)


def test_command_writes_plot_and_table(tmp_path: Path) -> None:
    tiny_run.tiny_run(tmp_path)
    with read_recording(tmp_path / "recording.h5") as recording:
        rest = recording.soft_bodies[0].rest_position
        ends = "{:g},{:g},{:g}:{:g},{:g},{:g}".format(*(rest.mean(axis=0) - 40.0), *(rest.mean(axis=0) + 40.0))
        last = recording.times[-1]
        expected = stress_along(recording, parse_line(ends), [recording.instant_count - 1])
    run = tmp_path / "recording.h5"
    shown = tiny_run.command("recording", "plot", run, "--line", ends, "--time", "0", "--time", str(last))
    picture, table = map(Path, shown.output.split())
    assert picture.read_bytes().startswith(b"\x89PNG")
    rows = list(csv.DictReader(io.StringIO(table.read_text(encoding="utf-8"))))
    assert len(rows[0]) == 1 + 2 * 8 and len(rows) == len(expected.along)
    found = [row[f"von Mises stress [kPa], {last:g} s"] for row in rows]
    mises = expected.figures()["von Mises"][0]
    np.testing.assert_allclose([float(value or "nan") for value in found], mises, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose([float(row["distance along the line at rest [mm]"]) for row in rows], expected.along)
    at_rest = [float(row["von Mises stress [kPa], 0 s"] or "nan") for row in rows]
    assert np.nanmax(at_rest) == 0.0, "no round-off"
    for options, problem in (
        (["--line", ends, "--only", "bending"], "--line draws stress over distance"),
        (["--time", "0"], "--time is a moment of --line"),
        (["--line", ends, "--time", "99"], "nothing at 99 s"),
        (["--line", "900,0,0:999,0,0"], "--line: none of its 201 points is in a soft body at rest; they are between -"),
    ):
        assert problem in str(tiny_run.command("recording", "plot", run, *options).exception), options


@pytest.mark.parametrize(
    "text",
    ["", "0,0,0", "0,0,0:0,0,0", "0,0:1,1", "0,0,0:1,1", "nan,0,0:1,1,1", "1e999,0,0:1,1,1", "a,0,0:1,1,1", "1:2:3"],
)
def test_what_is_no_line_is_refused(text: str) -> None:
    with pytest.raises(TaichisoftError, match=re.escape(f"--line {text}: must be two different points in mm")):
        parse_line(text)
