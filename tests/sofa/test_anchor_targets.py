"""Points that are held to what a scene moves: the points of another object, and motions given in time."""

from pathlib import Path

import numpy as np
import pytest
from test_controller import Run
from test_controller import folder as folder

GUIDED = """
    guide = root.addChild("guide")
    guide.addObject("EulerImplicitSolver", firstOrder=True)
    guide.addObject("CGLinearSolver")
    guide.addObject("MechanicalObject", name="points", position=[[30, 15, 15], [30, -15, 15], [30, 15, -15]])
    node.addObject("BoxROI", name="corner", box=[29, 14, 14, 31, 16, 16])
    node.addObject("RestShapeSpringsForceField", points="@corner.indices", stiffness=1e9,
                   external_rest_shape="@../guide/points", external_points=[{point}])
"""


def test_springs_hold_points_to_those_of_another_object(folder: Path) -> None:
    """What the scene writes to the other's position is where the springs pull: with stiff ones, where the point is.

    SOFA damps these springs, so that the distance shrinks by b / (b + h) in each step; b is 0.1 s here.
    """
    run = Run(
        folder,
        """
        def onAnimateBeginEvent(self, event):
            self.root.guide.points.position = [[30, 15, 20], [0, 0, 0], [1, 1, 1]]
        """,
        more=GUIDED.format(point=0),
    )
    corner = np.flatnonzero((np.abs(run.simulation.state.position - [30, 15, 15]) < 1e-9).all(axis=1))
    run.steps(10)
    expected = 20.0 - 5.0 * (0.1 / 0.11) ** 10
    assert run.simulation.state.position[corner][0] == pytest.approx([30, 15, expected], abs=1e-3)


def test_springs_to_points_that_are_not_there_are_refused(folder: Path) -> None:
    with pytest.raises(Exception, match="external_points has 1 points, of 3 in /guide/points; 1 are needed"):
        Run(folder, "pass", more=GUIDED.format(point=7))


def test_springs_lead_to_a_body_that_moves(folder: Path) -> None:
    """As in SOFA they pull one end only, to where the other is at the start of a step, with their damping.

    x1 = (a + (b / h) x0) / (1 + b / h) for stiff springs, with b = 0.1 s, and a cube at a that moves by 0.2 mm a step.
    """
    moving = """
    tool = root.addChild("tool")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        tool.addObject(kind)
    tool.addObject("MechanicalObject", name="frame", template="Rigid3", position=[30, 15, 15, 0, 0, 0, 1],
                   velocity=[0, 0, 20, 0, 0, 0])
    tool.addObject("UniformMass", totalMass=0.01)
    node.addObject("BoxROI", name="corner", box=[29, 14, 14, 31, 16, 16])
    node.addObject("RestShapeSpringsForceField", points="@corner.indices", stiffness=1e9,
                   external_rest_shape="@../tool/frame", external_points=[0])
    """
    run = Run(folder, "pass", more=moving)
    corner = np.flatnonzero((np.abs(run.simulation.state.position - [30, 15, 15]) < 1e-9).all(axis=1))
    height = 15.0
    for step in range(8):
        height = (15.0 + 0.2 * step + 10.0 * height) / 11.0
    run.steps(8)
    assert run.simulation.state.position[corner][0] == pytest.approx([30, 15, height], abs=1e-3)


@pytest.mark.parametrize("relative", [True, False])
def test_a_motion_in_time_is_linear_from_key_to_key(folder: Path, relative: bool) -> None:
    shifts = np.array([[0, 0, 0], [0, 0, 4], [0, 2, 4]]) + (0 if relative else np.array([30, -15, -15]))
    run = Run(
        folder,
        "pass",
        more=f"""
    node.addObject("BoxROI", name="right", box=[29, -99, -99, 31, 99, 99])
    node.addObject("LinearMovementConstraint", indices="@right.indices", keyTimes=[0, 0.04, 0.08],
                   movements={shifts.tolist()}, relativeMovements={relative})
""",
    )
    right = run.simulation.state.position[:, 0] > 29
    start = run.simulation.state.position[right]
    for count, shift in ((1, [0, 0, 1]), (3, [0, 0, 4]), (2, [0, 1, 4]), (9, [0, 2, 4])):
        run.steps(count)
        assert run.simulation.state.position[right] == pytest.approx(start + shift, abs=1e-6)
