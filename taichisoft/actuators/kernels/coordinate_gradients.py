"""Actuators' coordinates: numbers that depend on where bodies are, a cavity's volume or how far a cable is pulled in.

The effort of a coordinate is what does work on it: the pressure in a cavity, the tension of a cable.
"""

from typing import NamedTuple

from taichisoft.runtime.language import Integers, ScalarTable, Vectors


class Coordinates(NamedTuple):
    """What the coordinates depend on: the volumes of the cavities, then the coordinates of the cables.

    Attributes:
        entry_start: where the soft nodes of each coordinate begin, shape (coordinate_count + 1,).
        entry_node: soft node of each entry, once in a coordinate, shape (entry_count,).
        rigid_start: where the rigid bodies of each coordinate begin, shape (coordinate_count + 1,).
        rigid_body: rigid body of each of these entries, once in a coordinate, shape (rigid_entry_count,).
    """

    entry_start: Integers
    entry_node: Integers
    rigid_start: Integers
    rigid_body: Integers


class Gradient(NamedTuple):
    """Derivatives of the coordinates, of volumes [mm^2] and of cables [-], at the start of a step.

    Attributes:
        soft: by the position of each entry's node, shape (entry_count, 3).
        rigid: by the translation of each rigid entry's body [-] and its rotation [mm], shape (rigid_entry_count, 6).
    """

    soft: Vectors
    rigid: ScalarTable
