from .output import Output as Output
from .session import BINDINGS as BINDINGS
from .session import Session as Session
