"""Where the tips of the fingers are, how they move, and how far they have turned."""

from taichisoft.runtime.arithmetic import fitted_rotation
from taichisoft.runtime.language import Integers, Matrices, Scalars, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel


@kernel
def observe_tips(
    start: Integers,
    rest: Vectors,
    position: Vectors,
    velocity: Vectors,
    frame_turn: Matrices,
    mean_position: Vectors,
    mean_velocity: Vectors,
    bending_angle: Scalars,
):
    """Means of each tip's nodes, and the angle between a frame's rotation and the one that fits the tip best.

    The nodes of tip f are those from start[f] to start[f + 1]; `rest` has them less their mean.
    """
    ti.loop_config(serialize=True)
    for f in range(mean_position.shape[0]):
        share = 1.0 / (start[f + 1] - start[f])
        middle, speed = vec3(0.0), vec3(0.0)
        for k in range(start[f], start[f + 1]):
            middle += share * position[k]
            speed += share * velocity[k]
        fitted = ti.Matrix.zero(ti.f64, 3, 3)
        for k in range(start[f], start[f + 1]):
            fitted += (position[k] - middle).outer_product(rest[k])
        turn = frame_turn[f].transpose() @ fitted_rotation(share * fitted, frame_turn[f])
        sine = vec3(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        mean_position[f] = middle
        mean_velocity[f] = speed
        bending_angle[f] = ti.atan2(sine.norm(), turn.trace() - 1.0)
