"""Soft bodies as a user describes them: mesh, materials, anchors."""

from collections import Counter
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, field_validator, model_serializer, model_validator

from taichisoft.scene.actuators import ActuatorTables
from taichisoft.scene.material import (
    ELASTICITY,
    Law,
    Material,
    check_coefficients,
    initial_shear_modulus,
    with_material,
)
from taichisoft.scene.sensor_settings import TactileArray
from taichisoft.scene.table import (
    Colour,
    Count,
    Direction,
    Groups,
    KeySets,
    Name,
    NodeNumber,
    NotNegative,
    Number,
    PoissonRatio,
    Positive,
    Rule,
    Table,
    Vector,
)

# Membranes, fibres and springs of a soft body as a user describes them: things that resist stretch, but not bending.

MOST_PIECES = 100_000
"""Straight pieces of a helix's fibres in all: far more than windings have, and some seconds to lay out."""


class MembraneSettings(Table):
    """A thin sheet on or in a soft body, such as paper or a woven fabric: it resists stretch, and bends freely."""

    group: str
    """Name of the mesh's surface group that it covers."""
    thickness: Positive
    """Its thickness [mm]."""
    young_modulus: Positive
    """Young's modulus [kPa]; paper has some 3e6."""
    poisson_ratio: Annotated[float, Field(strict=True, ge=0.0, lt=1.0, allow_inf_nan=False)] = 0.0
    """Poisson's ratio within the sheet [-]."""
    directions: Annotated[list[Direction], Field(max_length=2)] = []
    """Directions of its threads, one or two, in the mesh's own axes; it resists stretch along them alone, each with
    thickness and young_modulus. Without any it resists in all directions."""

    tension_only: Annotated[bool, Field(strict=True)] = False
    """Whether it wrinkles where it would be compressed, and carries nothing there, as paper and fabric that nothing
    keeps flat; otherwise it resists compression as it resists tension, as in silicone that keeps it from buckling."""
    no_effect_beside: ClassVar = {"directions": ("poisson_ratio",)}

    @model_validator(mode="after")
    def _check_directions(self) -> Self:
        if len(self.directions) == 2 and not np.cross(*np.array(self.directions)).any():
            raise ValueError("directions has two along one line; threads of twice the thickness are one direction")
        return self


class Helix(Table):
    """Fibres wound around an axis."""

    start: Vector
    """A point of the axis, where the fibres begin, in the mesh's own coordinates [mm]."""
    end: Vector
    """The point of the axis where they end [mm]."""
    radius: Positive
    """Distance of the fibres from the axis [mm]."""
    angle: Annotated[float, Field(strict=True, gt=0.0, lt=90.0)]
    """Angle between the fibres and the axis [degrees]; a cylinder with both hands of 54.7 keeps its shape under
    pressure, a smaller angle shortens it, a larger one makes it longer."""
    hand: Literal["right", "left", "both"] = "both"
    """Sense of the winding; fibres of one hand twist the body."""
    count: Count = 1
    """Fibres of each hand, evenly around the axis."""
    spacing: Positive | None = None
    """Length of the straight pieces [mm], at least six a turn; a third of the radius when it is not given."""
    rules = (
        Rule("start != end", "start and end are the same point; they give the axis"),
        Rule(
            "spacing <= radius / sin(radians(angle))",
            "spacing = {spacing:g} must be at most {radius / sin(radians(angle)):.4g} mm, six pieces a turn: longer "
            "ones leave the helix",
        ),
        Rule(
            f"piece_count * fibre_count <= {MOST_PIECES}",
            f"asks for {{piece_count * fibre_count:.0f}} straight pieces, at most {MOST_PIECES}; give a longer spacing",
        ),
    )

    @property
    def fibre_count(self) -> int:
        """Number of fibres of all hands."""
        return self.count * (2 if self.hand == "both" else 1)

    @property
    def piece_count(self) -> float:
        """Straight pieces of each fibre, a whole number."""
        wound = np.linalg.norm(np.subtract(self.end, self.start)) / np.cos(np.radians(self.angle))
        return float(np.ceil(wound / (self.spacing or self.radius / 3.0)))

    def lines(self) -> list[np.ndarray]:
        """The points of each fibre in the mesh's own coordinates [mm], each of shape (point_count, 3)."""
        start = np.array(self.start)
        along = np.array(self.end) - start
        length = float(np.linalg.norm(along))
        along /= length
        aside = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        aside /= np.linalg.norm(aside)
        across = np.cross(along, aside)
        share = np.linspace(0.0, 1.0, int(self.piece_count) + 1)[:, None]
        turn = share * length * np.tan(np.radians(self.angle)) / self.radius
        found = []
        for sense in {"right": [1.0], "left": [-1.0], "both": [1.0, -1.0]}[self.hand]:
            for first in 2.0 * np.pi * np.arange(self.count) / self.count:
                angle = first + sense * turn
                ring = np.cos(angle) * aside + np.sin(angle) * across
                found.append(start + share * length * along + self.radius * ring)
        return found


