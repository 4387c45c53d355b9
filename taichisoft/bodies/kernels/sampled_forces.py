"""The elastic forces of all integration domains on some nodes."""

from typing import NamedTuple

from taichisoft.bodies.kernels.domain_deformation import Domains, Movement, deformation_and_rate
from taichisoft.bodies.kernels.hooke_domains import corotated_stress
from taichisoft.bodies.kernels.principal_stretches import HOOKE
from taichisoft.bodies.kernels.rubber_domains import respond_by_stretches
from taichisoft.runtime.language import Integers, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel


class DomainsOfNodes(NamedTuple):
    """Which domains have a node.

    Attributes:
        start: where the entries of each node begin, shape (node_count + 1,).
        entry: number among the entries of all domains, shape (entry_count,).
        domain: of each entry of all domains, shape (entry_count,).
    """

    start: Integers
    entry: Integers
    domain: Integers


@kernel
def sample_forces(node: Integers, around: DomainsOfNodes, domains: Domains, movement: Movement, force: Vectors):
    """Forces f - (h + b) K v on nodes [mN], shape (count, 3); a domain counts anew for each of its nodes."""
    ti.loop_config(serialize=True)
    for n in range(node.shape[0]):
        total = vec3(0.0)
        for k in range(around.start[node[n]], around.start[node[n] + 1]):
            c = around.entry[k]
            d = around.domain[c]
            deformation, rate = deformation_and_rate(d, domains, movement)
            stress = ti.Matrix.zero(ti.f64, 3, 3)
            if domains.law[d] == HOOKE:
                _rotation, stress = corotated_stress(d, deformation, rate, domains)
            else:
                stress, _left, _right, _hessian, _same, _swapped = respond_by_stretches(d, deformation, rate, domains)
            total -= stress @ domains.gradient[c]
        force[n] = total
