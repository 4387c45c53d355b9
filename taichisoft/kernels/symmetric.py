"""Eigenvalues of symmetric 3x3 matrices."""

from taichisoft.kernels.runtime import mat3, ti, vec3

# Sweeps of Jacobi's method converge quadratically; some six are enough for any matrix.
MOST_SWEEPS = 12
# Smallest square of what is left off the diagonal, over that of the diagonal: round-off.
LEFT = 1e-31
# What keeps a division by zero from happening where both numbers are zero.
TINY = 1e-200


@ti.func
def symmetric_eigen(matrix: mat3):
    """Eigenvalues, and eigenvectors as columns of a rotation, by Jacobi's method (Golub and Van Loan, section 8.5)."""
    a = matrix
    vectors = ti.Matrix.identity(ti.f64, 3)
    left = MOST_SWEEPS
    while left > 0:
        left -= 1
        for k in ti.static(range(3)):
            p, q = ti.static((k + 1) % 3), ti.static((k + 2) % 3)
            difference = a[q, q] - a[p, p]
            sign = 1.0
            if difference < 0.0:
                sign = -1.0
            root = ti.sqrt(difference * difference + 4.0 * a[p, q] * a[p, q])
            tangent = 2.0 * sign * a[p, q] / (ti.abs(difference) + root + TINY)
            cosine = 1.0 / ti.sqrt(1.0 + tangent * tangent)
            sine = tangent * cosine
            a[p, p] -= tangent * a[p, q]
            a[q, q] += tangent * a[p, q]
            a[p, q], a[q, p] = 0.0, 0.0
            kp, kq = a[k, p], a[k, q]
            a[k, p] = cosine * kp - sine * kq
            a[k, q] = sine * kp + cosine * kq
            a[p, k], a[q, k] = a[k, p], a[k, q]
            for i in ti.static(range(3)):
                vp, vq = vectors[i, p], vectors[i, q]
                vectors[i, p] = cosine * vp - sine * vq
                vectors[i, q] = sine * vp + cosine * vq
        beside = a[0, 1] * a[0, 1] + a[1, 2] * a[1, 2] + a[2, 0] * a[2, 0]
        if beside <= LEFT * (a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]) + TINY:
            left = 0
    return vec3(a[0, 0], a[1, 1], a[2, 2]), vectors


@ti.func
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
