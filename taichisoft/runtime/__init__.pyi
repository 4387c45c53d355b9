from .language import Matrices as Matrices
from .language import available_cores as available_cores
from .language import ti as ti
from .launch import kernel as kernel
from .symmetric import symmetric_eigen as symmetric_eigen
