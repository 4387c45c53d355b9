"""Construction of a simulation from a scene: meshes are read from files, or made by plug-ins from geometries."""

import inspect
import math
import weakref
from collections.abc import Callable, Container, Hashable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from taichisoft.base.plausible import MODULUS, PRESSURE, implausible
from taichisoft.base.text import require, warn_caller
from taichisoft.contact.model import Model
from taichisoft.control.control import Control
from taichisoft.errors import MeshError, PluginError, SceneError, SimulationDiverged, TaichisoftError, nearest
from taichisoft.mechanics.cavities import CAVITIES
from taichisoft.mechanics.state import State
from taichisoft.mesh.mesh_files import VOLUME_SUFFIXES, read_volume_mesh
from taichisoft.mesh.volume_mesh import VolumeMesh
from taichisoft.running.hooks import find, provided
from taichisoft.running.plausibility import (
    MOST_HELD,
    check_plausibility,
    check_rigid_plausibility,
    say_region_volumes,
    warn_of_thin_walls,
)
from taichisoft.running.plugin_interfaces import CameraFrame, CameraView, Renderer
from taichisoft.running.plugins import failures_of
from taichisoft.scene.scene import Scene
from taichisoft.scene.soft_body import BodyMesh
from taichisoft.step.divergence import EVERY
from taichisoft.step.linearisation import Linearisation, linearise
from taichisoft.step.solution import StepReport
from taichisoft.step.time_stepper import TimeStepper

if TYPE_CHECKING:
    from PIL.Image import Image

HIGHEST_RATIO = 0.45
"""Poisson's ratio above which linear tetrahedra lock: a finger bends 21.8 mm at 0.3, 6.7 at 0.49, 2.0 at 0.499."""


class Closable(Protocol):
    """Something that is ready for use, until it is closed."""

    def close(self) -> None:
        """End it."""


