from .detection import ContactDetection as ContactDetection
from .moving_surfaces import MovingSurfaces as MovingSurfaces
from .overlap import Overlap as Overlap
from .overlap import overlaps as overlaps
