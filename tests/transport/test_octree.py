"""Hierarchical integration against the sum over all pairs, laws of its samples, and its cost."""

import math
from typing import Any

import pytest
import torch
from shapes import sphere, together
from shapes import square as plate

from texsss.errors import Cancelled, DomainError, ShapeError
from texsss.profiles.weights import Weights
from texsss.surface.mesh import Mesh
from texsss.transport.octree.blocks import blocks
from texsss.transport.octree.exitance import LEAST_FACING, Surface, emission
from texsss.transport.octree.integrate import integrated
from texsss.transport.octree.samples import affordable_spacing, surface_samples
from texsss.transport.octree.sources import sources
from texsss.transport.octree.tree import octree
from texsss.types import Float, Tensor

VARIANCES = torch.tensor([0.0, 30.0, 120.0, 700.0])  # mm²
SPACING = 5.0


def test_no_point_of_a_triangle_is_farther_from_a_sample_than_the_spacing():
    generator = torch.Generator().manual_seed(0)
    mesh = Mesh(torch.rand(30, 3, generator=generator) * 20, torch.arange(30).reshape(10, 3))
    points, area = surface_samples(mesh, 1.5)
    torch.testing.assert_close(area.sum(), mesh.face_area.sum())
    bary = torch.rand(4000, 3, generator=generator)
    bary = bary / bary.sum(1, keepdim=True)
    for face in range(10):
        samples = points.position(mesh)[points.face == face]
        anywhere = bary @ mesh.corners[face]
        assert float(torch.cdist(anywhere, samples).amin(1).max()) <= 1.5 + 1e-4


def test_a_node_holds_the_points_of_its_children():
    position = torch.rand(1000, 3, generator=torch.Generator().manual_seed(1)) * torch.tensor([9.0, 3, 1])
    tree = octree(position, 4)
    assert sorted(tree.order.tolist()) == list(range(1000))
    assert int((tree.stop - tree.start)[tree.children == 0].max()) <= 4
    for node in torch.nonzero(tree.children > 0)[:, 0].tolist():
        own = slice(int(tree.child[node]), int(tree.child[node] + tree.children[node]))
        assert int(tree.start[own][0]) == int(tree.start[node])
        assert torch.equal(tree.start[own][1:], tree.stop[own][:-1])
        assert int(tree.stop[own][-1]) == int(tree.stop[node])
    place = position[tree.order]
    for node in range(0, len(tree), 37):
        inside = place[tree.start[node] : tree.stop[node]]
        assert torch.equal(inside.amin(0), tree.low[node]) and torch.equal(inside.amax(0), tree.high[node])
    torch.testing.assert_close(tree.sums(place)[0], position.sum(0))


def test_coincident_points_end_in_one_leaf():
    tree = octree(torch.ones(50, 3), 4)
    assert len(tree) < 40 and int(tree.stop[-1]) == 50


@pytest.mark.parametrize("count", [1, 7, 256, 257, 1000])
def test_blocks_hold_every_point(count: int):
    position = torch.rand(count, 3, generator=torch.Generator().manual_seed(2))
    found = blocks(position, 64)
    assert found.member.shape[1] <= 64
    assert found.member.unique().tolist() == list(range(count))
    away = (position[found.member] - found.centre[:, None]).norm(dim=2)
    assert bool((away <= found.radius[:, None] + 1e-6).all())


def lit_surface(mesh: Mesh, spacing: float, rows: int = 5, through: bool = False) -> tuple[Surface, Tensor]:
    """Samples of a mesh with light from one side and profiles that change from place to place."""
    points, area = surface_samples(mesh, spacing)
    position, normal = points.position(mesh), points.normal(mesh)
    generator = torch.Generator().manual_seed(3)
    irradiance = (normal @ normal.new_tensor([0.3, 0.4, 0.86])).clamp_min(0)[:, None] * torch.rand(
        3, generator=generator
    ) + 0.3 * (torch.sin(position / 9).prod(1, keepdim=True) > 0)
    row = (position[:, 0] * 0.2).long() % rows
    reflected = Weights(VARIANCES, torch.rand(rows, 4, 3, generator=generator), row)
    passed = Weights(VARIANCES, torch.rand(rows, 4, 3, generator=generator), row) if through else None
    return Surface(position, normal, irradiance, reflected, passed), area


