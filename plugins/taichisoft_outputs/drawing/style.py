"""What a user can choose about pictures: their size, where the camera stands, and what is shown how."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:
    from taichisoft import Scene

VIEWS = ("iso", "front", "top", "orbit", "follow:BODY")
COLOURINGS = ("none", "displacement", "stress", "strain", "contact", "body", "material")
TIP = ".tip"
"""Ends the name of a finger whose tip is followed."""
FPS = 30.0
"""Frames per second of a video, unless the user chose another number."""
TRANSLUCENT = 0.6
"""Opacity of soft bodies whose colours need not be compared with a bar."""
SMALLEST_LETTERS = 7.0
"""Height of letters that can still be read [pixels]."""
SMALLEST, LARGEST = 16, 8192
"""Least and greatest width and height that can be drawn [pixels]."""
BACKGROUND = (0.86, 0.90, 0.94)
"""Red, green and blue of the background [-] where neither the user nor the scene chose one."""


class StyleError(TaichisoftError):
    """Pictures cannot be drawn as asked."""


@dataclass(frozen=True)
class Style:
    """How instants are drawn.

    Attributes:
        size: width and height [pixels].
        view: "iso", "front" or "top" (the camera stands still), "orbit" (from iso once around the scene, in all),
            or "follow:BODY" (from iso, near that body or the tip of a finger, "follow:finger.tip", and moving
            with it); None for the scene's own camera, or iso.
        eye: position of the camera [mm], which takes the place of `view`.
        target: point that a camera at `eye` looks at [mm]; None for the middle of the scene.
        key_frames: times since the last start [s], eyes x, y, z and targets x, y, z [mm] through which the camera
            moves, in the order of time; it takes the place of `view` and `eye`.
        section: a plane that cuts bodies open, see `SectionPlane.parse`; None leaves them whole.
        opacity: opacity of the soft bodies [-], above 0 and at most 1; at 1 the cavities are hidden. None for 1 where
            their colours stand for numbers, or a section shows what is inside, else for TRANSLUCENT.
        background: red, green and blue [-], each from 0 to 1; or "#rrggbb"; a floor without a colour of its own has it
            too. None for the scene's own, and a darker floor.
        transparent: whether pictures have no background, but for shadows: they have a fourth number, the opacity.
        colour_by: what the colours of soft bodies mean: "none", "displacement" [mm], "stress" (von Mises) [kPa]
            or "strain" (the largest principal one) [-], "contact" (the pressure of contacts) [kPa]; or "body" or
            "material", of which a legend has the names.
        colour_range: values of the first and the last of these colours; None for what the drawn instants reach.
        colour_map: name of Matplotlib's that has these colours; "" for our own.
        cavity_pressure: whether cavities have the colour of their pressure.
        cable_tension: whether cables have the colour of their tension.
        arrows: whether contact forces are drawn as arrows.
        displacement_arrows: length of arrows from where points would be if bodies had kept their shape, in
            displacements [-]; None draws none.
        scale_bar: whether a bar says how long mm are at the depth of what the camera looks at, or of the section.
        axes: whether the scene's axes stand in a corner of the picture; None for what the scene says.
        body_axes: whether the axes of bodies are drawn for which the scene wants it.
        caption: whether time, pressures, tensions and the height of the rigid bodies are written in the picture.
        surface: file of a surface, usually a finer one, that is drawn for every soft body instead of its mesh's own:
            STL, OBJ or PLY, in the coordinates of the body's mesh file [mm].
        font_size: height of all letters [pixels]; None for a share of the picture's height.
        name: what the caption begins with.
        bars: whether bars say what colours mean.
        force_length: length of the arrows of forces [mm/mN]; that which suits the strongest when it is not given.
        ranges: lowest, highest and highest shown value of scales by their titles, see `Colouring.ranges`.

    Raises:
        StyleError: a value is impossible; the message says what would be valid.
    """

    size: tuple[int, int] = (1280, 720)
    view: str | None = None
    eye: tuple[float, float, float] | None = None
    target: tuple[float, float, float] | None = None
    key_frames: Sequence[Sequence[float]] = ()
    opacity: float | None = None
    background: tuple[float, float, float] | str | None = None
    transparent: bool = False
    colour_by: str = "none"
    colour_range: tuple[float, float] | None = None
    colour_map: str = ""
    cavity_pressure: bool = True
    cable_tension: bool = True
    arrows: bool = True
    displacement_arrows: float | None = None
    scale_bar: bool = False
    axes: bool | None = None
    body_axes: bool = True
    caption: bool = True
    surface: Path | None = None
    section: str | None = None
    font_size: float | None = None
    name: str = ""
    bars: bool = True
    force_length: float | None = None
    ranges: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        width, height = _numbers("size", self.size, 2)
        if not all(SMALLEST <= side <= LARGEST and side == int(side) for side in (width, height)):
            sides = f"width and height must be whole numbers from {SMALLEST} to {LARGEST} pixels"
            raise StyleError(f"size {width:g}x{height:g}: {sides}")
        self._set("size", (int(width), int(height)))
        if self.view not in (None, *VIEWS[:-1]) and not re.fullmatch("follow:.+", self.view):
            raise StyleError(f"no view is called '{self.view}'; there are: {', '.join(VIEWS)}")
        if self.opacity is not None and not 0.0 < self.opacity <= 1.0:
            raise StyleError(f"opacity {self.opacity:g} must be above 0 and at most 1")
        if self.colour_by not in COLOURINGS:
            raise StyleError(
                f"soft bodies cannot be coloured by '{self.colour_by}'; there are: {', '.join(COLOURINGS)}"
            )
        if self.colour_by == "none" and (self.colour_range is not None or self.colour_map):
            known = " or ".join(COLOURINGS[1:])
            raise StyleError(f"a colour range or map needs colours that mean something: colour by {known}")
        if self.colour_range is not None and self.colour_by in ("body", "material"):
            raise StyleError(f"colours by {self.colour_by} have names, and no colour range")
        if self.colour_range is not None:
            low, high = _numbers("colour range", self.colour_range, 2)
            if not low < high:
                raise StyleError(f"colour range {low:g}:{high:g}: the first must be below the second")
            self._set("colour_range", (low, high))
        if self.colour_map:
            _check_colour_map(self.colour_map)
        if self.font_size is not None and not SMALLEST_LETTERS <= self.font_size <= 200.0:
            raise StyleError(f"font size {self.font_size:g}: letters must be {SMALLEST_LETTERS:g} to 200 pixels high")
        if self.section is not None:
            from taichisoft.mesh import SectionPlane  # which --help need not wait for

            SectionPlane.parse(self.section)
        if self.background is not None:
            self._set("background", _colour(self.background))
        for name, point in (("eye", self.eye), ("target", self.target)):
            if point is not None:
                self._set(name, _numbers(name, point, 3))
        self._set("key_frames", tuple(_numbers("key frame", row, 7) for row in self.key_frames))
        if self.key_frames:
            self._check_key_frames()
        if self.displacement_arrows is not None and not 0.0 < self.displacement_arrows < 1e6:
            raise StyleError(
                f"displacement arrows {self.displacement_arrows:g} times as long must be above 0 and below 1e6"
            )
        if self.eye is None and self.target is not None:
            raise StyleError("target needs an eye: the views look at the middle of the scene")
        if self.eye is not None and self.eye == self.target:
            raise StyleError(f"eye and target are one point, {self.eye}: the camera would look nowhere")
        if self.surface is not None:
            self._set("surface", Path(self.surface))

    def _check_key_frames(self) -> None:
        if self.view is not None or self.eye is not None:
            raise StyleError("key frames move the camera: give neither a view nor an eye beside them")
        times = [row[0] for row in self.key_frames]
        if len(times) < 2 or any(later <= earlier for earlier, later in pairwise(times)):
            listed = ", ".join(f"{time:g}" for time in times)
            raise StyleError(f"key frames at {listed} s: there must be two or more, each later than the one before")
        for time, *points in self.key_frames:
            if points[:3] == points[3:]:
                raise StyleError(f"key frame at {time:g} s: eye and target are one point")

    @property
    def is_close_up(self) -> bool:
        """Whether the camera may leave out a part of the scene."""
        return self.eye is not None or self.followed is not None or bool(self.key_frames)

    @property
    def soft_opacity(self) -> float:
        """Opacity of the soft bodies [-]."""
        if self.opacity is not None:
            return self.opacity
        return TRANSLUCENT if self.colour_by == "none" and self.section is None else 1.0

    @property
    def followed(self) -> str | None:
        """The body, or the tip, "finger.tip", that the camera moves with; None where it does not follow one."""
        view = self.view or ""
        return view.removeprefix("follow:") if view.startswith("follow:") and self.eye is None else None

    @property
    def background_colour(self) -> tuple[float, float, float]:
        """Red, green and blue of the background [-]."""
        red, green, blue = BACKGROUND if self.background is None else _colour(self.background)
        return red, green, blue

    def for_scene(self, scene: "Scene") -> Self:
        """This style, with what a scene says of its appearance where the user chose nothing."""
        appearance = scene.appearance
        own_camera = self.view is None and self.eye is None and not self.key_frames
        return replace(
            self,
            eye=appearance.eye if own_camera else self.eye,
            target=appearance.target if own_camera else self.target,
            background=appearance.background if self.background is None else self.background,
            axes=appearance.frame if self.axes is None else self.axes,
        )

    def check(self, scene: "Scene") -> None:
        """Check that the bodies to follow and to colour are in a scene, before anything is computed or drawn.

        Raises:
            StyleError: they are not; the message says which bodies there are.
        """
        if not scene.soft_bodies and self.colour_by not in ("none", "body"):
            raise StyleError(f"colours by {self.colour_by} are of soft bodies, and there are none")
        if not scene.soft_bodies and self.displacement_arrows is not None:
            raise StyleError("displacement arrows are of soft bodies, and there are none")
        bodies = [*scene.soft_bodies, *scene.rigid_bodies]
        if self.followed is not None and self.followed not in (
            *bodies,
            *(f"{name}{TIP}" for name in scene.soft_bodies),
        ):
            known = f"{', '.join(bodies)}, and NAME{TIP}"
            raise StyleError(f"view '{self.view}': no body is called '{self.followed}'; there are: {known}")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # the class is frozen for everybody else


def parse_size(text: str) -> tuple[int, int]:
    """Width and height [pixels] from "1280x720"."""
    size = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip().lower())
    if size is None:
        raise StyleError(f"size '{text}' must be written as width x height in pixels, 1280x720")
    return int(size[1]), int(size[2])


def parse_point(name: str, text: str | None) -> tuple[float, float, float] | None:
    """A point [mm] from "300,-200,150", or None from None."""
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise StyleError(f"{name} '{text}' must be three numbers in mm, as 300,-200,150") from None
    return x, y, z


def parse_range(text: str | None) -> tuple[float, float] | None:
    """Lowest and highest value from "0:120", or None from None."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise StyleError(f"colour range '{text}' must be two numbers, as 0:120") from None
    return low, high


