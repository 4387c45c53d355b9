"""What the file of a calibration says: parameters to be found, and measured curves that a run is to repeat."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from taichisoft.scenes.table import Number, Positive, Table
from taichisoft_studies.study_file import Count, Study


class Parameter(Table):
    """A value to be found."""

    start: Number
    """First guess."""
    low: Number
    """Smallest value."""
    high: Number
    """Largest value."""
    log: bool = False
    """Whether it is a magnitude: steps are then relative."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.low < self.start < self.high:
            raise ValueError(f"start ({self.start:g}) must lie between low ({self.low:g}) and high ({self.high:g})")
        if self.log and self.low <= 0.0:
            raise ValueError(f"log needs a positive low; it is {self.low:g}")
        return self


class Curve(Table):
    """A measured quantity, and what it is in a run."""

    column: str
    """Column of the data, or an expression of columns ("(a + b) / 2", `columns["Tip-1_z_mm"]`)."""
    quantity: str
    """Expression of what a controller sees ("tip_positions['finger'][2]"), in the same unit."""
    relative: bool = False
    """Whether only changes since the first value count, of the data and of the run."""
    scale: Positive | None = None
    """What a difference is divided by, such as the error of measurement; the data's standard deviation otherwise."""


class Experiment(Table):
    """One measurement, and the run that stands for it."""

    data: str | None = None
    """File with the data (CSV with a header), beside the study; --data names it otherwise."""
    set: tuple[str, ...] = ()
    """Changes of the scene for this experiment."""
    duration: Positive | None = None
    """Simulated time [s]; the study's when it is not given."""
    over: str = "time"
    """Expression of what the curves are drawn over in the run: time [s], or a pressure that only rises."""
    over_column: str = "time"
    """The same in the data: a column, or an expression of columns."""
    first: Number | None = None
    """Rows below this value of `over_column` are left out."""
    last: Number | None = None
    """Rows above this value of `over_column` are left out."""
    shift: Number = 0.0
    """What is added to `over_column`, for data whose clock starts at another moment."""
    curves: Annotated[tuple[Curve, ...], Field(min_length=1)]
    """The measured quantities."""


class Calibration(Study):
    """A fit of parameters to measured curves by least squares."""

    parameters: Annotated[dict[str, Parameter], Field(min_length=1)]
    """What is to be found, by key."""
    experiments: Annotated[tuple[Experiment, ...], Field(min_length=1)]
    """The measurements, all fitted at once."""
    difference: Annotated[float, Field(strict=True, gt=0.0, le=0.2)] = 0.01
    """Step of the finite differences, as a share of the range between low and high."""
    most_steps: Count = 20
    """Most evaluations of the fit; each takes a run for each experiment, and two more for each parameter."""
