"""Checks for implausible numbers in a scene: mostly mistaken units; far outside the range they are errors."""

import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from taichisoft.base.plausible import (
    DENSITY,
    DURATION,
    FIBRE_MODULUS,
    GRAVITY,
    MODULUS,
    PRESSURE,
    SIZE,
    SOFT_DENSITY,
    TIME_STEP,
    Plausible,
    implausible,
)
from taichisoft.base.text import warn_caller, warn_caller_once
from taichisoft.contact.model import Model
from taichisoft.errors import SceneError
from taichisoft.mechanics.selection import select_elements
from taichisoft.mesh.mesh_files import VOLUME_SUFFIXES
from taichisoft.mesh.surface import enclosed_volume, joined_pieces
from taichisoft.mesh.volume_mesh import (
    ADVICE,
    TOO_STIFF,
    VolumeMesh,
    element_volumes,
    share_of_thin_walls,
    share_without_nodes_inside,
    too_stiff,
)
from taichisoft.scene.scene import Scene
from taichisoft.scene.shipped import data_folder
from taichisoft.scene.soft_body import SoftBodySettings

LOGGER = logging.getLogger("taichisoft.running")

MOST_THIN = 0.05
"""Share of a cavity's area with a wall of one element, up to which no warning is given [-]."""
MOST_WITHOUT_INSIDE = 0.75
"""The same of the volume of a body in elements without a node inside it."""
NEGLIGIBLE = 1e-9
"""Young's modulus up to which elements only carry a body's springs [kPa]."""
LOCKING_RATIO = 0.4
"""Poisson's ratio above which smoothed elements are warned of on any mesh, since walls of one element lock."""

MOST_HELD = 5.0 / 6.0
"""Pressure over Young's modulus from which a cavity in rubber grows on and on [-]."""

ABSURD = 1e9
"""Factor beyond the plausible range at which a number is refused: no mistaken unit leads that far."""

PRESSURE_KEYS = ("pressure", "lowest_pressure", "highest_pressure", "shut_pressure", "supply", "exhaust")
"""Keys of cavities, of their lines, and of sources and tanks that are pressures."""

MASS_FACTOR = {"g": 1e-3, "mg": 1e-6}
"""Kilograms per unit in which masses are mistakenly given."""


def check_plausibility(scene: Scene, meshes: Mapping[str, VolumeMesh]) -> None:
    """Warn of implausible numbers, with the unit that was probably meant, and of meshes of several pieces."""
    for key, value, plausible in _quantities(scene, meshes):
        _check(key, value, plausible)
    for name, body in scene.soft_bodies.items():
        _check_shut_pressures(name, body)
        mesh = meshes[name]
        if body.density is None and body.mass is not None:
            volume = float(element_volumes(mesh.nodes, mesh.elements).sum())
            _check_mass(f"soft_bodies.{name}.mass", body.mass, volume, SOFT_DENSITY)
        count = _piece_count(mesh.elements)
        if count > 1:
            warn_caller(f"soft_bodies.{name}.mesh: has {count} pieces that nothing holds together")


def _highest_pressure(key: str, table: object) -> tuple[str, float, Plausible]:
    """Of several pressures in one unit the highest alone."""
    pressures = {field: abs(getattr(table, field, None) or 0.0) for field in PRESSURE_KEYS}
    highest = max(pressures, key=pressures.__getitem__)
    return f"{key}.{highest}", pressures[highest], PRESSURE


def _quantities(scene: Scene, meshes: Mapping[str, VolumeMesh]) -> Iterator[tuple[str, float, Plausible]]:
    """Key, value and plausible range of the numbers that are checked; zeros and infinite durations are left out."""
    yield "time.step", scene.time.step, TIME_STEP
    if math.isfinite(scene.time.duration):
        yield "time.duration", scene.time.duration, DURATION
    if any(scene.gravity):
        yield "gravity", math.hypot(*scene.gravity), GRAVITY
    for name in ("highest_pressure", "lowest_pressure"):
        yield f"limits.{name}", abs(getattr(scene.limits, name) or 0.0), PRESSURE
    for material, modulus in scene.young_moduli.items():
        if modulus > NEGLIGIBLE:
            yield f"soft_bodies.{material}.young_modulus", modulus, MODULUS
    for kind, tables in (("sources", scene.air.sources), ("tanks", scene.air.tanks)):
        for name, table in tables.items():
            yield _highest_pressure(f"air.{kind}.{name}", table)
    for name, body in scene.soft_bodies.items():
        key = f"soft_bodies.{name}"
        for cavity, cavity_table in body.cavities.items():
            yield _highest_pressure(f"{key}.cavities.{cavity}", cavity_table)
            yield _highest_pressure(f"{key}.cavities.{cavity}.line", cavity_table.line)
        for kind in ("membranes", "fibres"):
            for name_of_part, layer in getattr(body, kind).items():
                yield f"{key}.{kind}.{name_of_part}.young_modulus", layer.young_modulus, FIBRE_MODULUS
        yield f"{key}.mesh: its longest side", float(np.ptp(meshes[name].nodes, axis=0).max()), SIZE
        if body.density is not None:
            yield f"{key}.density", body.density, SOFT_DENSITY