def hierarchical(
    samples: Surface,
    area: Tensor,
    spacing: float,
    rule: str = "entry",
    normalise: bool = True,
    **options: Any,
) -> Float[Tensor, "P 3"]:
    """Exitance at the samples themselves."""
    sent = emission(samples, area, spacing, rule=rule, normalise=normalise)
    return sent.exitance(samples, **options)


def all_pairs(
    samples: Surface, area: Tensor, some: Tensor, rule: str, normalise: bool
) -> Float[Tensor, "Q 3"]:
    """The sum without a tree, in float64, with receivers `some` of the samples."""
    position, normal = samples.position.double(), samples.normal.double()
    squared = torch.cdist(position[some], position).square()
    facing = normal[some] @ normal.T
    light = samples.irradiance.double() * area.double()[:, None]
    sides = [(samples.reflected, (1 + facing) / 2), (samples.through, (1 - facing) / 2)]
    if samples.through is None:
        sides = [(samples.reflected, torch.ones_like(facing))]
    total = samples.reflected.at(some)[:, 0].double() * samples.irradiance[some].double()
    for k in range(1, len(VARIANCES)):
        variance = float(VARIANCES[k])
        kernel = torch.exp(-squared / (2 * variance)) / (2 * math.pi * variance)
        reached = kernel @ area.double()[:, None]
        for weights, gate in sides:
            assert weights is not None
            if normalise and weights is samples.reflected:
                whole = torch.maximum((kernel * gate) @ area.double()[:, None], LEAST_FACING * reached)
                gate = gate / whole
            own = weights.at()[:, k].double()
            if rule == "entry":
                total = total + (kernel * gate) @ (light * own)
            elif rule == "exit":
                total = total + own[some] * ((kernel * gate) @ light)
            else:
                table = weights.table.double().clamp_min(0)
                root = table.sqrt()[weights.row.long()][:, k]
                total = total + root[some] * ((kernel * gate) @ (light * root))
    return total


@pytest.mark.parametrize("normalise", [False, True])
@pytest.mark.parametrize("through", [False, True])
@pytest.mark.parametrize("rule", ["exit", "entry", "geometric-mean"])
def test_it_is_the_sum_over_all_pairs(rule: str, through: bool, normalise: bool):
    samples, area = lit_surface(sphere(subdivisions=3), SPACING, through=through)
    some = torch.arange(0, len(area), 23)
    found = hierarchical(samples, area, SPACING, rule, normalise, epsilon=0.05)[some].double()
    expected = all_pairs(samples, area, some, rule, normalise)
    assert float((found - expected).norm() / expected.norm()) < 1e-3


@pytest.mark.parametrize("through", [False, True])
def test_even_light_comes_back_evenly(through: bool):
    """From two sheets that face each other across a crease, and from their rims, where the sum does not."""
    lower, upper = plate(side=100.0, z=-2.0), plate(side=100.0)
    mesh = together(lower, Mesh(upper.vertices, upper.faces.flip(1)))
    samples, area = lit_surface(mesh, 4.0, rows=1, through=through)
    dark = (
        None
        if samples.through is None
        else Weights(VARIANCES, samples.through.table * 0, samples.through.row)
    )
    even = Surface(samples.position, samples.normal, torch.ones_like(samples.normal), samples.reflected, dark)
    found = hierarchical(even, area, 4.0, epsilon=0.05)
    torch.testing.assert_close(found, samples.reflected.total, rtol=1e-5, atol=0)
    if not through:
        middle = samples.position[:, :2].norm(dim=1) < 5
        plain = hierarchical(even, area, 4.0, normalise=False)
        assert float((plain / samples.reflected.total)[middle].min()) > 1.5


