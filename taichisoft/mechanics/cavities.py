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
from taichisoft.mechanics.air_network import AirLaw, AirNetwork
from taichisoft.mechanics.body_geometry import Poses
from taichisoft.mechanics.cavity_air import Response, air_mass
from taichisoft.mesh import surface
from taichisoft.mesh.surface import stacked

if TYPE_CHECKING:
    from taichisoft.mechanics.soft_body_arrays import SoftBody
    from taichisoft.mechanics.state import State
    from taichisoft.scene.actuators import CavitySettings
    from taichisoft.scene.air import AirNetworkSettings

COLLAPSE_ADVICE = "less suction, or a lowest_volume_growth or lowest_pressure of the cavity"


class Cavities(ActuatorSet):
    """All cavities in one set of arrays.

    Attributes:
        surfaces, curved: what the kernels read; without cavities their arrays are empty.
        atmosphere: absolute pressure outside [kPa].
        air_lines: supplies of cavities that have one of their own, by number of the cavity.
        network: what joins the cavities that have air of their own.
    """

    def __init__(self, bodies: "Sequence[SoftBody]", atmosphere: float, time_step: float, air: "AirNetworkSettings"):
        """Lay out the arrays, for an absolute pressure outside [kPa], a time step [s], and the scene's table `air`."""
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
        self.air_lines = {number: one.line for number, one in enumerate(settings) if one.line is not None}
        self._responses = {
            number: Response.of(line.delay, line.response_time, line.period, time_step)
            for number, line in self.air_lines.items()
        }
        self.network = AirNetwork(dict(zip(self.names, settings, strict=True)), air, atmosphere, time_step)
        self.has_law = np.array([one.air != "regulated" for one in settings], dtype=bool)
        self._has_laws = bool(self.has_law.any())
        self.takes_effort = np.array([CAVITIES.effort.fits(one) for one in settings], dtype=bool)
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

    def elsewhere(self, drive: Drive) -> tuple[str, ...]:
        """Valves and regulators of the network that the scene's table `air` describes."""
        return {VALVE: self.network.valves, CAVITIES.effort: self.network.regulators}.get(drive, ())

    def law(self, state: "State") -> AirLaw | None:
        """How the volumes of cavities with air of their own follow from their pressures."""
        return self.network.law(state, self.rest_value) if self._has_laws else None

    def start(self) -> dict[str, np.ndarray]:
        """The air that is in the cavities at first, and their valves: a regulator's is open, others are closed."""
        opening, supply = np.zeros(len(self.names)), np.zeros(len(self.names))
        for number, line in self.air_lines.items():
            opening[number], supply[number] = (1.0, 0.0) if line.supply is None else (0.0, line.supply)
        network = self.network.start(self.rest_effort)
        longest = max((one.delay for one in self._responses.values()), default=0)
        space = self.rest_value + self.network.dead_volume
        return {
            "air_mass": air_mass(self.rest_effort + self.atmosphere, space) + network["tube_air_mass"],
            "warm_air_space": space,
            "air_flow": np.zeros(len(self.names)),
            "valve_request": opening,
            "valve_opening": opening.copy(),
            "supply_pressure": supply,
            "delayed_requests": np.zeros((len(self.names), longest)),
            **network,
        }

    def valves_moved(self, state: "State", pressure: np.ndarray, request: np.ndarray) -> dict[str, np.ndarray]:
        """Valves and regulators of lines in the step that begins, by the pressures and openings requested."""
        opening, supply = state.valve_opening.copy(), state.supply_pressure.copy()
        waiting = state.delayed_requests.copy()
        for number, line in self.air_lines.items():
            values, targets = (supply, pressure) if line.has_regulator else (opening, request)
            values[number] = self._responses[number].moved(
                float(values[number]), float(targets[number]), waiting[number], state.step
            )
            if line.has_regulator:
                opening[number] = request[number]
        return {
            "valve_request": request,
            "valve_opening": opening,
            "supply_pressure": supply,
            "delayed_requests": waiting,
        }

    def after(self, start: "State", effort: np.ndarray, value: np.ndarray, time_step: float) -> dict[str, np.ndarray]:
        """The air in the cavities after a step: as their network leaves it, or as a regulator supplies it."""
        space = value + self.network.dead_volume
        mass, law = air_mass(effort + self.atmosphere, space), self.law(start)
        if law is None:
            return {"air_mass": mass, "warm_air_space": space, "air_flow": (mass - start.air_mass) / time_step}
        fields = self.network.after(start, law, effort, mass)
        warm = np.where(self.has_law, start.warm_air_space, space)
        return {"air_mass": mass, "warm_air_space": warm, "air_flow": (mass - start.air_mass) / time_step, **fields}

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


def _has_regulator(cavity: "CavitySettings") -> bool:
    return cavity.air == "regulated" or (cavity.line is not None and cavity.line.has_regulator)


def _has_valve(cavity: "CavitySettings") -> bool:
    return cavity.line is not None


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
    elsewhere="network_openings",
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
        elsewhere="network_pressures",
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
    make=lambda scene, soft, rigid, obstacles: Cavities(soft, scene.atmosphere, scene.time.step, scene.air),
)


def network_drives(air: "AirNetworkSettings") -> dict[str, Drive]:
    """By the names of valves and regulators of a scene's table `air`, as what requests drive them."""
    return {name: VALVE if name in air.valves else CAVITIES.effort for name in air.drives}