def read_key_frames(path: Path) -> list[list[float]]:
    """`Style.key_frames` from a CSV file; lines may begin with # and say what the columns are."""
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        rows = [line.split(",") for line in lines if not line.lstrip().startswith("#")]
        if not rows:
            raise ValueError("there is none")
        return [list(_numbers(f"{path}: line of time [s], eye and target [mm]", row, 7)) for row in rows]
    except (OSError, ValueError) as error:
        form = "lines of time [s], eye x, y, z and target x, y, z [mm] with commas between"
        raise StyleError(f"{path}: must have {form}: {error}") from None


def _check_colour_map(name: str) -> None:
    from taichisoft.base import require

    require("--colour-map", "matplotlib")
    from matplotlib import colormaps

    if name not in colormaps:
        raise StyleError(
            f"no colour map of Matplotlib is called '{name}'; there are viridis, cividis, inferno and more"
        )


def _numbers(name: str, values: Sequence[float | str], count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or not all(abs(number) < 1e9 for number in numbers):
        raise StyleError(f"{name} {values!r} must be {count} numbers")
    return numbers


def _colour(value: Sequence[float] | str) -> tuple[float, ...]:
    if isinstance(value, str):
        from taichisoft.scene import red_green_blue  # which brings pydantic, and --help need not wait for it

        try:
            return red_green_blue(f"#{value.removeprefix('#')}")  # in a shell, # may have begun a comment
        except ValueError as error:
            raise StyleError(f"background {error}") from None
    colour = _numbers("background", value, 3)
    if not all(0.0 <= part <= 1.0 for part in colour):
        raise StyleError(f"background {value!r}: red, green and blue must each be from 0 to 1")
    return colour
