"""A finger whose dimensions fit together."""

from pydantic import model_validator

from taichisoft_meshing.finger.dimensions import FingerDimensions
from taichisoft_meshing.finger.thickness import positions_from_walls
from taichisoft_meshing.finger.walls import check_walls


class FingerParameters(FingerDimensions):
    """A finger of the kind used in the PneuNet gripper tutorial; the defaults are that finger.

    A thickness in `walls`, or `wall`, decides positions of other tables: those read as it makes them.
    """

    @model_validator(mode="after")
    def _check_walls(self) -> "FingerParameters":
        for name, table in positions_from_walls(self).items():
            object.__setattr__(self, name, table)  # frozen, but not made yet
        check_walls(self)
        return self
