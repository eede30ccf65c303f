"""Weights of the thirteen nodes of a cubic lattice that stand for a point between them.

They are positive, their mean is the point, and their covariance is the same wherever it lies, VARIANCE along
every axis: so light that is spread over nodes has the same shape everywhere. Trilinear weights have eight
nodes and the variance f (1 - f), which shows as the lattice's grain.
"""

from functools import cache
from itertools import permutations, product

import torch
from jaxtyping import UInt8

from texsss.types import Float, Tensor

VARIANCE = 0.25  # along each axis, in edges²; three nodes on a line cannot have less
NODES = 13

AROUND: list[tuple[int, int, int]] = [
    (x, y, z) for x, y, z in product((-1, 0, 1), repeat=3) if 0 in (x, y, z)
]
"""From the nearest node to all that any point next to it may need, in edges."""

MIDDLE = AROUND.index((0, 0, 0))
SIGNS = list(product((1, -1), repeat=3))
ORDERS = list(permutations(range(3)))  # of axes, by how far along each the point lies from the nearest node
# along the farthest axis, the second and the third, towards the point: in the order of `weights`
STEPS = [
    *((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)),
    *((1, 1, 0), (-1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1)),
]


@cache
def kinds() -> UInt8[Tensor, "kinds 13"]:
    """Of every order of axes, and every octant within: the places in AROUND of the nodes."""
    table = []
    for order, sign in product(ORDERS, SIGNS):
        for step in STEPS:
            along = {axis: sign[axis] * one for axis, one in zip(order, step, strict=True)}
            table.append(AROUND.index((along[0], along[1], along[2])))
    return torch.tensor(table, dtype=torch.uint8).view(-1, NODES)


def kind_of(beyond: Float[Tensor, "P 3"]) -> UInt8[Tensor, " P"]:
    """Which row of `kinds` points have that lie `beyond` their nearest nodes, at most ½ along each axis."""
    x, y, z = beyond.abs().unbind(1)
    # by what is not smaller than what, the place among permutations
    table = torch.zeros(8, dtype=torch.uint8, device=beyond.device)
    for a, b, c in product((0, 1), repeat=3):
        order = sorted(range(3), key=lambda axis: -(a + c, 1 - a + b, 2 - b - c)[axis])
        table[4 * a + 2 * b + c] = 8 * ORDERS.index((order[0], order[1], order[2]))
    relation = (x >= y).int() * 4 + (y >= z).int() * 2 + (x >= z).int()
    negative = (beyond < 0).to(torch.uint8)
    return table[relation] + 4 * negative[:, 0] + 2 * negative[:, 1] + negative[:, 2]


def weights(beyond: Float[Tensor, "P 3"], kind: UInt8[Tensor, " P"]) -> Float[Tensor, "P 13"]:
    """Weights of the nodes in the row of `kinds`.

    Along the three axes and their planes: what a tetrahedron gives, whose mean is the point. Then second
    differences, ½ (½ - u)² along each axis, that bring the variance from u (1 - u) to VARIANCE: shared
    between the node's own row and the next by the farther of the other axes, which makes most third moments
    those of quadratic splines.
    """
    order = torch.tensor(ORDERS, device=beyond.device)[(kind // 8).long()]
    u, v, w = beyond.abs().gather(1, order).unbind(1)
    a, b, c = (0.5 * (0.5 - along).square() for along in (u, v, w))
    made = [
        *(u * (1 - v - w) + a * (1 - v) - 2 * u * (b + c), a * (1 - v)),
        *(v * (1 - u - w) + b * (1 - u) - 2 * a * v, b * (1 - u)),
        *(w * (1 - u - v) + c * (1 - u), c * (1 - u)),
        *(u * v + a * v + b * u, a * v, b * u),
        *(u * w + c * u, c * u, v * w),
    ]
    others = torch.stack(made, 1)
    return torch.cat([1 - others.sum(1, keepdim=True), others], 1)
