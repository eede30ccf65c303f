"""A depth map recovered from its own pictures: the march is differentiable in what lies beneath.

    python examples/recover_depth.py

Veins of blood, 0 to .5 mm deep below .2 mm of skin, in a flat patch of 12 mm. From two views of it (and the
media and the lamp) Adam finds the depth of their floor, starting from .25 mm everywhere.
"""

import math

import torch

from texsss.light.emitters import DirectionalLight
from texsss.media.medium import Medium
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.transport.march.interior import from_depths
from texsss.transport.march.march import march
from texsss.transport.march.planes import tangent_planes
from texsss.types import Float, Tensor, unit

SIZE, EDGE_MM, DEEPEST, STEPS = 48, 12.0, 0.5, 150
SKIN = Medium([0.03, 0.14, 0.30], [0.9, 0.9, 0.9], 0.0, 1.4)
BLOOD = Medium([1.2, 4.0, 3.2], [2.0, 1.2, 1.6], 0.0, 1.4)
FLESH = Medium([0.10, 0.55, 0.70], [2.4, 2.2, 2.0], 0.0, 1.4)
LAMP = [DirectionalLight((-0.4, 1.0, 0.3), (1.0, 1.0, 1.0))]
VIEWS = ((0.0, 1.0, 0.05), (0.5, 1.0, 0.3))


def patch() -> tuple[Mesh, Points]:
    """A square, and a point in the middle of every texel."""
    corners = torch.tensor([[-0.5, 0, 0.5], [0.5, 0, 0.5], [0.5, 0, -0.5], [-0.5, 0, -0.5]]) * EDGE_MM
    uv, faces = torch.tensor([[0.0, 1], [1, 1], [1, 0], [0, 0]]), torch.tensor([[0, 1, 2], [0, 2, 3]])
    place = (torch.arange(SIZE) + 0.5) / SIZE
    v, u = (x.reshape(-1) for x in torch.meshgrid(place, place, indexing="ij"))
    # below the diagonal from (0, 1) to (1, 0) the first face, above it the second
    first = torch.stack([1 - u, u + v - 1, 1 - v], -1)
    second = torch.stack([v, u, 1 - u - v], -1)
    lower = u + v > 1
    bary = torch.where(lower[:, None], first, second)
    return Mesh(corners, faces, uv[faces]), Points((~lower).int(), bary)


def pictures(floor: Float[Tensor, "H W"], mesh: Mesh, points: Points) -> Float[Tensor, "V P 3"]:
    """Radiance of every texel towards the two eyes."""
    skin = torch.full_like(floor, 0.2)
    interior = from_depths(torch.stack([skin, skin + floor], -1), [SKIN, BLOOD, FLESH])
    seen = []
    for view in VIEWS:
        towards = unit(torch.tensor(view)).expand(len(points), 3)
        seen.append(march(points, mesh, tangent_planes(mesh), interior, LAMP, towards))
    return torch.stack(seen)


def main() -> None:
    mesh, points = patch()
    y, x = torch.meshgrid(*[torch.arange(SIZE) * 2 * math.pi / SIZE] * 2, indexing="ij")
    true = DEEPEST * torch.exp(-6 * torch.sin(x + 0.8 * torch.sin(2 * y)) ** 2)
    target = pictures(true, mesh, points)
    raw = torch.zeros(SIZE, SIZE, requires_grad=True)
    search = torch.optim.Adam([raw], lr=0.15)
    settle = torch.optim.lr_scheduler.CosineAnnealingLR(search, STEPS)
    for step in range(STEPS):
        search.zero_grad()
        floor = DEEPEST * torch.sigmoid(raw)
        error = ((pictures(floor, mesh, points) - target) ** 2).mean() / (target**2).mean()
        error.backward()
        search.step()
        settle.step()
        if step % 50 == 0:
            print(f"step {step}: pictures differ by {math.sqrt(error.item()):.2%}", flush=True)
    wrong = (DEEPEST * torch.sigmoid(raw.detach()) - true).abs() * 1000
    print(f"pictures differ by {math.sqrt(error.item()):.3%}, depths by {wrong.mean():.1f} µm on average")
    print(f"95 % of the texels within {torch.quantile(wrong, 0.95):.0f} µm")


if __name__ == "__main__":
    main()