class FibreSettings(Table):
    """Fibres that are glued to a soft body along lines: they resist stretch, and bend freely."""

    points: Annotated[list[Vector], Field(min_length=2)] | None = None
    """Points of a line in the mesh's own coordinates [mm]."""
    helix: Helix | None = None
    """Lines around an axis."""
    diameter: Positive
    """Diameter of a fibre [mm]."""
    young_modulus: Positive
    """Young's modulus [kPa]; aramid has 1e8."""
    alternatives: ClassVar[KeySets] = (("points", "helix"),)

    def lines(self) -> list[np.ndarray]:
        """The points of each line in the mesh's own coordinates [mm], each of shape (point_count, 3)."""
        return [np.array(self.points)] if self.helix is None else self.helix.lines()


OfEach = Annotated[list[NotNegative], BeforeValidator(lambda value: [value] if np.ndim(value) == 0 else value)]
"""A number of all springs, or one of each."""


class SpringSettings(Table):
    """Straight springs between nodes of a soft body: the tension is stiffness times stretch, however far they turn."""

    nodes: Annotated[list[tuple[NodeNumber, NodeNumber]], Field(min_length=1)]
    """Numbers of the two nodes of each spring, from 0 in the order of the mesh."""
    stiffness: OfEach
    """Stiffness of all springs, or of each [mN/mm]."""
    length: OfEach | None = None
    """Length at rest of all springs, or of each [mm]; the distance of their nodes in the mesh when it is not given."""
    damping: OfEach = [0.0]
    """Resistance to the speed of stretch of all springs, or of each [mN s/mm]."""
    tension_only: Annotated[bool, Field(strict=True)] = False
    """Whether they hang loose where they are shorter than at rest."""

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        for name in ("stiffness", "length", "damping"):
            if (values := getattr(self, name)) is not None and len(values) not in (1, len(self.nodes)):
                raise ValueError(f"{name} has {len(values)} numbers for {len(self.nodes)} springs")
        if same := [first for first, second in self.nodes if first == second]:
            raise ValueError(f"nodes joins node {same[0]} to itself")
        return self


class Selection(Table):
    """Nodes or elements of a soft body, by a box in the mesh's own coordinates or by a group of the mesh."""

    box: tuple[Vector, Vector] | None = None
    """Lower and upper corner [mm]; an element belongs when the mean of its nodes lies inside."""
    group: str | None = None
    """Name of an element group or surface group of the mesh."""
    alternatives: ClassVar[KeySets] = (("box", "group"),)

    @model_validator(mode="after")
    def _check_box(self) -> Self:
        if self.box is not None and any(low > high for low, high in zip(*self.box, strict=True)):
            corners = " and ".join(str(list(corner)) for corner in self.box)
            raise ValueError(f"the first corner of a box must be below the second in x, y and z; they are {corners}")
        return self


class NodeSelection(Selection):
    """Nodes of a soft body, by box, by group or by their numbers."""

    nodes: Annotated[list[NodeNumber], Field(min_length=1)] | None = None
    """Numbers of the nodes, from 0 in the order of the mesh."""
    alternatives: ClassVar[KeySets] = (("box", "group", "nodes"),)

    @model_validator(mode="after")
    def _check_nodes(self) -> Self:
        for node, count in Counter(self.nodes or []).items():
            if count > 1:
                raise ValueError(f"nodes names node {node} {count} times; name every node once")
        return self


class Region(Selection):
    """Elements of another material; a later region wins over an earlier one."""

    material: Material | None = None
    """Name of a material, as for the body; instead of law, young_modulus and coefficients."""
    young_modulus: Positive | None = None
    """Young's modulus [kPa]; either this or coefficients."""
    poisson_ratio: PoissonRatio | None = None
    """Poisson's ratio [-]; the body's own when it is not given."""
    law: Law | None = None
    """Law of elasticity; the body's own when it is not given."""
    coefficients: dict[str, Number] | None = None
    """Coefficients of the law, as for the body."""
    alternatives = (("box", "group"), ("young_modulus", "coefficients"))

    @model_validator(mode="before")
    @classmethod
    def _take_material(cls, value: Any) -> Any:
        return with_material(value, (*ELASTICITY, "poisson_ratio"))


class Anchor(NodeSelection):
    """Nodes held by stiff springs to their rest positions, which move with a frame."""

    follows: str | None = None
    """Frame that the nodes move with, and that feels what pulls at them; that of the body when it is not given."""
    stiffness: Positive = 1e12
    """Stiffness of the spring of each node [mN/mm]."""
    directions: Annotated[list[Literal["x", "y", "z"]], Field(min_length=1)] = ["x", "y", "z"]
    """Axes of space along which the nodes are held; along the others they move freely."""


