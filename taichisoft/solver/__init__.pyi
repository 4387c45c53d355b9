from .contact_solver import ContactSolver as ContactSolver
from .kernels.actuator_bounds import BOUND_COLUMNS as BOUND_COLUMNS
from .kernels.constraint_problem import Iterate as Iterate
from .kernels.constraint_problem import Problem as Problem
from .kernels.sweep import SWEEPS as SWEEPS
from .kernels.sweep import sweep_repeatedly as sweep_repeatedly
