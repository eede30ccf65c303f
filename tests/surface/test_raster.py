"""The raster against a literal twin, and the laws it is made for."""

import itertools

import pytest
import torch
from charted_shapes import sheet, soup, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from texsss.errors import Cancelled, DomainError, ShapeError
from texsss.numerics.sampling import bilinear
from texsss.surface.mesh import Mesh
from texsss.surface.raster import contested_area, rasterise


def triangles(uv) -> Mesh:
    """A mesh whose positions are its uv, 10 mm wide."""
    uv = torch.as_tensor(uv, dtype=torch.float32)
    vertices = torch.cat([uv.reshape(-1, 2) * 10, torch.zeros(uv.numel() // 2, 1)], -1)
    vertices = torch.cat([vertices, torch.tensor([[0.0, 10, 0]])])  # so that it has an extent
    return Mesh(vertices, torch.arange(3 * len(uv)).reshape(-1, 3), uv)


def owners(maps) -> torch.Tensor:
    """Face of every covered texel (H, W), −1 elsewhere."""
    covered = maps.covered
    image = torch.full((maps.size[0] * maps.size[1],), -1)
    image[maps.points.texel[covered].long()] = maps.points.face[covered].long()
    return image.reshape(maps.size)


def twin(uv: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Owners by testing every centre against every triangle in whole numbers of 2⁻¹⁶ texel."""
    height, width = size
    image = torch.full(size, -1)
    corners = [
        [(round(u * width * 65536), round(v * height * 65536)) for u, v in triangle]
        for triangle in uv.double().tolist()
    ]
    for face, (a, b, c) in reversed(list(enumerate(corners))):
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        ring = (a, b, c) if area > 0 else (c, b, a)
        for i, j in itertools.product(range(height), range(width)):
            x, y = j * 65536 + 32768, i * 65536 + 32768
            inside = area != 0
            for p, q in zip(ring, (*ring[1:], ring[0])):
                side = (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
                left_or_top = q[1] < p[1] or (q[1] == p[1] and q[0] > p[0])
                inside = inside and (side > 0 or (side == 0 and left_or_top))
            if inside:
                image[i, j] = face
    return image


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("size", [(7, 9), (12, 5)])
def test_random_triangles_agree_with_exact_twin(seed, size):
    """Overlaps and slivers included, the lowest face wins."""
    mesh = soup(seed, 7, size=0.6)
    assert torch.equal(owners(rasterise(mesh, mesh.source_uv, size)), twin(mesh.source_uv, size))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 16), min_size=12, max_size=12))
def test_corners_and_edges_on_centres_agree_with_exact_twin(numbers):
    """On a grid of half texels every tie there is occurs."""
    mesh = triangles(torch.tensor(numbers, dtype=torch.float32).reshape(2, 3, 2) / 16)
    assert torch.equal(owners(rasterise(mesh, mesh.source_uv, (8, 8))), twin(mesh.source_uv, (8, 8)))


@pytest.mark.parametrize("turned", [False, True], ids=["as is", "mirrored"])
@pytest.mark.parametrize("size", [16, 17, 64])
def test_triangles_around_shared_vertices_leave_no_hole(size, turned):
    """A fan and a grid of the whole square: each texel has exactly one owner, whatever the orientation."""
    mesh = sheet(8)
    uv = mesh.source_uv.flip(1) if turned else mesh.source_uv
    maps = rasterise(mesh, uv, (size, size))
    assert maps.covered_count == size * size
    # no texel is claimed twice: nothing is contested
    assert float(contested_area(mesh, uv, (size, size)).sum()) == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(5, 40))
def test_random_fans_partition_what_they_cover(seed, size):
    """Triangles around an inner point, together the square: all texels owned, none contested."""
    generator = torch.Generator().manual_seed(seed)
    middle = torch.rand(2, generator=generator) * 0.8 + 0.1
    rim = torch.tensor([[0.0, 0], [0.3, 0], [1, 0], [1, 0.7], [1, 1], [0.5, 1], [0, 1], [0, 0.2]])
    uv = torch.stack([middle.expand_as(rim), rim, rim.roll(-1, 0)], 1)
    mesh = triangles(uv)
    maps = rasterise(mesh, uv, (size, size + 3))
    assert maps.covered_count == size * (size + 3)
    assert float(contested_area(mesh, uv, (size, size + 3)).sum()) == 0


def test_barycentrics_are_those_of_the_centres():
    """Σ b uv is the centre, to a 2⁻¹⁶ of a texel, and weights are a partition of one."""
    mesh = soup(3, 40, size=0.7)
    size = (96, 64)
    maps = rasterise(mesh, mesh.source_uv, size)
    texel = maps.points.texel.long()
    centre = torch.stack([(texel % 64 + 0.5) / 64, (texel // 64 + 0.5) / 96], -1)
    inside = maps.covered
    off = (maps.points.uv(mesh.source_uv) - centre)[inside] * torch.tensor([64.0, 96.0])
    assert off.abs().max() < 1e-4  # measured 4e-5 texel: slivers in float32
    assert maps.points.bary[inside].min() >= 0
    torch.testing.assert_close(maps.points.bary.sum(-1), torch.ones(len(maps)), rtol=0, atol=1e-4)


def test_covered_come_first_each_part_in_row_major_order():
    mesh = soup(5, 12, size=0.4)
    maps = rasterise(mesh, mesh.source_uv, (50, 40))
    count = maps.covered_count
    assert bool(maps.covered[:count].all()) and not bool(maps.covered[count:].any())
    for part in (maps.points.texel[:count], maps.points.texel[count:]):
        assert bool((part[1:] > part[:-1]).all())
    assert len(torch.unique(maps.points.texel)) == len(maps)
    assert maps.area[count:].abs().max() == 0


def test_gutter_is_every_texel_in_reach_and_continues_the_nearest_triangle():
    """Against all pairs of centres and triangles in float64; affine continuation lands on the centre."""
    uv = torch.tensor([[[0.3, 0.3], [0.62, 0.35], [0.4, 0.7]], [[0.71, 0.8], [0.9, 0.82], [0.8, 0.95]]])
    mesh = triangles(uv)
    n = 32
    maps = rasterise(mesh, uv, (n, n))
    j, i = torch.meshgrid(torch.arange(n) + 0.5, torch.arange(n) + 0.5, indexing="xy")
    centre = torch.stack([j, i], -1).reshape(-1, 1, 2).double()
    a, b = (uv * n).double().reshape(1, -1, 2), (uv * n).double().roll(-1, 1).reshape(1, -1, 2)
    t = (((centre - a) * (b - a)).sum(-1) / (b - a).square().sum(-1)).clamp(0, 1)
    distance = torch.linalg.vector_norm(centre - (a + t[..., None] * (b - a)), dim=-1)
    near, edge = distance.min(-1)
    outside = (owners(maps) < 0).reshape(-1)
    expected = torch.nonzero(outside & (near <= 2.2))[:, 0]
    gutter = ~maps.covered
    assert torch.equal(maps.points.texel[gutter].long(), expected)
    assert torch.equal(maps.points.face[gutter].long(), edge[expected] // 3)
    landed = maps.points.uv(uv)[gutter] * n
    torch.testing.assert_close(landed.double(), centre[expected, 0], rtol=0, atol=1e-4)


@pytest.mark.parametrize("size", [8, 33, 128])
def test_bilinear_look_ups_never_meet_an_empty_texel(size):
    """From 20 000 random points of the surface, with triangles far below a texel among them."""
    mesh = soup(11, 60, size=0.08)
    maps = rasterise(mesh, mesh.source_uv, (size, size))
    full = maps.to_image(torch.ones(len(maps), 1))
    generator = torch.Generator().manual_seed(1)
    face = torch.randint(60, (20_000,), generator=generator)
    bary = torch.distributions.Dirichlet(torch.ones(3)).sample((20_000,))
    uv = (mesh.source_uv[face] * bary[..., None]).sum(1)
    assert bilinear(full, uv).min() == pytest.approx(1, abs=1e-6)


def test_slivers_do_not_throw_the_gutter_off():
    """A strip a thousandth of a texel wide but 5 mm on the surface: steps stay below four typical texels."""
    uv = torch.tensor([[[0.1, 0.1], [0.5, 0.1], [0.1, 0.5]], [[0.7, 0.2], [0.7, 0.8], [0.70002, 0.5]]])
    mesh = triangles(uv)
    vertices = mesh.vertices.clone()
    vertices[5, 0] += 5
    mesh = mesh.moved(vertices)
    maps = rasterise(mesh, uv, (64, 64))
    there = maps.points.position(mesh)[~maps.covered]
    # unlimited, the affine continuation reaches 8000 mm
    low, high = mesh.vertices.amin(0) - 2, mesh.vertices.amax(0) + 2
    assert bool(((there > low) & (there < high)).all())


def test_area_of_texels_is_the_area_of_the_surface():
    mesh = sphere(24, 48)
    maps = rasterise(mesh, mesh.source_uv, (256, 256))
    # centres sample every triangle's area; measured 2e-3, poles being single rows of triangles
    torch.testing.assert_close(maps.area.sum(), mesh.face_area.sum(), rtol=5e-3, atol=0)


def test_contested_area_counts_what_lies_on_top():
    """Two equal sheets on each other: the second one loses all; mirrored ones the same."""
    mesh = sheet(4)
    both = Mesh(
        torch.cat([mesh.vertices, mesh.vertices + torch.tensor([0.0, 0, 1])]),
        torch.cat([mesh.faces, mesh.faces + len(mesh.vertices)]),
    )
    uv = torch.cat([mesh.source_uv, mesh.source_uv * torch.tensor([-1.0, 1]) + torch.tensor([1.0, 0])])
    lost = contested_area(both, uv, (128, 128))
    assert float(lost[:32].sum()) == 0
    torch.testing.assert_close(float(lost[32:].sum()), 100.0, rtol=1e-6, atol=0)


def test_same_bytes_every_time_and_progress_to_one():
    mesh = soup(8, 500, size=0.1)
    steps = []
    first = rasterise(
        mesh, mesh.source_uv, (200, 100), progress=lambda name, share: steps.append((name, share))
    )
    second = rasterise(mesh, mesh.source_uv, (200, 100))
    assert torch.equal(first.points.texel, second.points.texel)
    assert torch.equal(first.points.face, second.points.face)
    assert torch.equal(first.points.bary, second.points.bary)
    assert steps[-1] == ("raster", 1.0) and sorted(steps) == steps


def test_bad_input_is_named():
    mesh = sheet(2)
    with pytest.raises(DomainError, match="size of 1"):
        rasterise(mesh, mesh.source_uv, (0, 10))
    with pytest.raises(DomainError, match="size of 1"):
        rasterise(mesh, mesh.source_uv, (10**6, 10))
    with pytest.raises(ShapeError, match="8 faces, got 1"):
        rasterise(mesh, mesh.source_uv[:1], (10, 10))
    for wrong in (float("nan"), 1e6):
        with pytest.raises(DomainError, match="unit square"):
            rasterise(mesh, mesh.source_uv * wrong, (10, 10))
    with pytest.raises(Cancelled):
        rasterise(mesh, mesh.source_uv, (10, 10), cancel=lambda: True)


def test_faces_without_area_own_nothing():
    mesh = triangles([[[0.2, 0.2], [0.8, 0.8], [0.5, 0.5]]])
    maps = rasterise(mesh, mesh.source_uv, (32, 32))
    assert maps.covered_count == 0
    assert len(maps) > 0  # but look-ups on its line find a gutter
    assert bool(torch.isfinite(maps.points.position(mesh)).all())
