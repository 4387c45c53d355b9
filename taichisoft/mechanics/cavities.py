"""Air cavities, driven by their pressure or by how far their volume grows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.mechanics.actuator_kind import (
    ActuatorBuffers,
    ActuatorFigure,
    ActuatorKind,
    ActuatorSet,
    Drive,
    StateDrive,
    StateFigure,
    limits,
)
from taichisoft.mechanics.body_geometry import Poses
from taichisoft.mechanics.cavity_air import LineAir, Orifice, SealedAir, Tube, Valves, air_mass, tube, tube_volume
from taichisoft.mesh import surface
from taichisoft.mesh.surface import stacked

if TYPE_CHECKING:
    from taichisoft.mechanics.soft_body_arrays import SoftBody
    from taichisoft.mechanics.state import State
    from taichisoft.scene.actuators import AirLine, CavitySettings

COLLAPSE_ADVICE = "less suction, or a lowest_volume_growth or lowest_pressure of the cavity"


class Cavities(ActuatorSet):
    """All cavities in one set of arrays.

    Attributes:
        surfaces, curved: what the kernels read; without cavities their arrays are empty.
        atmosphere: absolute pressure outside [kPa].
        valves: the valves of cavities with a line.
    """

    def __init__(self, bodies: "Sequence[SoftBody]", atmosphere: float, time_step: float):
        """Lay out the arrays, for an absolute pressure outside [kPa] and a time step [s]."""
        from taichisoft.mechanics.kernels import actuator_coordinates as kernels

        found = [(body, cavity) for body in bodies for cavity in body.cavities]
        settings = [body.settings.cavities[cavity.name.partition(".")[2]] for body, cavity in found]
        tables = [(cavity.walls.nodes + body.nodes.start, cavity.walls.weights) for body, cavity in found]
        triangles = [cavity.walls.triangles for _, cavity in found]
        entries, parts = [], []
        vertex_start = np.cumsum([0, *(len(nodes) for nodes, _ in tables)])
        entry_count = 0
        for (nodes, _), first_vertex in zip(tables, vertex_start[:-1], strict=True):
            used, place = np.unique(nodes, return_inverse=True)
            vertex = np.repeat(np.arange(len(nodes)) + first_vertex, nodes.shape[1])
            parts.append(np.column_stack([place.reshape(-1) + entry_count, vertex]))
            entries.append(used)
            entry_count += len(used)
        all_parts = np.vstack([np.zeros((0, 2), dtype=np.int64), *parts])
        by_entry = np.argsort(all_parts[:, 0], kind="stable")
        shifted = [part + first for part, first in zip(triangles, vertex_start[:-1], strict=True)]
        (flat_start, flat), (curved_start, curved) = (_of_corners(shifted, corners) for corners in (3, 6))
        part_start = np.searchsorted(all_parts[by_entry, 0], np.arange(entry_count + 1))
        part_weight = np.concatenate([np.zeros(0), *(weights.reshape(-1) for _, weights in tables)])[by_entry]
        self.surfaces = kernels.CavitySurfaces(
            vertex_nodes=stacked([nodes for nodes, _ in tables]).astype(np.int32),
            vertex_weights=stacked([weights for _, weights in tables]),
            origin=np.array([part[0, 0] for part in shifted], dtype=np.int32),
            triangle_start=flat_start,
            triangles=flat,
            part_start=part_start.astype(np.int32),
            part_vertex=all_parts[by_entry, 1].astype(np.int32),
            part_weight=part_weight,
        )
        super().__init__(
            names=[cavity.name for _, cavity in found],
            rest_value=np.array([cavity.rest_volume for _, cavity in found]),
            coordinate_range=np.array(
                [limits(one.lowest_volume_growth, one.highest_volume_growth) for one in settings]
            ),
            effort_range=np.array(
                [limits(one.lowest_pressure, one.highest_pressure, unless_given=-atmosphere) for one in settings]
            ),
            soft_entries=entries,
        )
        self.atmosphere, self._settings = atmosphere, settings
        lines = {number: one.line for number, one in enumerate(settings) if one.line is not None}
        self.valves = Valves(lines, len(settings), time_step)
        self._tubes = [_tube(one.line) for one in settings]
        self.has_law = np.array([one.air != "regulated" for one in settings], dtype=bool)
        self._has_laws = bool(self.has_law.any())
        self.takes_effort = np.array([CAVITIES.effort.fits(one) for one in settings], dtype=bool)
        self._dead_volume = np.array([one.dead_volume for one in settings])
        self.rest_effort = np.array([one.shut_pressure for one in settings])
        self.curved = kernels.CurvedTriangles(
            start=curved_start,
            vertices=curved,
            weighted_shape=surface.WEIGHTS[:, None] * surface.SHAPES,
            first_slope=np.ascontiguousarray(surface.SLOPES[..., 0]),
            second_slope=np.ascontiguousarray(surface.SLOPES[..., 1]),
        )

    def why_not(self, drive: Drive, number: int) -> str:
        """The kind of air that a cavity has, where it cannot be driven so."""
        table = self._settings[number]
        if drive.fits(table):
            return ""
        constant = " with a supply of constant pressure" if table.line is not None and drive is CAVITIES.effort else ""
        return f'its air is "{table.air}"{constant}'

    def laws(self, state: "State", time_step: float) -> dict[int, SealedAir | LineAir]:
        """How the volumes of cavities with air of their own follow from its pressure."""
        return {number: self._law(number, state, time_step) for number in np.flatnonzero(self.has_law).tolist()}

    def _law(self, number: int, state: "State", time_step: float) -> SealedAir | LineAir:
        mass, rest_volume = float(state.air_mass[number]), float(self.rest_value[number])
        line = self._settings[number].line
        if line is None:
            exponent, dead_volume = self._settings[number].exponent, float(self._dead_volume[number])
            warm_space = float(state.warm_air_space[number])
            return SealedAir(rest_volume, self.atmosphere, mass, exponent, warm_space, dead_volume)
        opening, in_tube = float(state.valve_opening[number]), float(state.tube_air_mass[number])
        source = float(state.supply_pressure[number]) if opening >= 0.0 else line.exhaust
        return LineAir(
            cavity_mass=mass - in_tube,
            tube_mass=in_tube,
            valve=Orifice(abs(opening) * line.conductance, line.critical_ratio),
            source=source + self.atmosphere,
            tube=self._tubes[number],
            rest_volume=rest_volume,
            atmosphere=self.atmosphere,
            time_step=time_step,
        )

    def start(self) -> dict[str, np.ndarray]:
        """The air that is in the cavities at first, and their valves."""
        tubes = np.array([0.0 if tube is None else tube.volume for tube in self._tubes])
        in_tube = air_mass(self.rest_effort + self.atmosphere, tubes)
        space = self.rest_value + self._dead_volume
        mass = air_mass(self.rest_effort + self.atmosphere, space) + in_tube
        flow = np.zeros(len(mass))
        air = {"air_mass": mass, "tube_air_mass": in_tube, "warm_air_space": space, "air_flow": flow}
        return {**air, **self.valves.start()}

    def after(self, start: "State", effort: np.ndarray, value: np.ndarray, time_step: float) -> dict[str, np.ndarray]:
        """The air in the cavities after a step: sealed, through a valve, or as a regulator supplies it."""
        space = value + self._dead_volume
        let_in = air_mass(effort + self.atmosphere, space)
        if not self._has_laws:
            flow = (let_in - start.air_mass) / time_step
            return {"air_mass": let_in, "warm_air_space": space, "air_flow": flow}
        mass, in_tube = np.where(self.has_law, start.air_mass, let_in), start.tube_air_mass.copy()
        flow = (mass - start.air_mass) / time_step
        for number in self.valves.lines:
            law = self._law(number, start, time_step)
            assert isinstance(law, LineAir)
            flow[number], into_cavity = law.flows(float(effort[number]))
            mass[number] += time_step * flow[number]
            if law.tube is not None:
                in_tube[number] += time_step * (flow[number] - into_cavity)
        warm = np.where(self.has_law, start.warm_air_space, space)
        return {"air_mass": mass, "tube_air_mass": in_tube, "warm_air_space": warm, "air_flow": flow}

    def shapes(self, buffers: ActuatorBuffers) -> "CavityVolumes":
        """What measures their volumes."""
        return CavityVolumes(self, buffers)

    def failure(self, value: np.ndarray) -> tuple[str, str, str] | None:
        """The first cavity with a volume [mm^3] of less than nothing: that of walls which have changed sides."""
        if value.min() > 0.0:
            return None
        name, volume = self.names[int(np.argmin(value))], value.min()
        cause = f"has a collapsed cavity: the walls of '{name}' went through each other ({volume:.3g} mm^3)"
        return name, cause, COLLAPSE_ADVICE


def _of_corners(parts: list[np.ndarray], corners: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the triangles with so many vertices of each cavity begin, and these triangles."""
    some = [part if part.shape[1] == corners else np.zeros((0, corners)) for part in parts]
    start = np.cumsum([0, *(len(part) for part in some)]).astype(np.int32)
    return start, np.vstack([np.zeros((0, corners)), *some]).astype(np.int32)


