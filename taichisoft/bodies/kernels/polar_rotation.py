"""The rotation of a deformation, in closed form.

Of all rotations R the one nearest to F has the largest tr(R^T F). With s1 >= s2 >= |s3| the singular values of F, the
last with the sign of det F, that is l = s1 + s2 + s3, the largest root of
    (l^2 - |F|^2)^2 - 8 l det F - 4 |cof F|^2 = 0,
and with k = (l^2 - |F|^2) / 2
    R = ((k + |F|^2) F + l cof F - F F^T F) / (k l - det F)
(Markley 1993, Attitude Determination from Vector Observations: A Fast Optimal Matrix Algorithm). The divisor is
(s1 + s2) (s2 + s3) (s3 + s1): it is zero where, and only where, the nearest rotation is not unique.

An inverted element, of s3 < 0, gets a rotation like all others, never a reflection: it counts as turned inside out
along the direction of its least stretch, so that its forces push it back that way. Where s2 + s3 is next to nothing the
closed form loses digits; there R comes from the largest eigenvector of Davenport's matrix, by Jacobi's rotations. If it
is nothing, as in an element that has become a line or a point, several rotations are equally near; it is one of them.
"""

from taichisoft.runtime.language import func, mat3, ti, vec3

vec4 = ti.types.vector(4, ti.f64)
mat4 = ti.types.matrix(4, 4, ti.f64)

# Of (k l - det F) / l^3, which is 8 / 27 at rest. The closed form is good to 1e-16 over the square of it, about.
WELL_CONDITIONED = 0.02
# Halley's step is cubic: after one of this size, relative to l, the root is exact to round-off.
LAST_STEP = 1e-6


@func
def polar_rotation(deformation: mat3) -> mat3:
    """The rotation nearest to a deformation gradient, to round-off; also to an inverted one."""
    f = deformation
    cofactor = ti.Matrix.rows([row(f, 1).cross(row(f, 2)), row(f, 2).cross(row(f, 0)), row(f, 0).cross(row(f, 1))])
    determinant = row(f, 0).dot(row(cofactor, 0))
    squares = f.norm_sqr()
    root = largest_root(squares, determinant, cofactor.norm_sqr())
    pairs = 0.5 * (root * root - squares)
    divisor = pairs * root - determinant
    rotation = ti.Matrix.identity(ti.f64, 3)
    if divisor > WELL_CONDITIONED * root * root * root:
        outer = f @ f.transpose()
        rotation = ((pairs + squares) * f + root * cofactor - outer @ f) / divisor
    else:
        rotation = rotation_of_quaternion(largest_eigenvector(davenport_matrix(f)))
    return rotation


@func
def row(matrix: mat3, i: ti.template()) -> vec3:
    """A row of a matrix."""
    return vec3(matrix[i, 0], matrix[i, 1], matrix[i, 2])


@func
def largest_root(squares: ti.f64, determinant: ti.f64, cofactor_squares: ti.f64) -> ti.f64:
    """The largest root l of Markley's polynomial by Halley's steps, which fall from above: l^2 <= 3 |F|^2."""
    root = ti.sqrt(3.0 * squares)
    remaining = 50
    while remaining > 0:
        difference = root * root - squares
        value = difference * difference - 8.0 * root * determinant - 4.0 * cofactor_squares
        slope = 4.0 * root * difference - 8.0 * determinant
        curvature = 12.0 * root * root - 4.0 * squares
        divisor = 2.0 * slope * slope - value * curvature
        remaining -= 1
        step = 0.0
        if divisor > 0.0:
            step = 2.0 * value * slope / divisor
        root -= step
        if ti.abs(step) <= LAST_STEP * root:
            remaining = 0
    return root


@func
def davenport_matrix(f: mat3) -> mat4:
    """K with q^T K q = tr(R^T F) for the rotation R of every unit quaternion q."""
    trace = f.trace()
    turn = vec3(f[2, 1] - f[1, 2], f[0, 2] - f[2, 0], f[1, 0] - f[0, 1])
    matrix = ti.Matrix.zero(ti.f64, 4, 4)
    matrix[0, 0] = trace
    for i in ti.static(range(3)):
        matrix[0, i + 1] = turn[i]
        matrix[i + 1, 0] = turn[i]
        for j in ti.static(range(3)):
            matrix[i + 1, j + 1] = f[i, j] + f[j, i]
        matrix[i + 1, i + 1] -= trace
    return matrix


@func
def largest_eigenvector(symmetric: mat4) -> vec4:
    """The unit eigenvector of the largest eigenvalue by Jacobi's rotations (Golub and Van Loan, Matrix Computations,
    8.5), which end where the rest is round-off; of several one."""
    matrix = symmetric
    vectors = ti.Matrix.identity(ti.f64, 4)
    size = symmetric.norm_sqr()
    remaining = 20
    while remaining > 0:
        rest = 0.0
        for p in ti.static(range(3)):
            for q in ti.static(range(p + 1, 4)):
                rest += matrix[p, q] ** 2
                if ti.abs(matrix[p, q]) > 0.0:
                    half_difference = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
                    tangent = 1.0 / (ti.abs(half_difference) + ti.sqrt(1.0 + half_difference**2))
                    if half_difference < 0.0:
                        tangent = -tangent
                    cosine = 1.0 / ti.sqrt(1.0 + tangent**2)
                    sine = tangent * cosine
                    for k in ti.static(range(4)):
                        first, second = matrix[k, p], matrix[k, q]
                        matrix[k, p], matrix[k, q] = cosine * first - sine * second, sine * first + cosine * second
                        first, second = vectors[k, p], vectors[k, q]
                        vectors[k, p], vectors[k, q] = cosine * first - sine * second, sine * first + cosine * second
                    for k in ti.static(range(4)):
                        first, second = matrix[p, k], matrix[q, k]
                        matrix[p, k], matrix[q, k] = cosine * first - sine * second, sine * first + cosine * second
        remaining -= 1
        if rest <= 1e-32 * size:
            remaining = 0
    largest = matrix[0, 0]
    vector = vec4(vectors[0, 0], vectors[1, 0], vectors[2, 0], vectors[3, 0])
    for i in ti.static(range(1, 4)):
        if matrix[i, i] > largest:
            largest = matrix[i, i]
            vector = vec4(vectors[0, i], vectors[1, i], vectors[2, i], vectors[3, i])
    return vector.normalized()


@func
def rotation_of_quaternion(q: vec4) -> mat3:
    """Rotation of a unit quaternion (w, x, y, z)."""
    axis = vec3(q[1], q[2], q[3])
    skew = ti.Matrix([[0.0, -q[3], q[2]], [q[3], 0.0, -q[1]], [-q[2], q[1], 0.0]])
    about = 2.0 * (axis.outer_product(axis) + q[0] * skew)
    return (q[0] ** 2 - axis.norm_sqr()) * ti.Matrix.identity(ti.f64, 3) + about
