"""Which contacts are kept, and which of the last step they continue."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Scalars, Vectors, ti

ALIKE = 0.7  # cosine: the two walls of a groove each keep their contacts


@kernel
def spread_out(order: Integers, pairs: Integers, point: Vectors, normal: Vectors, spacing: Scalars, keep: Integers):
    """Of contacts of one pair, alike in normal and closer together than their `spacing`, keep the first in `order`."""
    ti.loop_config(serialize=True)
    for i in range(order.shape[0]):
        c = order[i]
        keep[c] = 1
        for j in range(i):
            other = order[j]
            alike = pairs[other] == pairs[c] and normal[other].dot(normal[c]) > ALIKE
            if keep[other] != 0 and alike and (point[other] - point[c]).norm() < spacing[c]:
                keep[c] = 0


@kernel
def match(
    pairs: Integers,
    point: Vectors,
    old_pairs: Integers,
    old_point: Vectors,
    radius: ti.f64,
    used: Integers,
    matched: Integers,
):
    """For each contact the nearest one of the last step between the same bodies within `radius`, -1 for none."""
    ti.loop_config(serialize=True)
    for c in range(pairs.shape[0]):
        nearest = radius
        matched[c] = -1
        for old in range(old_pairs.shape[0]):
            distance = (old_point[old] - point[c]).norm()
            if old_pairs[old] == pairs[c] and used[old] == 0 and distance < nearest:
                nearest = distance
                matched[c] = old
        if matched[c] >= 0:
            used[matched[c]] = 1
