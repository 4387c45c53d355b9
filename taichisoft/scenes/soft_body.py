"""Soft bodies as a user describes them: mesh, materials, anchors, cavities, cables."""

from collections import Counter
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_serializer, model_validator

from taichisoft.scenes.colours import Colour
from taichisoft.scenes.elastic_law import Law, check_coefficients, initial_shear_modulus
from taichisoft.scenes.material import ELASTICITY, Material, with_material
from taichisoft.scenes.table import (
    Groups,
    KeySets,
    Name,
    NodeNumber,
    NotNegative,
    Number,
    PoissonRatio,
    Positive,
    Table,
    Vector,
    check_order,
)


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
    """Coefficients of the law [kPa]."""
    alternatives = (("box", "group"), ("young_modulus", "coefficients"))

    @model_validator(mode="before")
    @classmethod
    def _take_material(cls, value: Any) -> Any:
        return with_material(value, (*ELASTICITY, "poisson_ratio"))


class Anchor(NodeSelection):
    """Nodes held by stiff springs to their rest positions, which move with the base."""

    stiffness: Positive = 1e12
    """Stiffness of the spring of each node [mN/mm]."""
    directions: Annotated[list[Literal["x", "y", "z"]], Field(min_length=1)] = ["x", "y", "z"]
    """Axes of space along which the nodes are held; along the others they move freely."""


class Tip(NodeSelection):
    """Nodes whose motion is observed as that of the tip; without this table those farthest from the anchors."""


class Cavity(Table):
    """An air chamber: a closed surface, by a group of the mesh or by a surface file of its own."""

    group: str | None = None
    """Name of a closed surface group of the mesh; either this or surface."""
    surface: str | None = None
    """Closed surface file; either this or group."""
    lowest_pressure: Number | None = None
    """Smallest pressure [kPa]: a pump that draws no further."""
    highest_pressure: Number | None = None
    """Largest pressure [kPa]: a valve that opens."""
    lowest_volume_growth: Number | None = None
    """How far the volume shrinks at most [mm^3], negative, whatever the pressure."""
    highest_volume_growth: Number | None = None
    """How far the volume grows at most [mm^3]: there is no more air."""
    alternatives = (("group", "surface"),)

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        check_order(self, "pressure", "volume_growth")
        return self


class CablePoint(Table):
    """A point of a cable on another body than the one that has the cable."""

    body: str
    """Name of the soft body, rigid body or obstacle."""
    point: Vector
    """The point in this body's own coordinates, those of its mesh or of its scaled surface [mm]."""


class CableArea(Table):
    """A place of a cable that pulls at a whole area, such as a plate that is glued in: the weighted mean of points."""

    body: str | None = None
    """Name of the body that has the points; the cable's own body when it is not given."""
    area: Annotated[list[Vector], Field(min_length=1)]
    """The points, in this body's own coordinates [mm]."""
    weights: list[NotNegative] | None = None
    """Share of each point in the pull, of any sum; equal ones when they are not given."""

    @model_validator(mode="after")
    def _check_weights(self) -> Self:
        if self.weights is not None and len(self.weights) != len(self.area):
            raise ValueError(f"weights has {len(self.weights)} numbers for the {len(self.area)} points of area")
        if self.weights is not None and not any(self.weights):
            raise ValueError("weights are all 0; at least one point must be pulled")
        return self


def _kind_of_points(value: Any) -> str:
    return "<file>" if isinstance(value, str) else "<list>"


def _kind_of_place(value: Any) -> str:
    if isinstance(value, CableArea) or (isinstance(value, dict) and "area" in value):
        return "<area>"
    return "<other body>" if isinstance(value, dict | CablePoint) else "<point>"


CablePlace = Annotated[
    Annotated[Vector, Tag("<point>")]
    | Annotated[CablePoint, Tag("<other body>")]
    | Annotated[CableArea, Tag("<area>")],
    Discriminator(_kind_of_place),
]


