"""Light through a plate that thickens quickly: bank and octree against random walks, and each other."""

import numpy as np
import pytest
import torch
from reference.plate import Plate

from texsss.light.thickness import far_side
from texsss.light.visibility import Occluder
from texsss.media.medium import Medium
from texsss.media.stack import Stack
from texsss.profiles.project import variance_ladder
from texsss.profiles.through import straight, weights_through
from texsss.profiles.weights import Weights
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.bank import Bank, diffusion, exitance
from texsss.transport.octree.exitance import Surface, emission
from texsss.transport.octree.samples import surface_samples
from texsss.transport.through import Across, on_one_side, transmitted
from texsss.types import Float, Tensor

LOW, HIGH, WIDE = -20.0, 40.0, 60.0  # mm, along x and across
SIGMA_A, SIGMA_S = (0.032, 0.032, 0.17), (0.74, 0.74, 0.88)  # skin1's red twice, and its green
SHADOW = 4.0  # mm, along x, where half the light of the second channel is left
PLACES = (-4.0, 0.0, 2.0, 4.0, 6.0, 8.0, 12.0)  # mm, along x


def fin(x):
    """A fin of .8 mm on a body of 6.8 mm, at most 45° between its sides [mm]."""
    return 0.8 + 6 / (1 + np.exp((5 - x) / 1.5))


def even(x):
    return 3 + 0 * x


def lit(x):
    """Light that all of one side gets, and a part of it."""
    return np.stack([np.ones_like(x), 1 / (1 + np.exp(x - SHADOW)), np.ones_like(x)], -1)


def plate(thickness) -> TexelMaps:
    """Texels of its upper and lower side, 128² in all."""
    columns, rows = 61, 13
    x, y = torch.meshgrid(torch.linspace(LOW, HIGH, columns), torch.linspace(-0.5, 0.5, rows), indexing="ij")
    half = torch.from_numpy(thickness(x.double().numpy()) / 2).float()
    upper = torch.stack([x, WIDE * y, half], -1).reshape(-1, 3)
    first = (torch.arange(columns - 1)[:, None] * rows + torch.arange(rows - 1)).reshape(-1)
    near, beyond = first + rows, first + rows + 1
    faces = torch.cat([torch.stack([first, near, beyond], 1), torch.stack([first, beyond, first + 1], 1)])
    uv = torch.stack([0.02 + 0.46 * (x - LOW) / (HIGH - LOW), 0.5 + 0.96 * y], -1).reshape(-1, 2)
    count, beside = len(upper), torch.tensor([0.5, 0.0])
    mesh = Mesh(
        torch.cat([upper, upper * torch.tensor([1.0, 1, -1])]), torch.cat([faces, faces.flip(1) + count])
    )
    return rasterise(mesh, torch.cat([uv[faces], uv[faces.flip(1)] + beside]), (128, 128))


def light_at(points: Points, mesh: Mesh) -> Float[Tensor, "P 3"]:
    place = points.position(mesh)
    shines = torch.from_numpy(lit(place[:, 0].double().numpy())).float()
    return torch.where(place[:, 2:] < 0, shines, 0)


@pytest.fixture(scope="module", params=[even, fin])
def seen(request) -> tuple[str, Tensor, Tensor, Tensor]:
    """What leaves above at PLACES by the bank, by the octree and by random walks (7, 3)."""
    texels = plate(request.param)
    mesh, stack = texels.mesh, Stack(Medium(list(SIGMA_A), list(SIGMA_S), eta=1.0))
    variances, occluder = variance_ladder(texels.texel_mm, mesh.diagonal_mm), Occluder(mesh)

    def weights(points: Points, spacing: float | None = None) -> tuple[Weights, Weights]:
        far = far_side(points, mesh, occluder)
        back, passed = weights_through(stack, variances, far.thickness)
        return back, passed if spacing is None else straight(passed, far.thickness, spacing)

    far, light = far_side(texels.points, mesh, occluder), light_at(texels.points, mesh)
    blur = on_one_side(diffusion(texels, "surface"), texels.points.normal(mesh))
    bank = Bank(variances, light, blur(light, variances))
    back, passed = weights(texels.points)
    everywhere = exitance(bank, back) + transmitted(bank, passed, Across(far, texels))
    place = texels.points.position(mesh)
    middle = torch.nonzero((place[:, 2] > 0) & (place[:, 1].abs() < 1))[:, 0]
    asked = torch.stack([middle[(place[middle, 0] - x).abs().argmin()] for x in PLACES])

    spacing = 1 / (SIGMA_A[0] + SIGMA_S[0])
    (samples, area), points = surface_samples(mesh, spacing), texels.points[asked]
    sends, takes = (
        Surface(at.position(mesh), at.normal(mesh), light_at(at, mesh), *weights(at, spacing))
        for at in (samples, points)
    )
    tree = emission(sends, area, spacing, rule="exit").exitance(takes)

    walked = []
    for channel in (0, 1, 2):
        solid = Plate(request.param, SIGMA_A[channel], SIGMA_S[channel])
        x = place[asked, 0].double().numpy()
        walked.append(solid.passed(x, lambda x, c=channel: lit(x)[..., c], 3000, seed=channel)[0])
    expected = torch.from_numpy(np.stack(walked, -1)).float()
    return request.param.__name__, everywhere[asked], tree, expected


def apart(found: Tensor, expected: Tensor) -> list[float]:
    """Relative RMS of every channel."""
    return ((found - expected).norm(dim=0) / expected.norm(dim=0)).tolist()


def test_the_bank_passes_what_walks_do(seen):
    """Rays along the normal alone missed 12 to 15 % of the fin's light."""
    name, bank, _, walked = seen
    # measured .021 .046 .045 and .019 .028 .030, of them .02 noise
    most = {"even": 0.07, "fin": 0.05}[name]
    assert max(apart(bank, walked)) < most, apart(bank, walked)


def test_the_octree_passes_what_walks_do(seen):
    """Its spot is wider than theirs, the more so where thin parts are near."""
    name, _, tree, walked = seen
    # measured .021 .023 .044 and .095 .131 .030; .144 .170 .069 by rays along the normal alone
    most = {"even": 0.07, "fin": 0.16}[name]
    assert max(apart(tree, walked)) < most, apart(tree, walked)


def test_bank_and_octree_agree(seen):
    name, bank, tree, _ = seen
    # measured .0014 .037 .0016 and .094 .138 .036; .227 .283 .093 by rays along the normal alone
    limits = {"even": (0.005, 0.05, 0.005), "fin": (0.12, 0.17, 0.05)}[name]
    found = apart(bank, tree)
    assert all(error < limit for error, limit in zip(found, limits, strict=True)), found
