"""The cone x_0 >= |(x_1, x_2)| and its algebra (Alizadeh and Goldfarb 2003, Second-order cone programming)."""

from taichisoft.runtime.language import func, ti, vec3


@func
def cone_product(a: vec3, b: vec3) -> vec3:
    """Product a o b of the cone's algebra."""
    return vec3(a.dot(b), a[0] * b[1] + b[0] * a[1], a[0] * b[2] + b[0] * a[2])


@func
def cone_quotient(a: vec3, b: vec3) -> vec3:
    """Solution z of a o z = b, for a inside the cone."""
    first = (a[0] * b[0] - a[1] * b[1] - a[2] * b[2]) / (a[0] * a[0] - a[1] * a[1] - a[2] * a[2])
    return vec3(first, (b[1] - a[1] * first) / a[0], (b[2] - a[2] * first) / a[0])


@func
def way_to_boundary(x: vec3, step: vec3) -> ti.f64:
    """Largest t with x + t step in the cone, at most 1e30."""
    a = step[0] * step[0] - step[1] * step[1] - step[2] * step[2]
    b = x[0] * step[0] - x[1] * step[1] - x[2] * step[2]
    c = x[0] * x[0] - x[1] * x[1] - x[2] * x[2]
    t = 1e30
    if step[0] < 0.0:
        t = -x[0] / step[0]
    root = b * b - a * c
    if root >= 0.0:
        q = -(b + ti.sqrt(root))
        if b < 0.0:
            q = -(b - ti.sqrt(root))
        if q != 0.0 and c / q > 0.0:
            t = ti.min(t, c / q)
        if a != 0.0 and q / a > 0.0:
            t = ti.min(t, q / a)
    return t
