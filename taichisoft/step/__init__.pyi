from .linearisation import asking as asking
from .solution import StepReport as StepReport
