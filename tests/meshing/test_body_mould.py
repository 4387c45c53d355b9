"""Moulds of any body: what they cast in silico is the body, their parts come apart, and their least wall is right."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import solid_shapes
import trimesh
from conftest import Figures
from trimesh.boolean import difference, intersection, union

from taichisoft.errors import GoalMissed, MeshError
from taichisoft.mesh import read_surface
from taichisoft_meshing.mesh_commands import geometry_job, mould, mould_check, surfaces_job
from taichisoft_meshing.mould_check import CheckedCast, check_mould, read_mould_record, wall_thickness
from taichisoft_meshing.mould_parts import write_mould

Surface = trimesh.Trimesh
ROUND = 96  # facets around


def bellows() -> tuple[Surface, Surface]:
    """Four convolutions along z, walls of 1.5 mm or so, with a closed chamber."""
    outer, inner = ([], [])
    for z, r in zip(range(0, 33, 4), itertools.cycle((8.0, 11.0)), strict=False):
        outer.append((r, float(z)))
    for z, r in zip((2, *range(4, 29, 4), 30), (6.0, 9.0, 6.0, 9.0, 6.0, 9.0, 6.0, 9.0, 6.0), strict=True):
        inner.append((r, float(z)))
    return tuple(
        trimesh.creation.revolve([(0.0, its[0][1]), *its, (0.0, its[-1][1])], sections=ROUND) for its in (outer, inner)
    )  # type: ignore[return-value]


def fibre_tube(aside: float = 0.0) -> tuple[Surface, Surface]:
    """A round tube with closed ends, its bore moved aside [mm]."""
    bore = trimesh.creation.cylinder(5.0, 70.0, sections=ROUND)
    return trimesh.creation.cylinder(8.0, 80.0, sections=ROUND), solid_shapes.moved(bore, (aside, 0, 0))


def chambered_finger() -> tuple[Surface, Surface]:
    """A bar along x with slots in its back, and four chambers joined by a channel below them."""
    bar = solid_shapes.box((80, 16, 18))
    slots = [solid_shapes.box((3, 8, 20), (x, 5, 0)) for x in (-20.0, 0.0, 20.0)]
    chambers = [solid_shapes.box((13, 8, 13), (x, 2, 0)) for x in (-30.0, -10.0, 10.0, 30.0)]
    channel = solid_shapes.box((70, 2, 4), (0, -3, 0))
    return difference([bar, *slots], engine="manifold"), union([*chambers, channel], engine="manifold")


BODIES = {"bellows": bellows, "fibre-tube": fibre_tube, "finger": chambered_finger}


def write(folder: Path, surfaces: tuple[Surface, ...], **form: Any) -> list[CheckedCast]:
    files = [solid_shapes.save(its, folder / f"part{number}.stl") for number, its in enumerate(surfaces)]
    write_mould(surfaces_job([str(file) for file in files], None, {}), folder, form)
    return check_mould(folder)


def surface(file: Path) -> Surface:
    return solid_shapes.surface_of(*read_surface(file))


def solids(cast: CheckedCast) -> list[tuple[Surface, np.ndarray | None, bool]]:
    """Each part's surface, the direction in which it comes off, and whether it takes room in the mould."""
    return [(surface(part.file), part.comes_off, part.printed) for part in cast.parts]


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("name", BODIES)
def test_what_is_cast_is_the_body(name: str, whole: bool, tmp_path: Path, figures: Figures) -> None:
    """Without draft, the outside less all printed parts and lost cores is the body, but for the holes of pins."""
    outer, chamber = BODIES[name]()
    casts = write(tmp_path, (outer, chamber), draft=0.0, whole=whole)
    assert [problem for cast in casts for problem in cast.problems] == []
    assert [part.lost for cast in casts for part in cast.parts].count(True) == whole
    assert len(casts) == 2 - whole
    body = difference([outer, chamber], engine="manifold")
    left, holes, poured = [], 0.0, 0.0
    for cast, written in zip(casts, read_mould_record(tmp_path)["casts"], strict=True):
        printed = [its for its, _, takes in solids(cast) if takes]
        room = intersection([outer, union(printed, engine="manifold").bounding_box], engine="manifold")
        left.append(difference([room, *printed], engine="manifold"))
        holes += written["pours"][0]["mm3"] - written["body_mm3"]
        poured += written["body_mm3"]
    pins = math.pi * 1.5**2 * 6.0 if whole else 0.0
    much = sum(difference([its, body], engine="manifold").volume for its in left)
    little = difference([body, *left], engine="manifold").volume
    figures.at_most(f"silicone too much in {name} [mm^3]", much, 1e-4 * body.volume + holes)
    figures.at_most(f"silicone missing in {name} [mm^3]", little, 1e-4 * body.volume + pins)
    figures.close(f"poured for {name} [mm^3]", poured, body.volume, 1e-4 * body.volume + pins)


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("name", BODIES)
def test_parts_are_drawn_without_overlap(name: str, whole: bool, tmp_path: Path, figures: Figures) -> None:
    """With a draft of a degree, each part is moved along its direction through those that are still there."""
    casts = write(tmp_path, BODIES[name](), whole=whole)
    assert [problem for cast in casts for problem in cast.problems] == []
    for cast in casts:
        parts = solids(cast)
        for number, (part, way, _) in enumerate(parts):
            others = [its for its, _, takes in parts[number + 1 :] if takes or way is not None]
            if way is None or not others:
                continue
            lost = [surface(its.file) for its in cast.parts[number + 1 :] if its.lost]
            remaining = [its for its in others if not any(np.array_equal(its.vertices, core.vertices) for core in lost)]
            for distance in (0.1, 0.5, 2.0, 8.0, 30.0):
                moved = solid_shapes.moved(part, distance * way)
                overlap = intersection([moved, union(remaining, engine="manifold")], engine="manifold").volume
                figures.at_most(f"overlap of {name} {cast.parts[number].name}", overlap, 1e-5 * part.volume)


