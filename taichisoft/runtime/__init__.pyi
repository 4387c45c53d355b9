from .language import available_cores as available_cores
from .language import ti as ti
from .launch import forget_launches_of_thread as forget_launches_of_thread
from .launch import kernel as kernel
from .machine_code import run_loops_alone as run_loops_alone
from .rubber_laws import RUBBER_LAWS as RUBBER_LAWS
from .rubber_laws import RubberLaw as RubberLaw