class Simulation(TimeStepper):
    """A simulation of a scene, or of an existing model."""

    def __init__(self, scene: Scene | Model):
        """Start at the state that the scene describes.

        Args:
            scene: scene, of which the model is made, or a model, which other simulations may share.

        Raises:
            TaichisoftError: see `make_model`.
        """
        super().__init__(scene if isinstance(scene, Model) else make_model(scene))
        self._kept: dict[Hashable, Closable] = {}
        self._has_warned_of_unit = self._has_warned_of_rollouts = False
        weakref.finalize(self, _close_all, self._kept)
        if self.model.scene.cameras:
            mine = weakref.ref(self)
            self._observer.look = lambda state, name: _look(mine(), state, name)

    def step(self, control: Control | None = None) -> StepReport:
        """Advance by one time step; warns once where a body has left the range of its law, and of a mistaken unit.

        It is looked at after every 20th step, and after each of static dynamics.

        Raises:
            ControlError: `control` requests something impossible; nothing has changed.
            SimulationDiverged: the step failed; `state` is the state before it. Of static dynamics it is
                EquilibriumNotFound where nothing holds a body.
        """
        try:
            report = super().step(control)
        except SimulationDiverged as error:
            unit = self._mistaken_unit(error.body, control or Control())
            if unit:
                raise type(error)(
                    error.body, error.step, f"{error.cause}; {unit}", "kPa for pressures and moduli"
                ) from error
            raise
        if control is not None:
            self.warn_of_units(control)
        if self.state.step % EVERY == 0 or self._is_static:
            self.warn_beyond_law(self.state)
        return report

    def __repr__(self) -> str:
        """The scene's title, the moment, and the bodies, in one line."""
        title, names = self.model.scene.title, ", ".join(self.model.body_names)
        return f"Simulation({title!r} at step {self.state.step}, {self.state.time:.6g} s: {names})"

    def warn_of_units(self, control: Control) -> None:
        """Warn once of a pressure or modulus that was probably requested in another unit."""
        highest = max(map(abs, control.pressure.values()), default=0.0)
        if self._has_warned_of_unit or (highest <= PRESSURE.highest and not control.young_modulus):
            return
        line = implausible_request(control)
        if line:
            self._has_warned_of_unit = True
            warn_caller(line)

    def _mistaken_unit(self, body: str, control: Control) -> str:
        """Whether a pressure or modulus of a body that diverged is probably in another unit than kPa, in one line."""
        model, state = self.model, self.state
        reached = model.actuators.of(CAVITIES, np.where(state.actuator_imposed, 0.0, state.actuator_target))
        pressures = {
            name: max(abs(float(value)), abs(control.pressure.get(name, 0.0)))
            for name, value in zip(model.cavities.names, reached, strict=True)
            if name.partition(".")[0] == body
        }
        moduli = dict(zip(model.material_names, state.young_modulus.tolist(), strict=True))
        modulus, highest = moduli.get(body, math.inf), max(pressures.values(), default=0.0)
        line = implausible_request(control)
        if line or highest <= MOST_HELD * modulus:
            return line
        return (
            f"a pressure of {highest:g} kPa is {highest / modulus:.3g} times its Young's modulus, {modulus:g} kPa, "
            "more than rubber holds: is one of them in Pa or MPa?"
        )

    def warn_beyond_law(self, state: State) -> None:
        """Warn where a body is stretched beyond the range of its law in a state, unless it has done so before."""
        line = self.strain_watch.complaint(state)
        if line is not None:
            warn_caller(line)

    def warn_of_rollouts(self, line: str) -> None:
        """Warn of rollouts that left the range of a law, unless it has done so before."""
        if not self._has_warned_of_rollouts:
            self._has_warned_of_rollouts = True
            warn_caller(line)

    def render(
        self,
        camera: str | Sequence[Sequence[float]] = "iso",
        size: tuple[int, int] = (1280, 720),
        renderer: str = "open3d",
        marks: Sequence[Sequence[float]] | np.ndarray = (),
    ) -> np.ndarray:
        """Draw the present state: red, green and blue, shape (height, width, 3), dtype uint8.

        The first picture of a camera and size takes some seconds, in which the renderer starts; the renderer then stays
        ready until `close`, or until the simulation is deleted.

        Args:
            camera: "iso", "front" or "top", a fixed camera with a view of the whole initial scene; "follow:BODY", which
                moves with a body; or two points [mm]: the eye and a point at which it looks.
            size: width and height of the picture [pixels].
            renderer: name of the renderer; plug-ins provide others than "open3d".
            marks: points to mark, such as targets [mm], shape (mark_count, 3).

        Raises:
            PluginError: no renderer has this name.
            TaichisoftError: the camera or the size is not valid, or this machine cannot draw.
        """
        place = camera if isinstance(camera, str) else tuple(tuple(map(float, point)) for point in camera)
        drawing: Renderer = self.keep(
            (renderer, place, *size),
            lambda: find("renderer", renderer)(model=self.model, size=tuple(size), camera=place),
        )
        return drawing.picture(self.state, np.asarray(marks, np.float64).reshape(-1, 3))

    def show(self, camera: str | Sequence[Sequence[float]] = "iso", size: tuple[int, int] = (640, 360)) -> "Image":
        """The present state as a picture of Pillow, which notebooks show inline; arguments as of `render`.

        Raises:
            TaichisoftError: as of `render`.
        """
        require("a picture", "PIL")
        from PIL import Image

        return Image.fromarray(self.render(camera, size))

    def linearise(self, control: Control | None = None, controls: Sequence[str] | None = None) -> Linearisation:
        """Derivatives of what is observed after the step that `step(control)` would make; the simulation stays.

        They are exact as long as contacts stay open, sticking or sliding and actuators stay at the limits where they
        are. At such a change the derivative jumps, and this is the one of the side on which the step lies. What limits
        of the scene hold back has the derivative 0; a request at the end of a range, that of the side on which it is
        free. Contacts are those found in the step: their normals do not turn. In a scene of static dynamics a step is
        an equilibrium. The shift that separates overlapping surfaces is constant.

        Args:
            control: as for `step`.
            controls: names of the controls by which to derive, see `Linearisation`; None: by all that can be varied.

        Raises:
            ControlError: `control` requests something impossible, or a name in `controls` is not that of something
                which can be varied, such as the base of reduced bodies.
            SimulationDiverged: the step failed.
            SceneError: a contact in the step has restitution, spinning or rolling friction, or the scene is one of
                static dynamics with rigid bodies, whose `taichisoft.equilibrium` has derivatives.
        """
        if self.model.scene.time.dynamics == "static" and (self.model.rigid_frame < 0).any():
            raise SceneError(
                "linearise: a static step with rigid bodies has no derivative here, since where they stop depends on "
                "how they slid there; from there on, take taichisoft.equilibrium(simulation, control).linearise()"
            )
        return linearise(self, control, controls)

    def look(self, name: str, state: State | None = None, renderer: str = "open3d") -> CameraFrame:
        """What a camera of the scene sees: colour, depth, segmentation and its intrinsics.

        Args:
            name: name of the camera in the scene.
            state: a state of the model; None: the present one.
            renderer: name of the renderer.

        Raises:
            SceneError: the scene has no such camera.
            PluginError: no renderer has this name, or it has no depth.
            TaichisoftError: this machine cannot draw.
        """
        cameras, state = self.model.scene.cameras, self.state if state is None else state
        if name not in cameras:
            raise SceneError(f"cameras: there is no '{name}'; {nearest(name, list(cameras), 'there are')}")
        camera, up = cameras[name], self.model.scene.up
        eye, target = np.array(camera.eye), np.array(camera.target)
        if camera.follows is not None:
            frames = self.model.frames
            places, number = frames.places(state.frame_pose), frames.names.index(camera.follows)
            eye, target = places.moved(np.array([eye, target]), number)
            up = places.turn[number] @ up
        drawing: Renderer = self.keep(
            ("camera", renderer, *camera.size),
            lambda: find("renderer", renderer)(model=self.model, size=camera.size, camera=(camera.eye, camera.target)),
        )
        return drawing.frame(state, CameraView(eye, target, up))

    def keep(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What is kept ready under a key until `close`, such as a renderer; made on the first call."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def close(self) -> None:
        """Stop the renderers, and the threads of `rollouts`; a later call starts them again."""
        _close_all(self._kept)


def implausible_request(control: Control) -> str:
    """A line on the first pressure or modulus that was probably requested in another unit; empty without one."""
    pressures = ((f"control.pressure['{name}']", abs(value), PRESSURE) for name, value in control.pressure.items())
    moduli = ((f"control.young_modulus['{of}']", value, MODULUS) for of, value in control.young_modulus.items())
    return next(filter(None, (implausible(*quantity) for quantity in (*pressures, *moduli))), "")


def check_simulation(given: Any) -> None:
    """Check that a user gave a simulation."""
    if not isinstance(given, Simulation):
        what = type(given).__name__
        raise TaichisoftError(f"a {what} is not a simulation; taichisoft.Simulation(scene) makes one of a scene")


def _look(simulation: "Simulation | None", state: State, name: str) -> CameraFrame:
    if simulation is None:
        raise SceneError(f"camera '{name}': its simulation is gone; look while it is there")
    return simulation.look(name, state)


def _close_all(kept: dict[Hashable, Closable]) -> None:
    while kept:
        kept.popitem()[1].close()


def make_model(scene: Scene) -> Model:
    """Make the model of a scene, with the meshes that it names.

    Args:
        scene: result of `load_scene` or `scene_from_dict`.

    Raises:
        MeshError: a mesh or surface cannot be read, or cannot be simulated.
        SceneError: the scene does not fit its meshes, or bodies overlap at the start.
        PluginError: the plug-in that makes a mesh failed.
    """
    _warn_of_locking(scene)
    meshes = load_meshes(scene)
    check_plausibility(scene, meshes)
    warn_of_thin_walls(scene, meshes)
    model = Model(scene, meshes)
    say_region_volumes(scene, meshes)
    check_rigid_plausibility(model)
    return model


def _warn_of_locking(scene: Scene) -> None:
    """Warn of linear elements that lock in bending because they are nearly incompressible."""
    for name, body in scene.soft_bodies.items():
        ratio = max(body.poisson_ratios)
        if body.element == "linear" and ratio > HIGHEST_RATIO:
            warn_caller(
                f"soft_bodies.{name}.poisson_ratio = {ratio:g}: linear elements lock above {HIGHEST_RATIO:g}, "
                'and bend far too little; element = "smoothed" does not, or take a smaller one'
            )


def load_meshes(scene: Scene) -> dict[str, VolumeMesh]:
    """Read or make the mesh of each soft body, by body name; bodies with the same source share a mesh."""
    loaded: dict[str, VolumeMesh] = {}
    meshes = {}
    for name, body in scene.soft_bodies.items():
        source = body.mesh.model_dump_json()
        if source not in loaded:
            loaded[source] = load_mesh(body.mesh, f"soft_bodies.{name}.mesh")
        meshes[name] = loaded[source]
    return meshes


def load_mesh(source: BodyMesh, key: str) -> VolumeMesh:
    """Read or make one mesh; `key` is the key of the mesh in the scene."""
    file = Path(source.file)
    suffix = file.suffix.lower()
    makers = provided("mesh maker") if suffix not in VOLUME_SUFFIXES else {}
    if suffix not in makers:
        mesh = read_volume_mesh(file)
        _refuse_keys(source, (), key)
        return mesh
    make = makers[suffix]
    _refuse_keys(source, inspect.signature(make).parameters, key)
    try:
        with failures_of(f"{key}: mesh maker '{suffix}' failed on {file}"):
            mesh = make(file, **source.request)
    except MeshError as error:
        raise SceneError(f"{key}: {error}") from error
    if not isinstance(mesh, VolumeMesh):
        raise PluginError(f"{key}: mesh maker '{suffix}' returned {mesh!r}; must be a VolumeMesh")
    return mesh.check()


def _refuse_keys(source: BodyMesh, valid: Container[str], key: str) -> None:
    ignored = [name for name in source.request if name not in valid]
    if ignored:
        raise SceneError(
            f"{key}: {', '.join(ignored)} has no effect on {source.file}; remove it, or name a geometry (.toml)"
        )