@pytest.mark.parametrize("aside", [0.0, 1.5, 2.6])
def test_least_wall_of_an_eccentric_tube(aside: float, tmp_path: Path, figures: Figures) -> None:
    """It is the difference of radii less the distance of the axes, and facets miss circles by R (1 - cos(pi / N))."""
    casts = write(tmp_path, fibre_tube(aside), draft=0.0)
    least = min(part.thickness for cast in casts for part in cast.parts if not part.printed)
    missed = 8.0 * (1 - math.cos(math.pi / ROUND))
    figures.close(f"wall with the bore {aside} mm aside [mm]", least, 8.0 - 5.0 - aside, missed)
    thin = [problem for cast in casts for problem in cast.problems if "too thin to fill" in problem]
    assert bool(thin) == (aside == 2.6)
    assert all("must have 0.5 mm (--skin)" in problem for problem in thin)


def test_a_skin_beside_a_bore_is_measured() -> None:
    """A bore of 2 mm below the flat top of a block leaves 0.17 mm, though flat sides have two triangles each."""
    bore = trimesh.creation.cylinder(1.0, 40.0, sections=ROUND)
    bore.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0, 1, 0)))
    block = difference([solid_shapes.box((30, 20, 20)), solid_shapes.moved(bore, (0, 0, 8.83))], engine="manifold")
    assert wall_thickness(block.triangles)[0].min() == pytest.approx(0.17, abs=1e-3)


def test_facets_are_as_fine_as_asked(tmp_path: Path, figures: Figures) -> None:
    """A ball of a STEP file: no facet of the silicone is further inside than the chord, and no vertex off the ball."""
    step = solid_shapes.write_step(tmp_path / "ball.step", lambda occ: occ.addSphere(0, 0, 0, 10))
    for chord in (0.1, 0.02):
        write_mould(geometry_job(str(step), None, {}), tmp_path, {"draft": 0.0, "chord": chord})
        silicone = surface(tmp_path / "ball-mould-cast.stl")
        below = np.abs(silicone.triangles_center[:, 0]) < 6  # away from the sprue, wherever it is along an axis
        below &= (np.abs(silicone.triangles_center) < 9.0).all(axis=1)
        inside = 10.0 - np.linalg.norm(silicone.triangles_center[below], axis=1)
        figures.at_most(f"miss of the ball for {chord} mm", float(inside.max()), chord)


def test_an_open_chamber_hangs_on_the_lid(tmp_path: Path) -> None:
    """A cup is cast at once: its core is drawn with the lid, and nothing is lost."""
    cup = difference(
        [trimesh.creation.cylinder(8, 40), solid_shapes.moved(trimesh.creation.cylinder(6, 40), (0, 0, 4))],
        engine="manifold",
    )
    (cast,) = write(tmp_path, (cup,))
    assert cast.problems == []
    assert [part.name for part in cast.parts] == ["lid", "cast", "box"]
    np.testing.assert_allclose(cast.parts[0].comes_off, [0, 0, 1])


def tilted(surface: Surface) -> Surface:
    """Turned about no axis of the file."""
    turned = surface.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(math.radians(33.0), (1, 2, 3)))
    return turned


