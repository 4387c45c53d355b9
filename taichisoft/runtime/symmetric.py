"""Eigenvalues of symmetric 3x3 matrices.

With q the mean of the eigenvalues and 6 p^2 the squared length of A - q I, the eigenvalues of (A - q I) / p are
2 cos(t), 2 cos(t + 2 pi / 3) and 2 cos(t - 2 pi / 3), where cos(3 t) is half its determinant (Smith 1961, Eigenvalues
of a symmetric 3x3 matrix). One of them always is far from the others, at least 1.73 in size. Its eigenvector is a
cross product of two rows, and the others are eigenvectors of a 2x2 matrix across it: so also equal eigenvalues are
found to round-off (Eberly 2014, A Robust Eigensolver for 3x3 Symmetric Matrices). All of this needs a trace of zero:
see `deviator`.
"""

from taichisoft.runtime.language import func, mat3, ti, vec3

# Added to a divisor that is zero where the dividend is zero.
TINY = 1e-200
SQUARE_ROOT_OF_THREE = 3.0**0.5


@func
def symmetric_eigen(matrix: mat3):
    """Eigenvalues, and eigenvectors as columns of a rotation."""
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    a = deviator(matrix)
    first = lonely_eigenvector(a)
    second = vec3(0.0, first[2], -first[1])
    if ti.abs(first[0]) > ti.abs(first[1]):
        second = vec3(-first[2], 0.0, first[0])
    second /= second.norm()
    third = first.cross(second)
    a_second, a_third = a @ second, a @ third
    of_second, of_third, mixed = second.dot(a_second), third.dot(a_third), second.dot(a_third)
    # Jacobi's rotation of second and third (Golub and Van Loan, Matrix Computations, section 8.5).
    difference = of_third - of_second
    sign = 1.0
    if difference < 0.0:
        sign = -1.0
    root = ti.sqrt(difference * difference + 4.0 * mixed * mixed)
    tangent = 2.0 * sign * mixed / (ti.abs(difference) + root + TINY)
    cosine = 1.0 / ti.sqrt(1.0 + tangent * tangent)
    values = vec3(first.dot(a @ first), of_second - tangent * mixed, of_third + tangent * mixed)
    turned = cosine * (second - tangent * third)
    vectors = ti.Matrix.cols([first, turned, first.cross(turned)])
    return mean + values, vectors


@func
def deviator(matrix: mat3) -> mat3:
    """The matrix less the mean of its eigenvalues, whose trace is small beside itself, not only beside the matrix.

    Where the eigenvalues are equal to round-off, subtracting their mean, which is rounded as well, would leave
    round-off of any trace: of diag(d, d, 0), scaled as below, the root would be the d that occurs twice, and no two
    rows would span a plane. Made of two differences, the diagonal adds up to zero however these are rounded.
    """
    upper, lower = matrix[0, 0] - matrix[1, 1], matrix[1, 1] - matrix[2, 2]
    result = matrix
    result[0, 0] = (2.0 * upper + lower) / 3.0
    result[1, 1] = (lower - upper) / 3.0
    result[2, 2] = -(upper + 2.0 * lower) / 3.0
    return result


@func
def lonely_eigenvector(a: mat3) -> vec3:
    """The eigenvector of the eigenvalue that is far from the others, of a matrix with trace zero."""
    scaled = a / (ti.sqrt(a.norm_sqr() / 6.0) + TINY)
    cosine = 0.5 * scaled.determinant()
    sign = 1.0
    if cosine < 0.0:
        sign = -1.0
    cosine = ti.min(ti.abs(cosine), 1.0)
    # The largest root of x^3 - 3 x - 2 cos(3 t), by two of Halley's steps from a line that is nowhere off by 0.02.
    x = SQUARE_ROOT_OF_THREE + (2.0 - SQUARE_ROOT_OF_THREE) * cosine
    for _ in ti.static(range(2)):
        value, slope = (x * x - 3.0) * x - 2.0 * cosine, 3.0 * x * x - 3.0
        x -= value * slope / (slope * slope - 3.0 * x * value)
    shifted = scaled - sign * x * ti.Matrix.identity(ti.f64, 3)
    rows = ti.static([vec3(shifted[i, 0], shifted[i, 1], shifted[i, 2]) for i in range(3)])
    best = rows[0].cross(rows[1])
    for i in ti.static(range(1, 3)):
        other = rows[i].cross(rows[(i + 1) % 3])
        if other.norm_sqr() > best.norm_sqr():
            best = other
    return best / best.norm()


@func
def positive_part(matrix: mat3) -> mat3:
    """The nearest symmetric matrix without negative eigenvalues."""
    minor = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[0, 1]
    result = matrix
    if matrix[0, 0] <= 0.0 or minor <= 0.0 or matrix.determinant() <= 0.0:
        values, vectors = symmetric_eigen(matrix)
        result = ti.Matrix.zero(ti.f64, 3, 3)
        for i in ti.static(range(3)):
            axis = vec3(vectors[0, i], vectors[1, i], vectors[2, i])
            result += ti.max(values[i], 0.0) * axis.outer_product(axis)
    return result
