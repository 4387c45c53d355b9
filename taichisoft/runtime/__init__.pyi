from .launch import kernel as kernel
from .symmetric import symmetric_eigen as symmetric_eigen
from .taichi_start import Matrices as Matrices
from .taichi_start import available_cores as available_cores
from .taichi_start import ti as ti
