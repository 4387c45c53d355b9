"""How contacts are found and solved, and what pairs of bodies have of their own."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichisoft.scenes.table import NotNegative, Number, Positive, Table

Restitution = Annotated[Number, Field(ge=0.0, le=1.0)]


class ContactPair(Table):
    """What differs between one pair of bodies."""

    bodies: tuple[str, str]
    """Names of the two bodies."""
    friction: NotNegative | None = None
    """Coulomb's friction coefficient [-]; the scene's when it is not given."""
    restitution: Restitution | None = None
    """Coefficient of restitution [-]; the scene's when it is not given."""
    rolling_friction: NotNegative | None = None
    """Length of rolling friction [mm]; the scene's when it is not given."""
    spinning_friction: NotNegative | None = None
    """Length of spinning friction [mm]; the scene's when it is not given."""

    @model_validator(mode="after")
    def _check_something_differs(self) -> Self:
        given = self.friction, self.restitution, self.rolling_friction, self.spinning_friction
        if all(one is None for one in given):
            raise ValueError(
                "a pair needs friction, restitution, rolling_friction or spinning_friction, which are to differ from "
                "the scene's"
            )
        return self


class Contact(Table):
    """How contacts are found and solved."""

    friction: NotNegative = 0.6
    """Coulomb's friction coefficient [-]."""
    restitution: Restitution = 0.0
    """Share of the speed of approach that an impact gives back [-] (Newton's law)."""
    rolling_friction: NotNegative = 0.0
    """Length b [mm] of rolling friction: two bodies that press each other by N resist rolling with a moment of at most
    b N. A soft body resists by its own deformation; it has none of this."""
    spinning_friction: NotNegative = 0.0
    """Length b [mm] of spinning friction, the same for turning about the normal."""
    pairs: list[ContactPair] = []
    """Exceptions from the four coefficients above."""
    contact_distance: Positive = 1.0
    """Distance that surfaces are kept apart [mm]."""
    alarm_distance: Positive = 5.0
    """Distance up to which contacts are looked for [mm]; further where bodies move farther in a step."""
    spacing: NotNegative = 4.0
    """Distance [mm] within which only the worst contact of two bodies is added to the constraints at a time; this
    changes how fast a step is, not what comes out."""
    depth: Literal["position", "velocity"] = "position"
    """How surfaces that are closer than `contact_distance` at the start of a step come apart: by a shift that adds no
    speed, or, as in SOFA, by the speed depth / step, which stays."""
    tolerance: Positive = 1e-5
    """The contact solver stops when no contact's velocity changes by more than this in a sweep [mm/s]."""
    max_iterations: Annotated[int, Field(strict=True, gt=0)] = 1000
    """Largest number of sweeps of the contact solver, with one for each Newton step. A step that needs more is counted
    as not converged."""

    @model_validator(mode="after")
    def _check_pairs(self) -> Self:
        seen: set[frozenset[str]] = set()
        for pair in self.pairs:
            first, second = pair.bodies
            if frozenset(pair.bodies) in seen:
                raise ValueError(f"pairs names '{first}' and '{second}' twice; keep one of the two")
            seen.add(frozenset(pair.bodies))
        return self

    @model_validator(mode="after")
    def _check_distances(self) -> Self:
        if self.alarm_distance <= self.contact_distance:
            raise ValueError(
                f"alarm_distance ({self.alarm_distance:g}) must exceed contact_distance ({self.contact_distance:g})"
            )
        return self
