"""The table of time in a scene: the step, what moves without inertia, and where in the step forces are taken."""

from typing import Annotated, Literal

from pydantic import Field

from taichisoft.scenes.table import Positive, Table

STATIC_LINEARISATIONS = 2000
"""Most linearisations of a static move: a finger needs 13 at 30 kPa and 41 at 100 kPa, since a linearisation leaves out
how pressure turns with the walls; one just below the pressure that it cannot carry needs 600."""


LEAST_THETA_OF_THREADS = 0.55
"""The midpoint rule does not keep the energy of Green's strain: a thrown strip with a sheet gained energy at a theta of
0.5 until it diverged, and none at 0.55."""
LEAST_NEWTON_OF_WRINKLES = 3
"""A slack sheet does not resist within one linearisation what tautens it: a strip that was thrown doubled its energy in
a step of 10 ms; with three linearisations, sheets of 1e5 and 1e7 kPa gained none in steps of 1 and 10 ms."""


class Time(Table):
    """Time stepping."""

    step: Positive = 0.01
    """Time step [s]."""
    duration: Positive = 1.0
    """Duration of a run [s]."""
    dynamics: Literal["inertial", "overdamped", "static"] = "inertial"
    """Newton's law, or motion without inertia against a drag of 1 mN for 1 mm/s and kg, as SOFA's `firstOrder`, or
    none: a static step leads to equilibrium, whatever its length, as `taichisoft.equilibrium` finds it; nothing has a
    velocity then, and Rayleigh damping no effect. Soft bodies need anchors in statics; rigid bodies need inertia or
    statics."""
    theta: Annotated[float, Field(ge=0.5, le=1.0)] = 1.0
    """Where in the step forces are taken: 1 is implicit Euler, which damps what swings; 0.5 is of second order in the
    step with `newton` above 1, and damps nothing. Contacts, and actuators that are solved for, obey their laws at the
    end of the step whatever it is (Moreau and Jean's scheme)."""
    newton: Annotated[int, Field(strict=True, gt=0)] = 1
    """Most linearisations of the soft bodies' equations in a step. One is linearly implicit Euler; more lead to the
    solution of the equations at the end of the step, contacts and actuators included. Static steps take more."""
    newton_tolerance: Positive = 1e-7
    """No further linearisation is made where one would move no node by more than this [mm], whatever the step."""

    @property
    def stage(self) -> float:
        """From the start of a step to where forces are taken [s]: theta h."""
        return self.theta * self.step

    @property
    def most_linearisations(self) -> int:
        """`newton`, and enough to find an equilibrium in static steps."""
        return max(self.newton, STATIC_LINEARISATIONS) if self.dynamics == "static" else self.newton