class NodalForce(NodeSelection):
    """A constant force on nodes, such as the weight of something that is not simulated."""

    force: Vector
    """Sum of the forces on the nodes, in the axes of space [mN]; each node has an equal share."""


class Tip(NodeSelection):
    """Nodes whose motion is observed as that of the tip; without this table those farthest from the anchors."""


class BodyMesh(Table):
    """The source of a soft body's mesh; `mesh = "FILE"` is short for a table with nothing but `file`."""

    file: str
    """A mesh (.msh, .vtk, .vtu), or a geometry (.toml, .step) that is meshed on first use; or the name of a shipped
    one."""
    size: Positive | None = None
    """Largest element of a geometry's mesh [mm]; the geometry's own when neither it nor preset or nodes is given."""
    preset: str | None = None
    """Name of one of the geometry's sizes, such as "coarse", "medium" or "fine"."""
    nodes: Annotated[int, Field(strict=True, gt=0)] | None = None
    """Number of nodes that the geometry's mesh should have, roughly."""
    order: Literal[1, 2] | None = None
    """Order of the elements of a geometry's mesh: 2 for sides that follow curved surfaces, with
    `element = "quadratic"`."""
    set: dict[str, Any] = {}
    """Values to take instead of the geometry's own: { chambers.height = 12.0 }."""

    @model_validator(mode="before")
    @classmethod
    def _read_text(cls, value: Any) -> Any:
        if not isinstance(value, str | dict | cls):
            raise ValueError(f"{value!r} must be the name of a file, or a table with the key file")
        return {"file": value} if isinstance(value, str) else value

    no_effect_beside: ClassVar = {"size": ("preset", "nodes"), "preset": ("nodes",)}

    @model_serializer
    def _write_short(self) -> Any:
        """The file alone where no other key is given."""
        return {"file": self.file, **self.request} if self.request else self.file

    @property
    def request(self) -> dict[str, Any]:
        """Keys that are given beside the file."""
        given = {key: getattr(self, key) for key in ("size", "preset", "nodes", "order", "set")}
        return {key: value for key, value in given.items() if value not in (None, {})}


class CollisionSurfaceSettings(Table):
    """A surface that touches other bodies; `collision_surface = "FILE"` is short for a single one without groups.

    Without any it is the mesh's outer boundary.
    """

    file: str
    """A closed surface file that follows the mesh."""
    open: bool = False
    """Whether the surface may have open edges; it touches what is on the side that it faces."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other; all others do, also two of the same body."""