class Cable(Table):
    """A cable (tendon) through points of bodies: pulled in at its first point, attached at the last, free to slide
    through those between."""

    points: Annotated[
        Annotated[str, Tag("<file>")] | Annotated[list[CablePlace], Tag("<list>")], Discriminator(_kind_of_points)
    ]
    """Points in the mesh's own coordinates [mm], points of other bodies, or areas; or a file with a list of points
    (.json) or lines of x, y, z (.csv)."""
    pull_point: Vector | None = None
    """The place from which the cable is pulled, in the same coordinates [mm]; the first point when it is not given."""
    pull_point_moves: bool = True
    """Whether the pull point moves with the base; else it stays where it is in space."""
    friction: NotNegative = 0.0
    """Friction coefficient between the cable and its points [-]."""
    axial_stiffness: Positive | None = None
    """Young's modulus times cross-section: tension per relative stretch [mN]. When it is not given a cable does not
    stretch; one with friction has 1e7 mN, a thin line of strong fibres, since what does not stretch cannot stick."""
    rod: bool = False
    """Whether it pushes as well as it pulls; the tension of a cable is never negative."""
    lowest_tension: Number | None = None
    """Smallest tension [mN]; that of a cable is 0 when it is not given."""
    highest_tension: Number | None = None
    """Largest tension [mN], at which a motor gives way."""
    lowest_pull: Number | None = None
    """How far the cable is pulled in at least [mm]; negative when it may be paid out."""
    highest_pull: Number | None = None
    """How far the cable can be pulled in [mm], a stop."""

    @property
    def other_bodies(self) -> list[str]:
        """Names of the bodies that its points and areas name."""
        places = [place for place in self.points if isinstance(place, CablePoint | CableArea)]
        return [place.body for place in places if place.body is not None]

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        check_order(self, "tension", "pull")
        if not self.rod and (self.lowest_tension or 0.0) < 0.0:
            raise ValueError(f"lowest_tension ({self.lowest_tension:g}) must not be negative unless rod = true")
        if not self.rod and (self.highest_tension or 0.0) < 0.0:
            raise ValueError(f"highest_tension ({self.highest_tension:g}) must not be negative unless rod = true")
        if not isinstance(self.points, str) and len(self.points) + (self.pull_point is not None) < 2:
            raise ValueError(f"points has {len(self.points)} points; a cable needs two, its pull point counted")
        return self


