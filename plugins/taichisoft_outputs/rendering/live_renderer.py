"""Pictures of a simulation while it goes on, from a worker process that stays and can neither hang nor crash it."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base import Link, Worker, WorkerLost, warn_caller
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import Actuators, State
from taichisoft.running import CameraFrame, CameraView, Renderer
from taichisoft_outputs.drawing.camera import PictureCamera, focal_length, picture_up
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.drawing.style import Style, StyleError
from taichisoft_outputs.recording.layout import QUANTITIES, group_of
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.rendering.video import (
    PICTURE_LIMIT,
    PICTURES_PER_PROCESS,
    START_LIMIT,
    RenderError,
    how_to_draw,
    record_state,
    require_open3d,
)

if TYPE_CHECKING:
    from taichisoft.contact import Model

# A state of a running simulation in the place of a recording, for what draws recordings.


class LiveRecording(Recording):
    """The recording of a single instant whose quantities are replaced by one state after the other."""

    def show(self, values: dict[str, np.ndarray]) -> None:
        """Take over a state: its fields by the paths of `layout.QUANTITIES`, in `steps` as a row of one instant."""
        self._values = values

    def _rows(self, path: str, first: int, end: int) -> np.ndarray:
        return self._values[path]


def live_values(state: State, actuators: Actuators) -> dict[str, np.ndarray]:
    """What `LiveRecording.show` takes, of a state of the model with these actuators."""
    values = {"steps/state_count": np.zeros(1, dtype=int)}
    for path, quantity in QUANTITIES.items():
        if quantity.state_field and group_of(path) in ("steps", "contacts"):
            value = np.asarray(quantity.of(state, actuators))
            values[path] = value if group_of(path) == "contacts" else value[None]
    return values


# The functions of the worker processes that draw: instants of a recording, or a run's states as they come.

ROOM = 0.4
"""Room around the first state for what moves later, in parts of its extent [-]."""


def draw_frames(link: Link) -> None:
    """Draw the instants of a recording.

    The first message is its path, a `Style`, and all instants that belong together; each further one is an instant,
    answered by its image, shape (height, width, 3), dtype uint8.
    """
    path, style, instants = link.receive()
    with read_recording(path) as recording:
        drawer = Drawer(recording, style, instants)
        while True:
            link.send(_checked(drawer.image(link.receive()), style))


def draw_states(link: Link) -> None:
    """Draw one state after the other.

    The first message is the path of a recording of one instant, a `Style`, and its values (`live_values`); each further
    one is the values of a state, the points that get a mark, and None, answered by an image as above; or
    in the place of None a camera, answered by image, depth and numbers of bodies, see `Drawer.measure`.
    """
    path, style, first = link.receive()
    with LiveRecording(Path(path)) as recording:
        recording.show(first)
        drawer = Drawer(recording, style, [0], ROOM)
        while True:
            values, marks, camera = link.receive()
            recording.show(values)
            image = _checked(drawer.image(0, marks, camera), style)
            link.send(image if camera is None else (image, *drawer.measure(0, camera)))


def _checked(image: np.ndarray, style: Style) -> np.ndarray:
    if image.shape != (style.size[1], style.size[0], 4 if style.transparent else 3) or image.dtype != np.uint8:
        raise RuntimeError(f"drew {image.shape} of {image.dtype}, not {style.size} pixels")
    return np.ascontiguousarray(image)


WORKER = "taichisoft_outputs.rendering.live_renderer:draw_states"


class LiveRenderer(Renderer):
    """Draws what a camera would see: bodies, floor and shadows, without captions, arrows and colour bars.

    A process that crashes or hangs is replaced once in a picture.
    """

    def __init__(self, model: "Model", size: tuple[int, int], camera: str | tuple[tuple[float, ...], ...]):
        """Nothing is started before the first picture.

        Args:
            size: width and height [pixels].
            camera: a view of `Style`, or the points of eye and target [mm].
        """
        require_open3d()
        self._model = model
        self._style = _style(size, camera)
        self._style.check(model.scene)
        self._process: _Process | None = None

    def picture(self, state: "State", marks: np.ndarray) -> np.ndarray:
        """Draw a state with marks at points [mm], shape (height, width, 3), dtype uint8."""
        drawn: np.ndarray = self._drawn(state, marks, None)
        return drawn

    def frame(self, state: "State", view: CameraView) -> CameraFrame:
        """What a camera sees of a state; what it sees is not antialiased in depth and segmentation."""
        backward = (view.eye - view.target) / np.linalg.norm(view.eye - view.target)
        camera = PictureCamera(view.eye, view.target, picture_up(backward, view.up))
        colour, depth, segmentation = self._drawn(state, np.zeros((0, 3)), camera)
        width, height = self._style.size
        focal = focal_length(height)
        intrinsics = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        return CameraFrame(colour, depth, segmentation, intrinsics, camera.axes * [[1.0], [-1.0], [-1.0]], view.eye)

    def _drawn(self, state: "State", marks: np.ndarray, camera: PictureCamera | None) -> Any:
        problem = ""
        if self._process is not None and self._process.drawn == PICTURES_PER_PROCESS:
            self.close()
        for _ in range(2):
            if self._process is None:
                self._process = _Process(self._model, self._style)
            try:
                return self._process.draw(state, marks, camera)
            except WorkerLost as lost:
                problem = str(lost)
                self.close()
            except TaichisoftError as error:
                self.close()
                raise RenderError(str(error)) from error
            except BaseException:  # Ctrl and c: the rest of this picture must not be taken for the next one
                self.close()
                raise
            warn_caller(f"the renderer stopped: {problem}; another takes its place")
        raise RenderError(f"no picture: {how_to_draw(problem)}")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.end()
            self._process = None


class _Process:
    """The worker process, and a folder with the recording that describes the model to it.

    Attributes:
        worker: the process.
        drawn: number of pictures that it has drawn.
    """

    def __init__(self, model: "Model", style: Style):
        self.drawn = 0
        self._actuators = model.actuators
        self._limit = START_LIMIT + PICTURE_LIMIT
        self._next_limit = PICTURE_LIMIT * max(1.0, style.size[0] * style.size[1] / 1e6)
        self._folder = TemporaryDirectory(prefix="taichisoft-renderer-")
        first = model.initial_state()
        path = record_state(Path(self._folder.name), model, first)
        self.worker = Worker(WORKER)
        self.worker.send((str(path), style, live_values(first, self._actuators)))

    def draw(self, state: "State", marks: np.ndarray, camera: PictureCamera | None) -> Any:
        """What the process answers to a state with marks and a camera; raises what `Worker.receive` raises."""
        drawn = self.worker.ask((live_values(state, self._actuators), marks, camera), self._limit)
        self._limit = self._next_limit
        self.drawn += 1
        return drawn

    def end(self) -> None:
        """End the process."""
        self.worker.end()
        self._folder.cleanup()


def _style(size: tuple[int, int], camera: str | tuple[tuple[float, ...], ...]) -> Style:
    signs = ("cavity_pressure", "cable_tension", "arrows", "axes", "body_axes", "caption")
    plain = dict.fromkeys(signs, False)
    if isinstance(camera, str):
        if camera == "orbit":
            raise StyleError("camera 'orbit' needs a whole run; there are: iso, front, top, follow:BODY, two points")
        return Style(size=size, view=camera, **plain)  # type: ignore[arg-type]
    if len(camera) != 2:
        raise StyleError(
            f"camera {camera!r}: must be the name of a view or two points, of the eye and what it looks at"
        )
    return Style(size=size, eye=camera[0], target=camera[1], **plain)  # type: ignore[arg-type]
