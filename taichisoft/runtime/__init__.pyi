from .language import available_cores as available_cores
from .language import ti as ti
from .launch import kernel as kernel
from .rubber_laws import RUBBER_LAWS as RUBBER_LAWS
from .rubber_laws import RubberLaw as RubberLaw