def test_the_error_falls_with_epsilon():
    samples, area = lit_surface(sphere(subdivisions=3), SPACING)
    some = torch.arange(0, len(area), 23)
    expected = all_pairs(samples, area, some, "exit", True)
    errors = []
    for epsilon in (1.0, 0.3, 0.1, 0.03):
        found = hierarchical(samples, area, SPACING, rule="exit", epsilon=epsilon)[some]
        errors.append(float((found.double() - expected).norm() / expected.norm()))
    assert errors == sorted(errors, reverse=True) and errors[0] < 0.05


def test_constant_light_on_a_plane_comes_back_as_the_total():
    samples, area = lit_surface(plate(side=400.0), 4.0, rows=1)
    flat = Surface(samples.position, samples.normal, torch.ones_like(samples.irradiance), samples.reflected)
    centre = samples.position.norm(dim=1) < 60
    found = hierarchical(flat, area, 4.0)[centre]
    torch.testing.assert_close(found, samples.reflected.total[centre], rtol=0.005, atol=0)


def test_light_from_the_far_side_is_what_passes():
    """Two plates face away from each other; only the lower one is lit: the upper one shows T alone."""
    lower, upper = plate(side=400.0, z=-10.0), plate(side=400.0)
    mesh = together(upper, Mesh(lower.vertices, lower.faces.flip(1)))
    samples, area = lit_surface(mesh, 4.0, rows=1, through=True)
    below = samples.normal[:, 2] < 0
    light = below[:, None].float().expand(-1, 3)
    assert samples.through is not None
    dark = Surface(samples.position, samples.normal, light, samples.reflected, samples.through)
    found = hierarchical(dark, area, 4.0)
    middle = ~below & (samples.position.norm(dim=1) < 60)
    falls = torch.exp(-(10.0**2) / (2 * VARIANCES[1:]))[:, None]  # straight distances are 10 mm and more
    expected = (samples.through.table[0, 1:] * falls).sum(0)
    torch.testing.assert_close(found[middle].mean(0), expected, rtol=0.01, atol=0)


def test_narrow_gaussians_weigh_the_light_of_the_place_itself():
    samples, area = lit_surface(sphere(subdivisions=3), 60.0)
    found = hierarchical(samples, area, 60.0)
    torch.testing.assert_close(found, samples.reflected.total * samples.irradiance)


def test_it_can_be_stopped_and_says_how_far_it_is():
    samples, area = lit_surface(sphere(subdivisions=2), SPACING)
    heard = []
    hierarchical(samples, area, SPACING, progress=lambda _, share: heard.append(share))
    assert heard == sorted(heard) and heard[-1] == 1.0
    with pytest.raises(Cancelled):
        hierarchical(samples, area, SPACING, cancel=lambda: True)


def test_bad_input_is_answered():
    mesh = sphere(subdivisions=2)
    for spacing in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(DomainError, match="spacing"):
            surface_samples(mesh, spacing)
    with pytest.raises(DomainError, match="try a spacing of"):
        surface_samples(mesh, 0.02)
    least = affordable_spacing(mesh, 0.02)
    assert len(surface_samples(mesh, least)[1]) <= 3_000_000
    flat = Mesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), torch.tensor([[0, 1, 2]]))
    with pytest.raises(DomainError, match="no area"):
        surface_samples(flat, 1.0)
    samples, area = lit_surface(mesh, 20.0)
    with pytest.raises(DomainError, match="rule"):
        hierarchical(samples, area, 20.0, rule="both")
    with pytest.raises(DomainError, match="epsilon"):
        hierarchical(samples, area, 20.0, epsilon=0.0)
    with pytest.raises(ShapeError, match="receivers"):
        sent = sources(samples.position, area, area, samples.irradiance[None])
        integrated(sent, torch.zeros(0, 3), torch.ones(1), lambda rows, sums: sums[0].T, epsilon=0.1)


def test_darkness_sends_nothing():
    samples, area = lit_surface(sphere(subdivisions=2), SPACING)
    dark = Surface(samples.position, samples.normal, torch.zeros_like(samples.normal), samples.reflected)
    assert float(hierarchical(dark, area, SPACING).abs().max()) == 0.0