class BodyMesh(Table):
    """The source of a soft body's mesh; `mesh = "FILE"` is short for a table with nothing but `file`."""

    file: str
    """A mesh (.msh, .vtk, .vtu), or a geometry (.toml) that is meshed on first use; or the name of a shipped one."""
    size: Positive | None = None
    """Largest element of a geometry's mesh [mm]; the geometry's own when neither it nor preset or nodes is given."""
    preset: str | None = None
    """Name of one of the geometry's sizes, such as "coarse", "medium" or "fine"."""
    nodes: Annotated[int, Field(strict=True, gt=0)] | None = None
    """Number of nodes that the geometry's mesh should have, roughly."""
    set: dict[str, Any] = {}
    """Values to take instead of the geometry's own: { chambers.height = 12.0 }."""

    @model_validator(mode="before")
    @classmethod
    def _read_text(cls, value: Any) -> Any:
        if not isinstance(value, str | dict | cls):
            raise ValueError(f"{value!r} must be the name of a file, or a table with the key file")
        return {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _check_one_size(self) -> Self:
        sizes = [key for key in ("size", "preset", "nodes") if getattr(self, key) is not None]
        if len(sizes) > 1:
            raise ValueError(f"one of size, preset, nodes can be given; given: {', '.join(sizes)}")
        return self

    @model_serializer
    def _write_short(self) -> Any:
        """The file alone where nothing else is asked for."""
        return {"file": self.file, **self.request} if self.request else self.file

    @property
    def request(self) -> dict[str, Any]:
        """Keys that are given beside the file."""
        given = {key: getattr(self, key) for key in ("size", "preset", "nodes", "set")}
        return {key: value for key, value in given.items() if value not in (None, {})}


class CollisionSurface(Table):
    """A surface that touches other bodies; `collision_surface = "FILE"` is short for a single one without groups.

    Without any it is the mesh's outer boundary.
    """

    file: str
    """A closed surface file that follows the mesh."""
    open: bool = False
    """Whether the surface may have open edges; it touches what is on the side that it faces."""
    groups: Groups = []
    """Surfaces that have a group in common do not touch each other; all others do, also two of the same body."""


class SoftBody(Table):
    """A silicone body of corotational finite elements."""

    mesh: BodyMesh
    """Mesh of the body: a file's name, or the table [soft_bodies.NAME.mesh]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Placement: turns about the x, y and z axes, in this order [degrees]."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Placement: shift after the rotation [mm]."""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity of all nodes at the start [mm/s]."""
    element: Literal["linear", "smoothed", "quadratic"] = "smoothed"
    """What the tetrahedra of the mesh become: linear elements, which are cheap, but bend too little and lock where
    Poisson's ratio comes near 0.5; linear ones whose strains are smoothed around edges and nodes, which do neither;
    quadratic ones, the most accurate."""
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
    """Coefficients of laws that have more than Young's modulus: c10 and c01 of Mooney and Rivlin's, c10, c20 and c30 of
    Yeoh's, mu1, alpha1, and so on up to mu3, alpha3 of Ogden's [kPa]. Poisson's ratio gives the resistance to changes
    of volume, as in Hooke's law of the same shear modulus."""
    rayleigh_mass: NotNegative = 0.0
    """Rayleigh damping with the mass [1/s]."""
    rayleigh_stiffness: NotNegative = 0.0
    """Rayleigh damping with the stiffness [s]."""
    damped_anchors: bool = False
    """Whether rayleigh_stiffness damps the springs of the anchors too, as in SOFA: a base that moves at a velocity v
    then drags the anchored nodes rayleigh_stiffness times v behind it. Otherwise they are where the base is."""
    corotation: Literal["polar", "edges"] = "polar"
    """Rotation of an element: the one nearest to its deformation, or that of its first two edges, as SOFA's method
    "large" has it; the latter, for linear elements alone, depends on the order in which the mesh lists their nodes."""
    embedding: Literal["deepest", "grid"] = "deepest"
    """Which element carries a point of a surface file that lies outside the mesh: the one with the nearest centroid of
    all, as SOFA's MeshTopology, or of some near it on a grid, as its TetrahedronSetTopologyContainer."""
    points_outside: Literal["refused", "extrapolated"] = "refused"
    """What becomes of points of surface files and cables that lie far outside the mesh: an error, or they follow the
    element that carries them with extrapolated weights, as in SOFA."""
    collision_surface: list[CollisionSurface] = []
    """Surfaces that touch other bodies: the name of a closed surface file that follows the mesh, or a list of tables;
    the mesh's outer boundary when it is not given."""
    collides: bool = True
    """Whether the body touches others; one that does not goes through them."""
    self_contact: bool = False
    """Whether parts of the body touch each other, such as chambers of a finger that bends; those that are nearer to
    each other at rest than twice the contact distance do not."""
    colour: Colour | None = None
    """Colour in pictures and on pages, "#rrggbb"; that of silicone when it is not given."""
    axes: bool = False
    """Whether pictures and pages show its axes: those of the mesh's file, turned as the body has turned on the whole,
    from the mean of its nodes."""
    tip: Tip | None = None
    """The nodes whose motion is observed as that of the tip; those farthest from the anchors when it is not given."""
    regions: list[Region] = []
    anchors: list[Anchor] = []
    cavities: dict[Name, Cavity] = {}
    cables: dict[Name, Cable] = {}
    alternatives = (("mass", "density"), ("young_modulus", "coefficients"))

    @model_validator(mode="after")
    def _check_laws(self) -> Self:
        check_coefficients(self.law, self.coefficients)
        for index, region in enumerate(self.regions):
            try:
                check_coefficients(region.law or self.law, region.coefficients)
            except ValueError as error:
                raise ValueError(f"regions.{index}: {error}") from error
        ratios = [self.poisson_ratio, *(one.poisson_ratio for one in self.regions if one.poisson_ratio is not None)]
        if self.element == "smoothed" and min(ratios) < 0.0:
            raise ValueError(
                f'poisson_ratio = {min(ratios):g}: must be 0 or more with element = "smoothed"; '
                '"linear" and "quadratic" take any'
            )
        return self

    @model_validator(mode="after")
    def _check_corotation(self) -> Self:
        if self.corotation == "edges" and self.element != "linear":
            raise ValueError(f'corotation = "edges" is for element = "linear", not "{self.element}"')
        return self

    @model_validator(mode="before")
    @classmethod
    def _take_material(cls, value: Any) -> Any:
        return with_material(value, (*ELASTICITY, "poisson_ratio", "density"))

    @property
    def may_touch_itself(self) -> bool:
        """Whether parts of the body may touch each other."""
        return self.self_contact or len(self.collision_surface) > 1

    @model_validator(mode="after")
    def _check_actuator_names(self) -> Self:
        both = sorted(self.cavities.keys() & self.cables.keys())
        if both:
            raise ValueError(f"a cavity and a cable are both called '{both[0]}'; give one another name")
        return self

    @property
    def materials(self) -> "list[SoftBody | Region]":
        """What has a material: the body itself, then its regions."""
        return [self, *self.regions]

    @property
    def young_moduli(self) -> list[float]:
        """Young's moduli at rest [kPa] of `materials`."""
        return [
            one.young_modulus
            if one.young_modulus is not None
            else 2.0
            * (1.0 + (self.poisson_ratio if one.poisson_ratio is None else one.poisson_ratio))
            * initial_shear_modulus(one.law or self.law, one.coefficients or {})
            for one in self.materials
        ]

    @field_validator("collision_surface", mode="before")
    @classmethod
    def _read_file(cls, value: Any) -> Any:
        if not isinstance(value, str | list):
            raise ValueError(f"{value!r} must be the name of a file, or a list of tables with the key file")
        return [{"file": value}] if isinstance(value, str) else value
