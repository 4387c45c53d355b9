"""Fingers as springs and an object as a point: a grasp of known outcome, quick enough for hundreds of runs."""

from dataclasses import dataclass, field

from taichisoft.errors import ControllerFailed
from taichisoft_controllers.closed_loop import GraspSequence, Phase, by_pressure
from taichisoft_controllers.grasp_sensing import GraspSettings, SensedGrasp

FRICTION = 0.6
GRAVITY = 9810.0  # [mm/s^2]
CONTACT_PRESSURE = 25.0  # from which the fingers touch [kPa]
STIFFNESS = 40.0  # of the force over the pressure beyond [mN/kPa]
HIGHEST_PRESSURE = 105.0  # [kPa]
STRONGEST = FRICTION * STIFFNESS * (HIGHEST_PRESSURE - CONTACT_PRESSURE)  # friction force that can be had [mN]


@dataclass
class ToyGrasp:
    """An object on a floor between fingers whose friction is Coulomb's.

    Attributes:
        weight: [mN].
        pressure: [kPa].
        base: height [mm].
        height: of the object [mm].
        speed: of the object, upwards [mm/s].
        slip_speed: [mm/s].
        push: force from outside [mN], upwards.
        phases: that were gone through.
    """

    weight: float
    pressure: float = 0.0
    base: float = 0.0
    height: float = 0.0
    speed: float = 0.0
    slip_speed: float = 0.0
    push: float = 0.0
    phases: list[Phase] = field(default_factory=list)

    @property
    def force(self) -> float:
        """Normal force of the fingers [mN]."""
        return max(0.0, STIFFNESS * (self.pressure - CONTACT_PRESSURE))

    def move(self, pressure: float, base: float, time_step: float) -> None:
        """Apply a pressure, move the base; friction does what it can to make the object follow."""
        base_speed = (base - self.base) / time_step
        self.pressure, self.base = pressure, base
        mass = self.weight / GRAVITY
        free = self.speed + (self.push - self.weight) / mass * time_step
        friction = min(max(mass * (base_speed - free) / time_step, -FRICTION * self.force), FRICTION * self.force)
        self.speed = free + friction / mass * time_step
        if self.height + self.speed * time_step < 0.0:
            self.speed = -self.height / time_step
        self.height += self.speed * time_step
        self.slip_speed = abs(base_speed - self.speed) if self.force > 0.0 else 0.0

    def sense(self, time: float) -> SensedGrasp:
        """What the controller is given."""
        missing = () if self.force >= 5.0 else ("finger",)
        slip = self.slip_speed if self.slip_speed > 1e-6 else 0.0
        return SensedGrasp(
            time=time,
            applied=self.pressure,
            force=self.force,
            missing=missing,
            slip_speed=slip,
            base_held_back=False,
            offset=self.height - self.base,
            object_speed=abs(self.speed),
        )


def run_toy(toy: ToyGrasp, settings: GraspSettings, duration: float, period: float = 0.01, pushes=()) -> GraspSequence:
    """Let a grasp go on for some time; `pushes` are (start [s], end [s], force [mN])."""
    actuation = by_pressure(settings, 0.0, min(HIGHEST_PRESSURE, settings.highest_pressure))
    sequence = GraspSequence(settings, "cube", actuation)
    for call in range(round(duration / period)):
        time = call * period
        sequence.advance(toy.sense(time), period if call else 0.0)
        if not toy.phases or toy.phases[-1] is not sequence.phase:
            toy.phases.append(sequence.phase)
        toy.push = sum(force for start, end, force in pushes if start <= time < end)
        toy.move(sequence.command, sequence.height, period)
    return sequence


def failure(toy: ToyGrasp, settings: GraspSettings, duration: float = 60.0) -> str:
    """What the sequence says when it gives up."""
    try:
        run_toy(toy, settings, duration)
    except ControllerFailed as error:
        return str(error)
    return "no failure"