class CavityVolumes:
    """Volumes of the cavities, and how they change with the nodes, at present positions."""

    def __init__(self, cavities: Cavities, buffers: ActuatorBuffers):
        from taichisoft.mechanics.kernels import actuator_coordinates as kernels

        self._surfaces, self._curved, self._kernel = cavities.surfaces, cavities.curved, kernels.volumes_and_gradients
        vertex_count = len(cavities.surfaces.vertex_nodes)
        self._volumes = kernels.CavityVolumeArrays(
            position=np.empty((vertex_count, 3)),
            area_vector=np.empty((vertex_count, 3)),
            volume=buffers.value,
            gradient=buffers.soft,
        )
        self._measured: np.ndarray | None = None
        self._node_position = np.empty((buffers.node_count, 3))

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill the volumes [mm^3] and gradients [mm^2] for node positions that stay as they are."""
        if poses.position is self._measured:
            return  # the volumes at the end of a step come with the gradients for the start of the next
        self._measured = poses.position
        self._node_position[:] = poses.position
        self._kernel(self._node_position, self._surfaces, self._curved, self._volumes)

    def coordinates(self) -> np.ndarray:
        """Volumes where they were last measured [mm^3], shape (cavity_count,)."""
        return self._volumes.volume


def _tube(line: "AirLine | None") -> Tube | None:
    if line is None or line.tube_length is None or line.tube_diameter is None:
        return None
    return Tube(tube(line.tube_length, line.tube_diameter), tube_volume(line.tube_length, line.tube_diameter))


def _has_regulator(cavity: "CavitySettings") -> bool:
    return cavity.air == "regulated" or (cavity.line is not None and cavity.line.has_regulator)


def _has_valve(cavity: "CavitySettings") -> bool:
    return cavity.air == "line"


def _has_own_air(cavity: "CavitySettings") -> bool:
    return cavity.air != "regulated"


VALVE = StateDrive(
    "valve",
    "1",
    observed="valve_openings",
    meaning="opening of the valve, mean of all cavities",
    plotted="opening of the valve [-]",
    digits=2,
    request="valve",
    rate="valve_rate",
    step=0.1,
    furthest=1.0,
    nearest=-1.0,
    more="open the valve to the source",
    less="open the valve to the exhaust",
    fits=_has_valve,
    field="valve_opening",
    matters=_has_valve,
)

CAVITIES = ActuatorKind(
    name="cavity",
    plural="cavities",
    effort=Drive(
        "pressure",
        "kPa",
        observed="pressures",
        meaning="mean of all cavities",
        plotted="pressure [kPa]",
        metric="final",
        request="pressure",
        rate="pressure_rate",
        step=1.0,
        furthest=150.0,
        more="raise the pressure",
        less="lower the pressure",
        fits=_has_regulator,
    ),
    coordinate=Drive("volume_growth", "mm^3", request="volume_growth", fits=lambda cavity: cavity.air == "regulated"),
    value=ActuatorFigure(
        "volume",
        "mm^3",
        observed="volumes",
        meaning="sum of all cavities",
        total=True,
        plotted="volume [cm³]",
        metric="final",
        plot_factor=1e-3,
    ),
    rate=ActuatorFigure(
        "flow",
        "mm^3/s",
        observed="flows",
        meaning="growth of the volume, sum of all cavities",
        total=True,
        recorded=False,
    ),
    figures=(
        StateFigure(
            "air_mass",
            "kg",
            observed="air_masses",
            meaning="air in cavities and their lines, sum of all",
            total=True,
            plotted="air [mg]",
            plot_factor=1e6,
            field="air_mass",
            matters=_has_own_air,
        ),
        StateFigure(
            "air_flow",
            "kg/s",
            observed="air_flows",
            meaning="flow of air into cavities and their lines, sum of all",
            total=True,
            plotted="flow of air [mg/s]",
            plot_factor=1e6,
            field="air_flow",
            matters=_has_own_air,
        ),
        VALVE,
    ),
    imposed="volume_imposed",
    drawn="walls",
    always_driven=True,
    make=lambda scene, soft, rigid, obstacles: Cavities(soft, scene.atmosphere, scene.time.step),
)
