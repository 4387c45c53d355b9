from .report import StepReport as StepReport
