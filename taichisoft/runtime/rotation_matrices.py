"""Rotations from vectors and from deformations."""

from taichisoft.runtime.language import func, mat3, ti, vec3


@func
def rotation_of_vector(w: vec3) -> mat3:
    """Rotation by the angle |w| about w (Rodrigues' formula)."""
    angle = w.norm()
    half = 0.5 * angle
    cosine_part = 0.5  # (1 - cos a) / a^2
    sine_part = 1.0  # sin a / a
    if angle > 1e-8:
        sine_part = ti.sin(angle) / angle
        cosine_part = 0.5 * (ti.sin(half) / half) ** 2
    skew = ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return ti.Matrix.identity(ti.f64, 3) + sine_part * skew + cosine_part * (skew @ skew)


@func
def fitted_rotation(deformation: mat3, start: mat3) -> mat3:
    """Rotation nearest to a deformation gradient, also an inverted one (Mueller et al. 2016, A Robust Method to
    Extract the Rotational Part of Deformations); stops when the correction is below 1e-14 rad."""
    rotation = start
    remaining = 100
    while remaining > 0:
        torque = vec3(0.0)
        stretch = 0.0
        for axis in ti.static(range(3)):
            r = vec3(rotation[0, axis], rotation[1, axis], rotation[2, axis])
            f = vec3(deformation[0, axis], deformation[1, axis], deformation[2, axis])
            torque += r.cross(f)
            stretch += r.dot(f)
        correction = torque / (ti.abs(stretch) + 1e-9)
        rotation = rotation_of_vector(correction) @ rotation
        remaining -= 1
        if correction.norm() < 1e-14:
            remaining = 0
    return rotation