class SoftBodySettings(ActuatorTables):
    """A silicone body of corotational finite elements."""

    mesh: BodyMesh
    """Mesh of the body: a file's name, or the table [soft_bodies.NAME.mesh]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Placement: turns about the x, y and z axes, in this order [degrees]."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Placement: shift after the rotation [mm]."""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of all nodes at the start [mm/s]."""
    element: Literal["linear", "smoothed", "hexahedral", "quadratic"] = "smoothed"
    """What the tetrahedra of the mesh become: linear elements, which are cheap, but bend too little and lock where
    Poisson's ratio comes near 0.5; linear ones whose strains are smoothed around edges and nodes, which do neither;
    quadratic ones, the most accurate. In a mesh of hexahedra each is six tetrahedra, which may become one hexahedral
    element instead."""
    material: Material | None = None
    """Name of a material (`taichisoft materials` lists them), or a file (.toml); instead of law, young_modulus and
    coefficients. What it says
    of density and Poisson's ratio gives way to these keys."""
    mass: Positive | None = None
    """Mass [kg], spread evenly over the nodes; either this or density."""
    density: Positive | None = None
    """Density [kg/mm^3]; the mass of each element is spread over its nodes."""
    young_modulus: Positive | None = None
    """Young's modulus at rest [kPa]; either this or coefficients."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio at rest [-]."""
    law: Law = "hooke"
    """Law of elasticity: Hooke's, corotated, for strains of some 20 %; beyond them one of rubber. All agree at rest."""
    coefficients: dict[str, Number] | None = None
    """Coefficients of a law that takes more than Young's modulus [kPa, exponents -]; elements.md lists the coefficients
    of each law. Poisson's ratio gives the resistance to changes of volume, as in Hooke's law of the same shear
    modulus."""
    rayleigh_mass: NotNegative = 0.0
    """Rayleigh damping with the mass [1/s]."""
    rayleigh_stiffness: NotNegative = 0.0
    """Rayleigh damping with the stiffness [s]."""
    damped_anchors: bool = False
    """Whether rayleigh_stiffness damps the springs of the anchors too, as in SOFA: a base that moves at a velocity v
    then drags the anchored nodes rayleigh_stiffness times v behind it. Otherwise they are where the base is."""
    corotation: Literal["polar", "edges", "none"] = "polar"
    """Rotation of an element: the one nearest to its deformation; or, for linear elements alone, that of its first two
    edges, as SOFA's method "large" has it, which depends on the order in which the mesh lists their nodes; or none, the
    linear theory of small strains and small turns, as SOFA's method "small"."""
    embedding: Literal["deepest", "grid"] = "deepest"
    """Which element carries a point of a surface file that lies outside the mesh: the one with the nearest centroid of
    all, as SOFA's MeshTopology, or of some near it on a grid, as its TetrahedronSetTopologyContainer."""
    points_outside: Literal["refused", "extrapolated"] = "refused"
    """What becomes of points of surface files and cables that lie far outside the mesh: an error, or they follow the
    element that carries them with extrapolated weights, as in SOFA."""
    collision_surface: list[CollisionSurfaceSettings] = []
    """Surfaces that touch other bodies: the name of a closed surface file that follows the mesh, or a list of tables;
    the mesh's outer boundary when it is not given."""
    reduced: str | None = None
    """A file of modes (.npz) that `taichisoft reduce` wrote: the body moves by their amplitudes, which is fast and
    approximate."""
    collides: bool = True
    """Whether the body touches others; one that does not goes through them."""
    self_contact: bool = False
    """Whether parts of the body touch each other, such as chambers of a finger that bends; those that are nearer to
    each other at rest than twice the contact distance do not."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of silicone when it is not given."""
    axes: bool = False
    """Whether pictures and pages show its axes: the axes of the mesh's file, turned as the body has turned on the
    whole, from the mean of its nodes."""
    tip: Tip | None = None
    """The nodes whose motion is observed as that of the tip; those farthest from the anchors when it is not given."""
    follows: str = "base"
    """Frame that the anchored nodes move with, where anchors name no other: "base", or one of `frames`. Tips and pull
    points of cables are relative to it."""
    tactile: dict[Name, TactileArray] = {}
    membranes: dict[Name, MembraneSettings] = {}
    fibres: dict[Name, FibreSettings] = {}
    springs: dict[Name, SpringSettings] = {}
    regions: list[Region] = []
    anchors: list[Anchor] = []
    forces: list[NodalForce] = []
    alternatives = (("mass", "density"), ("young_modulus", "coefficients"))
    rules = (
        Rule(
            'element != "smoothed" or min(poisson_ratios) >= 0',
            'poisson_ratio = {min(poisson_ratios):g}: must be 0 or more with element = "smoothed"; "linear" and '
            '"quadratic" take any',
        ),
        Rule(
            'corotation == "polar" or element == "linear"',
            'corotation = "{corotation}" is for element = "linear", not "{element}"',
        ),
        Rule('corotation != "none" or law == "hooke"', 'corotation = "none" is for law = "hooke", not "{law}"'),
        Rule(
            "reduced and value == follows",
            '{path} = "{value}": the modes of a reduced body follow "{follows}"; remove reduced, or this key',
            "anchors.*.follows",
        ),
    )

    @model_validator(mode="after")
    def _check_laws(self) -> Self:
        check_coefficients(self.law, self.coefficients)
        for index, region in enumerate(self.regions):
            try:
                check_coefficients(region.law or self.law, region.coefficients)
            except ValueError as error:
                raise ValueError(f"regions.{index}: {error}") from error
        return self

    @model_validator(mode="before")
    @classmethod
    def _take_material(cls, value: Any) -> Any:
        return with_material(value, (*ELASTICITY, "poisson_ratio", "density"))

    @property
    def may_touch_itself(self) -> bool:
        """Whether parts of the body may touch each other."""
        return self.self_contact or len(self.collision_surface) > 1

    @property
    def materials(self) -> "list[SoftBodySettings | Region]":
        """What has a material: the body itself, then its regions."""
        return [self, *self.regions]

    @property
    def poisson_ratios(self) -> list[float]:
        """Poisson's ratios at rest of `materials`."""
        return [self.poisson_ratio if one.poisson_ratio is None else one.poisson_ratio for one in self.materials]

    @property
    def young_moduli(self) -> list[float]:
        """Young's moduli at rest [kPa] of `materials`."""
        return [
            one.young_modulus
            if one.young_modulus is not None
            else 2.0 * (1.0 + ratio) * initial_shear_modulus(one.law or self.law, one.coefficients or {})
            for one, ratio in zip(self.materials, self.poisson_ratios, strict=True)
        ]

    @field_validator("collision_surface", mode="before")
    @classmethod
    def _read_file(cls, value: Any) -> Any:
        if not isinstance(value, str | list):
            raise ValueError(f"{value!r} must be the name of a file, or a list of tables with the key file")
        return [{"file": value}] if isinstance(value, str) else value
