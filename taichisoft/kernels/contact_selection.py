"""Which contacts are kept, and which of the last step they continue."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Scalars, Vectors, ti

ALIKE = 0.7  # cosine: the two walls of a groove each keep their contacts


@kernel
def spread_out(
    count: ti.i32,
    order: Integers,
    key: Integers,
    point: Vectors,
    normal: Vectors,
    spacing: Scalars,
    kept_count: Integers,
    kept: Integers,
):
    """Of contacts of one pair, alike in normal and closer together than their `spacing`, keep the first in `order`."""
    ti.loop_config(serialize=True)
    for i in range(count):
        c = order[i]
        if i == 0:
            kept_count[0] = 0
        stands_alone = 1
        for j in range(kept_count[0]):
            other = kept[j]
            if (
                key[other] == key[c]
                and (point[other] - point[c]).norm_sqr() < spacing[c] * spacing[c]
                and normal[other].dot(normal[c]) > ALIKE
            ):
                stands_alone = 0
                break
        if stands_alone:
            kept[kept_count[0]] = c
            kept_count[0] = kept_count[0] + 1


@kernel
def match(
    count: ti.i32,
    key: Integers,
    point: Vectors,
    last_count: ti.i32,
    last_key: Integers,
    last_point: Vectors,
    radius: ti.f64,
    used: Integers,
    matched: Integers,
):
    """For each contact the nearest one of the last step between the same bodies within `radius`, -1 for none."""
    ti.loop_config(serialize=True)
    for last in range(last_count):
        used[last] = 0
    ti.loop_config(serialize=True)
    for c in range(count):
        nearest = radius * radius
        matched[c] = -1
        for last in range(last_count):
            if last_key[last] == key[c] and used[last] == 0:
                distance = (last_point[last] - point[c]).norm_sqr()
                if distance < nearest:
                    nearest = distance
                    matched[c] = last
        if matched[c] >= 0:
            used[matched[c]] = 1
