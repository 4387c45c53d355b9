"""Arithmetic that kernels share: tiles of the direct solver, symmetric matrices, sorting, rotations, waiting.

Two things keep a tile in the processor's vector registers, which is worth a factor of three. LLVM must not be able
to count a loop over columns, or it vectorises that loop instead of the tile. And it must not see through an index of
vectors to a loop's counter: it then fears that 32 bits overflow between the lanes, and loads them one by one.
`advance` and `opaque` see to both with the help of `one`, an argument of the kernel that is 1.
"""

from typing import Any

from taichisoft.runtime.language import Arrays, Integers, ScalarTable, func, mat3, ti, vec3

# Eigenvalues of symmetric 3x3 matrices.
#
# With q the mean of the eigenvalues and 6 p^2 the squared length of A - q I, the eigenvalues of (A - q I) / p are 2
# cos(t), 2 cos(t + 2 pi / 3) and 2 cos(t - 2 pi / 3), where cos(3 t) is half its determinant (Smith 1961, Eigenvalues
# of a symmetric 3x3 matrix). One of them always is far from the others, at least 1.73 in size. Its eigenvector is a
# cross product of two rows, and the others are eigenvectors of a 2x2 matrix across it: so also equal eigenvalues are
# found to round-off (Eberly 2014, A Robust Eigensolver for 3x3 Symmetric Matrices). All of this needs a trace of zero:
# see `deviator`.

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


# Sorting within a kernel.


@func
def sort_rows(count: ti.i32, keys: ScalarTable, order: Integers, spare: Integers):
    """Fill `order` with the first `count` rows of `keys` by their first number, then by the next ones.

    Rows that are equal keep their order (merge sort); `spare` is work space of the same size.
    """
    for i in range(count):
        order[i] = i
    run = 1  # rows that are in order, side by side
    while run < count:
        for i in range(count):
            spare[i] = order[i]
        for pair in range((count + 2 * run - 1) // (2 * run)):
            start = 2 * run * pair
            merge(start, ti.min(start + run, count), ti.min(start + 2 * run, count), keys, spare, order)
        run *= 2


@func
def merge(start: ti.i32, middle: ti.i32, end: ti.i32, keys: ScalarTable, runs: Integers, order: Integers):
    """Merge the two runs from `start` to `middle` and from there to `end`."""
    left, right = start, middle
    for k in range(start, end):
        from_right = left == middle
        if left < middle and right < end:  # nested: behind `and` Taichi would call the function in any case
            from_right = comes_before(runs[right], runs[left], keys)
        if from_right:
            order[k] = runs[right]
            right += 1
        else:
            order[k] = runs[left]
            left += 1


@func
def comes_before(row: ti.i32, other: ti.i32, keys: ScalarTable) -> ti.u1:
    """Whether a row stands before another one."""
    before, column = False, 0
    while column < keys.shape[1]:
        if keys[row, column] != keys[other, column]:
            before = keys[row, column] < keys[other, column]
            column = keys.shape[1]
        column += 1
    return before


# Rotations from vectors and from deformations.


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


# Threads of a kernel that wait for one another, but not for long.
#
# A thread that waits keeps its core busy. Where another program runs, that may be the very core which the thread it
# waits for has lost, and would get back in some milliseconds: waiting without end, two threads take several times as
# long as one. So a thread waits as long as the work of the other takes and then leaves what is left to it. It must not
# hold anything that only it would do. Whoever finishes last never waits, so that all gets done.

# Counters of work in two parts, all 0 at the start: tasks begun and tasks finished of the first part, and tasks begun
# of the second part.
BEGUN, FINISHED, BEGUN_LATER = range(3)
COUNTERS = 3
# Time of a look at a counter, about [ns], and a patience for tasks of less than 0.2 ms: some 0.5 ms.
PER_LOOK = 10.0
PATIENCE = 50_000


@func
def load(counters: Integers, i: ti.i32) -> ti.i32:
    """Read a number that other threads change; the compiler may not move this load."""
    return ti.atomic_max(counters[i], 0)


@func
def reaches(counters: Integers, i: ti.i32, count: ti.i32, patience: ti.i32) -> ti.i32:
    """Whether a counter reaches `count` within `patience` readings."""
    looks = 0
    while load(counters, i) < count and looks < patience:
        looks += 1
    return load(counters, i) >= count


# Tiles of 8 x 8 scalars, the unit of all dense arithmetic of the direct solver. A column of a tile is one vector.

TILE = 8
SHIFT = 3  # the logarithm of TILE
HALF = TILE // 2
Column = ti.types.vector(TILE, ti.f64)
Columns: Any = Arrays(Column, 1)


@func
def advance(counter: ti.i32, step: ti.i32, one: ti.i32) -> ti.i32:
    """The counter, which is not negative, plus a step."""
    return ti.max(counter + step, one)


@func
def opaque(index: ti.i32, one: ti.i32) -> ti.i32:
    """An index that is not negative, as it is."""
    return ti.max(index, one - 1)


@func
def tiles_in(scalars: ti.i32) -> ti.i32:
    """How many tiles hold that many rows."""
    return (scalars + TILE - 1) >> SHIFT


@func
def triangle(rows: ti.i32) -> ti.i32:
    """Number of columns of tiles in that many rows of tiles of a lower triangle."""
    return rows * (rows + 1) << SHIFT - 1