def _check_shut_pressures(name: str, body: SoftBodySettings) -> None:
    """Warn of shut air that no rubber holds: around a cavity in a solid of modulus E it is 5/6 E, in walls it is less.

    Gent and Lindley 1959, Internal rupture of bonded rubber cylinders in tension.
    """
    modulus = max(body.young_moduli)
    for cavity, table in body.cavities.items():
        if table.shut_pressure > MOST_HELD * modulus:
            warn_caller(
                f"soft_bodies.{name}.cavities.{cavity}.shut_pressure = {table.shut_pressure:g} kPa: no rubber with a "
                f"Young's modulus of {modulus:g} kPa holds more than {MOST_HELD * modulus:.3g} kPa; the cavity bursts "
                "open in the first step, and steps with so many contacts may take minutes"
            )


def warn_of_thin_walls(scene: Scene, meshes: Mapping[str, VolumeMesh]) -> None:
    """Warn once for each mesh that its walls are one element thick; of what is meshed for the scene, meshing does.

    Of shipped meshes always, of others where the smoothed elements of a body that is hardly compressible lock.
    """
    warned, shipped = set(), data_folder() / "meshes"
    for name, body in scene.soft_bodies.items():
        mesh, file, ratio = meshes[name], Path(body.mesh.file), max(body.poisson_ratios)
        locks = body.element == "smoothed" and ratio > LOCKING_RATIO and file.suffix.lower() in VOLUME_SUFFIXES
        if mesh.source in warned or body.element == "quadratic" or not (locks or file.parent == shipped):
            continue
        groups = [group for group in _cavity_groups(body) if group in mesh.surface_groups]
        shares = {group: share_of_thin_walls(mesh, mesh.surface_groups[group]) for group in groups}
        thin = [f"{group} ({share:.0%} of the area)" for group, share in shares.items() if share > MOST_THIN]
        if not thin and locks and (share := share_without_nodes_inside(mesh)) > MOST_WITHOUT_INSIDE:
            thin = [f"{share:.0%} of the volume has no node inside"]
        if thin:
            warned.add(mesh.source)
            effect = too_stiff(ratio) if body.element == "smoothed" else TOO_STIFF
            warn_caller_once(f"soft_bodies.{name}.mesh: {effect}: {', '.join(thin)}; {ADVICE}")


def _cavity_groups(body: SoftBodySettings) -> list[str]:
    return [cavity.group for cavity in body.cavities.values() if cavity.group is not None]


def say_region_volumes(scene: Scene, meshes: Mapping[str, VolumeMesh]) -> None:
    """Log the volume of the elements in each box of a region: on a coarse mesh it may differ much from the box's."""
    logged = set()
    for name, body in scene.soft_bodies.items():
        mesh = meshes[name]
        volumes = element_volumes(mesh.nodes, mesh.elements)
        for index, region in enumerate(body.regions):
            key = f"soft_bodies.{name}.regions.{index}"
            if region.box is None or (mesh.source, region.box) in logged:
                continue
            logged.add((mesh.source, region.box))
            caught = select_elements(mesh, region, key)
            LOGGER.info(
                "%s.box: %d of %d elements, %.0f of %.0f mm^3; the box has %.0f mm^3",
                key,
                len(caught),
                len(volumes),
                volumes[caught].sum(),
                volumes.sum(),
                float(np.prod(np.abs(np.subtract(*region.box)))),
            )


def check_rigid_plausibility(model: Model) -> None:
    """Check rigid bodies and obstacles likewise, whose masses and surfaces are computed."""
    for obstacle in model.obstacles:
        if obstacle.vertices is not None:
            side = float(np.ptp(obstacle.vertices, axis=0).max())
            _check(f"obstacles.{obstacle.name}: its longest side", side, SIZE)
    for body in model.rigid_bodies:
        key, table = f"rigid_bodies.{body.name}", model.scene.rigid_bodies[body.name]
        _check(f"{key}: its longest side", float(np.ptp(body.vertices, axis=0).max()), SIZE)
        if table.follows is not None:
            continue
        volume = enclosed_volume(body.vertices, body.triangles)
        if table.density is not None:
            _check(f"{key}.density", table.density, DENSITY)
        else:
            _check_mass(f"{key}.mass", body.mass, volume, DENSITY)
        count = _piece_count(body.triangles)
        if count > 1:
            warn_caller(f"{key}.surface: has {count} pieces; they move as one body, and hollows count as solid")


def _check(key: str, value: float, plausible: Plausible) -> None:
    line = implausible(key, value, plausible)
    if line and not plausible.lowest / ABSURD <= value <= plausible.highest * ABSURD:
        raise SceneError(line)
    if line:
        warn_caller(line)


def _check_mass(key: str, mass: float, volume: float, density: Plausible) -> None:
    """Check a mass by the resulting density."""
    if density.lowest <= mass / volume <= density.highest:
        return
    line = (
        f"{key} = {mass:g} kg: makes {mass / volume:.3g} kg/mm^3 of {volume:.3g} mm^3, where {density.lowest:g} to "
        f"{density.highest:g} are usual (water has 1e-06)"
    )
    for unit, factor in MASS_FACTOR.items():
        if density.lowest <= mass * factor / volume <= density.highest:
            line += f"; {mass:g} {unit} are {mass * factor:g} kg"
            break
    if not density.lowest / ABSURD <= mass / volume <= density.highest * ABSURD:
        raise SceneError(line)
    warn_caller(line)


def _piece_count(cells: np.ndarray) -> int:
    """Number of connected parts of a mesh; `cells` are node indices, shape (count, nodes)."""
    pairs = cells[:, [[0, k] for k in range(1, cells.shape[1])]].reshape(-1, 2)
    return len(np.unique(joined_pieces(cells.max() + 1, pairs)[cells]))
