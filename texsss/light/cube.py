"""A function of directions, tabulated on the faces of a cube: alike everywhere, without poles."""

import torch

from texsss.numerics.sampling import Texture
from texsss.types import Float, Int, Tensor, unit

EDGE = 38  # nodes along an edge: even, so that no axis falls on a node, where slopes are undecided


def nodes() -> Float[Tensor, "D 3"]:
    """Unit directions at which a function is tabulated."""
    step = torch.linspace(-1, 1, EDGE, dtype=torch.float64)
    v, u = torch.meshgrid(step, step, indexing="ij")
    faces = []
    for face in range(6):
        major, one, other = _axes(torch.tensor(face // 2))
        direction = torch.empty(EDGE, EDGE, 3, dtype=torch.float64)
        direction[..., major], direction[..., one], direction[..., other] = 1.0 - 2 * (face % 2), u, v
        faces.append(direction)
    return unit(torch.stack(faces).reshape(-1, 3))


def between(values: Float[Tensor, "D C"], direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P C"]:
    """`values` at the `nodes`, bilinear in between. Differentiable in both."""
    axis = direction.detach().abs().argmax(-1)
    major, one, other = (direction.gather(1, k[:, None])[:, 0] for k in _axes(axis))
    face = 2 * axis + (major.detach() < 0)
    # texel centres at the nodes, so that the faces meet in the same values
    u, v = (((part / major.abs() + 1) / 2 * (EDGE - 1) + 0.5) / EDGE for part in (one, other))
    image = values.reshape(6 * EDGE, EDGE, -1)
    return Texture.of(image).at(torch.stack([u, (face + v) / 6], -1))


def _axes(axis: Int[Tensor, "*P"]) -> tuple[Tensor, Tensor, Tensor]:
    """The axis that a face is on and the two across it."""
    return axis, (axis + 1) % 3, (axis + 2) % 3