def test_odd_bodies_are_cast_as_drawn(tmp_path: Path, figures: Figures) -> None:
    """Aslant in their file, or thin: nothing overlaps."""
    cup = difference([solid_shapes.box((40, 30, 20)), solid_shapes.box((30, 20, 20), (0, 0, 5))], engine="manifold")
    bodies = {
        "tilted block": tilted(solid_shapes.box((60, 30, 15))),
        "tilted cup": tilted(cup),
        "plate": solid_shapes.box((100, 100, 1)),
    }
    for name, body in bodies.items():
        (cast,) = write(tmp_path, (body,), draft=0.0)
        assert cast.problems == [], name
        (written,) = read_mould_record(tmp_path)["casts"]
        figures.close(f"poured for the {name} [mm^3]", written["body_mm3"], body.volume, 1e-6 * body.volume)


def test_lost_cores_side_by_side_are_both_held(tmp_path: Path, figures: Figures) -> None:
    """Their pins go to the lid beside each other; with a draft the wall of 4 mm between outside and cores stays."""
    chambers = (solid_shapes.box((20, 30, 12), (x, 0, 0)) for x in (-13.0, 13.0))
    (cast,) = write(tmp_path, (solid_shapes.box((60, 40, 20)), *chambers), whole=True)
    assert cast.problems == []
    assert [part.lost for part in cast.parts].count(True) == 2
    least = min(part.thickness for part in cast.parts if not part.printed)
    figures.close("least wall beside lost cores [mm]", least, 4.0 * math.cos(math.radians(1.0)), 1e-3)


def test_a_thin_shell_is_poured_beside_its_core(tmp_path: Path, figures: Figures) -> None:
    """The hole that a ball with a skin of 1.2 mm is poured through ends at the lost core, 2 mm below the top."""
    shells = solid_shapes.ball(15.0, parts=3), solid_shapes.ball(13.8, parts=3)
    (cast,) = write(tmp_path, shells, whole=True, draft=0.0)
    core, silicone = (surface(part.file) for part in cast.parts if part.lost or part.name == "cast")
    shared = intersection([core, silicone], engine="manifold").volume
    figures.at_most("core and silicone share [mm^3]", shared, 1e-6 * core.volume)


def test_a_body_in_metres_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"longest side = 0.04 mm: .*0.04 m are 40 mm; `--set scale=1000`"):
        write(tmp_path, (solid_shapes.box((0.04, 0.03, 0.02)),))


def test_what_cannot_be_cast_is_named_with_its_place(tmp_path: Path) -> None:
    """A pipe that turns within a block is in the way of all parts; the command says where, and its exit code is 1."""
    leg = trimesh.creation.cylinder(3.0, 30.0, sections=32)
    turned = leg.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0, 1, 0)))
    pipe = union([solid_shapes.moved(leg, (0, 0, 12)), solid_shapes.moved(turned, (12, 0, 0))], engine="manifold")
    block = difference([solid_shapes.box((40, 30, 40)), pipe], engine="manifold")
    file = solid_shapes.save(block, tmp_path / "block.stl")
    with pytest.raises(GoalMissed, match=r"undercut: .* is in its way over .* mm around \(.*\).*--parting"):
        mould([str(file)], tmp_path / "out", surfaces=True)


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ({"parting": "z=4"}, None),
        ({"parting": "w"}, "--parting w: must be an axis or a direction"),
        ({"parting": "0,0,0"}, "--parting 0,0,0: must be"),
        ({"parting": "z=nan"}, "--parting z=nan: misses the body, which reaches from -10 to 10 along z"),
        ({"parting": "z=40"}, "--parting z=40: misses the body"),
        ({"chord": 0.0}, "--chord 0: must be from 0.001 to 1"),
        ({"skin": math.nan}, "--skin nan: must be from 0 to 50"),
    ],
)
def test_options_of_a_hollow_ball(form: dict[str, Any], message: str | None, tmp_path: Path) -> None:
    """Its best mould is two halves that are glued; parted 4 mm beside its middle nothing comes off."""
    surfaces = solid_shapes.ball(10.0, parts=4), solid_shapes.ball(6.0, parts=4)
    if message is None:
        assert [problem for cast in write(tmp_path, surfaces) for problem in cast.problems] == []
        held = [part for cast in write(tmp_path, surfaces, **form) for part in cast.parts if part.undercuts]
        assert held
        assert all(abs(undercut.middle[2]) < 4.5 for part in held for undercut in part.undercuts)
    else:
        with pytest.raises(MeshError, match=message):
            write(tmp_path, surfaces, **form)
        with pytest.raises(MeshError, match="not readable"):
            mould_check(tmp_path)
