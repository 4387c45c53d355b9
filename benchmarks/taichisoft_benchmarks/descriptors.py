"""What a case can say: the tables of cases.toml, checked."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from taichisoft.scenes.scene import Positive, Table

Count = Annotated[int, Field(strict=True, gt=0)]
Window = tuple[Annotated[int, Field(strict=True, ge=0)], Count]
Peer = Literal["mujoco", "mujoco_1000", "drake"]

QUICK_STEPS = 10


class Case(Table):
    """What all kinds of cases have."""

    kind: str
    title: str
    threads: Annotated[int, Field(strict=True, ge=0)] = 0
    """Threads of the engine and of numpy; 0 takes all cores."""
    time_limit: Positive = 1200.0
    """For one repetition [s]."""

    def shortened(self) -> "Case":
        """The case for a quick look."""
        return self


class Fingers(Table):
    """Where the mesh of the fingers comes from."""

    mesh: str = "tutorial-coarse"
    """Name of a shipped mesh."""
    tutorial_mesh: str | None = None
    """File in the folder given with --tutorial-meshes that takes the place of `mesh`."""
    element_size: Positive | None = None
    """[mm]; the mesh is made by the project's own mesher instead."""


class SceneCase(Case, Fingers):
    """A case about a shipped scene."""

    scene: str
    """Name of a shipped scene."""
    finger: str
    """The soft body of that scene which is given the mesh; the others are like it."""
    overrides: list[str] = Field(default_factory=list)
    """As of `taichisoft run --set`."""


class Simulated(Table):
    """A case that makes steps."""

    steps: Count
    windows: dict[str, Window] = Field(min_length=1)
    """Steps [first, last) of which each metric takes the median."""

    @model_validator(mode="after")
    def _check_windows(self) -> "Simulated":
        for metric, (first, last) in self.windows.items():
            if not first < last <= self.steps:
                raise ValueError(f"windows.{metric} = [{first}, {last}]: must rise and end within {self.steps} steps")
        return self

    def shortened(self) -> Any:
        """The same start of every window, and a few steps of it."""
        windows = {name: (first, min(last, first + QUICK_STEPS)) for name, (first, last) in self.windows.items()}
        return self.model_copy(update={"windows": windows, "steps": max(last for _, last in windows.values())})


class StepsCase(Simulated, SceneCase):
    """Time per step of a scene."""

    kind: Literal["steps"]
    peers: list[Peer] = Field(default_factory=list)
    """Other programs that do the part of the job that they can, each as a case NAME_PEER."""
    peer_steps: Count | None = None
    """Where the other programs stop, before the base moves; they measure the windows that end by then."""


class PeerCase(StepsCase):
    """The same on another program; made from `peers`, not written in cases.toml."""

    peer: Peer


class PluginsCase(Simulated, SceneCase):
    """What hooks and the controller's observation add to a step of a scene."""

    kind: Literal["plugins"]


class ContactsCase(Simulated, Case):
    """Time per step of a soft mat that stands on a foot of `foot` x `foot` vertices; the mesh is always the same."""

    kind: Literal["contacts"]
    foot: Annotated[int, Field(strict=True, ge=2, le=28)]


class FingersCase(Simulated, Case, Fingers):
    """Time per step of `count` fingers on a circle."""

    kind: Literal["fingers"]
    count: Count


class FactorisationCase(SceneCase):
    """The sparse Cholesky alone, and CHOLMOD and SuperLU on the same matrix in turns with it."""

    kind: Literal["factorisation"]
    rounds: Count

    def shortened(self) -> "FactorisationCase":
        """Few rounds."""
        return self.model_copy(update={"rounds": min(self.rounds, 5)})


class StartCase(SceneCase):
    """From the start of Python to the first step of a scene."""

    kind: Literal["start"]
    cold: bool = False
    """With an empty cache of compiled kernels."""


class MeshingCase(Case):
    """gmsh on the tutorial's finger."""

    kind: Literal["meshing"]
    element_size: Positive | None = None
    """[mm]; either this or `preset`."""
    preset: str | None = None
    """Name of one of the finger's sizes."""

    @model_validator(mode="after")
    def _check_size(self) -> "MeshingCase":
        self.require_one_of("element_size", "preset")
        return self


class RenderingCase(SceneCase):
    """A video of the scene, drawn without a display."""

    kind: Literal["rendering"]
    steps: Count
    frames: Annotated[int, Field(strict=True, ge=2)]
    """How many of the steps are drawn, evenly apart, beside the state before the first one."""

    @model_validator(mode="after")
    def _check_frames(self) -> "RenderingCase":
        if self.steps % self.frames:
            raise ValueError(f"steps = {self.steps}: must be a multiple of frames = {self.frames}")
        return self

    def shortened(self) -> "RenderingCase":
        """Few frames, of the same moments."""
        few = next(count for count in range(min(self.frames, QUICK_STEPS), 0, -1) if self.steps % count == 0)
        return self.model_copy(update={"frames": few})


class RecordingCase(SceneCase):
    """What recording a scene adds to its steps; steps without and with it in turns."""

    kind: Literal["recording"]
    steps: Count
    pairs: Count

    def shortened(self) -> "RecordingCase":
        """A single pair of a few steps."""
        return self.model_copy(update={"steps": min(self.steps, QUICK_STEPS), "pairs": 1})


class WebCase(SceneCase):
    """A web page beside a scene that runs at the speed of real time; runs without and with it in turns."""

    kind: Literal["web"]
    steps: Count
    pairs: Count

    def shortened(self) -> "WebCase":
        """A single pair."""
        return self.model_copy(update={"pairs": 1})


KINDS: dict[str, type[Case]] = {
    "steps": StepsCase,
    "plugins": PluginsCase,
    "contacts": ContactsCase,
    "fingers": FingersCase,
    "factorisation": FactorisationCase,
    "start": StartCase,
    "meshing": MeshingCase,
    "rendering": RenderingCase,
    "recording": RecordingCase,
    "web": WebCase,
}
