"""Lines and maps that go on across seams: on sheets cut into charts all is known in closed form."""

import math

import pytest
import torch
from charted_shapes import sheet
from torch.utils._python_dispatch import TorchDispatchMode

from texsss.cache import StageCache
from texsss.errors import Cancelled
from texsss.numerics.sampling import bilinear
from texsss.surface import beyond as beyond_module
from texsss.surface.beyond import GUTTER_TEXELS, beyond
from texsss.surface.mesh import Mesh
from texsss.surface.onward import Onward
from texsss.surface.points import Points
from texsss.surface.raster import rasterise

SIDE = 10.0  # of the sheet [mm]


def cut(mirrored: bool = False, scale: float = 0.5) -> Mesh:
    """A sheet whose right half lies elsewhere in uv: turned, at `scale` per side (left .4), or mirrored."""
    whole = sheet(8)
    assert whole.source_uv is not None
    u, v = whole.source_uv.unbind(-1)
    right = (whole.corners[..., 0].mean(1) > SIDE / 2)[:, None]
    left = torch.stack([0.05 + 0.4 * u, 0.05 + 0.4 * v], -1)
    away = (u - 0.5) * scale
    turned = torch.stack([0.4 + scale * (1 - v if mirrored else v), 0.95 - away], -1)
    return Mesh(whole.vertices, whole.faces, torch.where(right[..., None], turned, left))


def anywhere(mesh: Mesh, count: int, seed: int) -> Points:
    generator = torch.Generator().manual_seed(seed)
    bary = torch.rand(count, 3, generator=generator)
    return Points(
        torch.randint(0, len(mesh.faces), (count,), generator=generator).int(),
        bary / bary.sum(-1, keepdim=True),
    )


def uv_of(mesh: Mesh, points: Points, along: torch.Tensor) -> torch.Tensor:
    """Vectors in space [mm] as changes of uv."""
    return torch.linalg.lstsq(points.jacobian(mesh, mesh.source_uv), along[..., None]).solution[..., 0]


def place_in_space(mesh: Mesh, uv: torch.Tensor) -> torch.Tensor:
    """Where on the sheet texture coordinates lie: by the face whose centre is nearest, affinely."""
    face = torch.cdist(uv, mesh.source_uv.mean(1)).argmin(1)
    jacobian = mesh.corners[face], mesh.source_uv[face]
    along = Points(face.int(), torch.zeros(len(face), 3)).jacobian(mesh, mesh.source_uv)
    return jacobian[0][:, 0] + (along @ (uv - jacobian[1][:, 0])[..., None])[..., 0]


@pytest.mark.parametrize("mirrored", [False, True])
def test_lines_on_a_cut_sheet_are_straight_in_space(mirrored):
    mesh = cut(mirrored)
    points = anywhere(mesh, 4000, 0)
    start = points.position(mesh)
    end = (
        torch.rand(len(points), 3, generator=torch.Generator().manual_seed(1))
        * SIDE
        * torch.tensor([1, 1, 0])
    )
    found = Onward(mesh, mesh.source_uv).at(points, uv_of(mesh, points, end - start))
    crossed = (start[:, 0] > SIDE / 2) != (end[:, 0] > SIDE / 2)
    assert 1500 < int(crossed.sum()) < 2500
    torch.testing.assert_close(place_in_space(mesh, found), end, rtol=0, atol=1e-4)  # measured 2e-5


def test_lines_keep_their_length_over_a_fold():
    """The right half stands up: 2 mm before the fold and 5 mm on is 3 mm up."""
    flat = cut()
    x, y, _ = flat.vertices.unbind(-1)
    past = (x - SIDE / 2).clamp_min(0)
    mesh = Mesh(torch.stack([x - past, y, past], -1), flat.faces, flat.source_uv)
    points = anywhere(mesh, 2000, 2)
    at = points.position(mesh)
    rows = (
        ~past[mesh.faces].any(1)[points.face.long()] & (at[:, 0] > 1) & ((at[:, 1] - SIDE / 2).abs() < 4)
    ).nonzero()[:, 0]
    points, at = points[rows], at[rows]
    found = Onward(mesh, mesh.source_uv).at(
        points, uv_of(mesh, points, torch.tensor([[5.0, 0.5, 0]]).expand(len(at), 3))
    )
    expected = torch.stack([torch.full_like(at[:, 0], SIDE / 2), at[:, 1] + 0.5, at[:, 0]], -1)
    far = at[:, 0] + 5 > SIDE / 2
    assert int(far.sum()) > 100
    torch.testing.assert_close(place_in_space(mesh, found)[far], expected[far], rtol=0, atol=1e-4)


def test_lines_end_at_open_edges():
    mesh = sheet(4)
    points = anywhere(mesh, 100, 3)
    found = Onward(mesh, mesh.source_uv).at(points, torch.tensor([[2.0, 0.0]]).expand(100, 2))
    torch.testing.assert_close(found[:, 0], torch.ones(100))
    torch.testing.assert_close(found[:, 1], points.uv(mesh.source_uv)[:, 1])


def test_gradients_are_those_of_straight_lines():
    mesh = cut()
    points = anywhere(mesh, 50, 4)
    shift = torch.full((50, 2), 0.2, requires_grad=True)
    Onward(mesh, mesh.source_uv).at(points, shift).sum().backward()
    torch.testing.assert_close(shift.grad, torch.ones(50, 2))


def painted(mesh: Mesh, size: int) -> torch.Tensor:
    """A map that is a wave over the sheet within charts and 9 elsewhere."""
    texels = rasterise(mesh, mesh.source_uv, (size, size), gutter_texels=0)
    return texels.to_image(wave(texels.points.position(mesh)), fill=9.0)


def wave(place: torch.Tensor) -> torch.Tensor:
    return (0.5 + 0.5 * torch.sin(place[:, :1] / SIDE * 2 * math.pi)) * place[:, 1:2] / SIDE


def test_maps_go_on_beside_their_charts():
    """Points before the seam see the wave beyond it, 4 texels on in their own chart."""
    mesh, size = cut(), 256
    image = painted(mesh, size)
    around = beyond(Onward(mesh, mesh.source_uv), (size, size))
    y = torch.linspace(1, SIDE - 1, 50)
    # uv of the left chart
    uv = torch.stack([torch.full_like(y, 0.05 + 0.2 + 4 / size), 0.05 + 0.4 * (1 - y / SIDE)], -1)
    true = wave(torch.stack([torch.full_like(y, SIDE / 2 + 4 / size / 0.4 * SIDE), y], -1))
    before, after = bilinear(image, uv), bilinear(around.continued(image), uv)
    assert float((before - true).abs().min()) > 5
    torch.testing.assert_close(after, true, rtol=0, atol=2e-3)  # the wave is bilinear between texels
    inside = image != 9.0
    torch.testing.assert_close(around.continued(image)[inside], image[inside], rtol=0, atol=0)


def test_blurs_cross_seams():
    """σ of 4 texels on two charts of one scale: a wave along x fades as in closed form."""
    mesh, size = cut(scale=0.4), 256
    texels_mm = SIDE / (0.4 * size)
    texels = rasterise(mesh, mesh.source_uv, (size, size), gutter_texels=0)
    place = texels.points.position(mesh)
    image = texels.to_image(torch.sin(place[:, :1] * 2 * math.pi / SIDE) + 1)
    blurred = texels.from_image(beyond(Onward(mesh, mesh.source_uv), (size, size)).smoothed(image, 4.0))
    fades = math.exp(-((2 * math.pi / SIDE * 4 * texels_mm) ** 2) / 2)
    # away from the open rim, where there is nothing to blur with
    rows = ((place[:, :2] - SIDE / 2).abs().amax(-1) < SIDE / 2 - 16 * texels_mm).nonzero()[:, 0]
    expected = 1 + fades * torch.sin(place[rows, :1] * 2 * math.pi / SIDE)
    # measured 1.3e-2 at the seam, where looking up between texels blurs, too; 1 where no map goes on
    torch.testing.assert_close(blurred[rows], expected, rtol=0, atol=2e-2)


def test_coordinates_that_tile_are_left_alone():
    mesh = sheet(4)
    image = torch.rand(16, 16, 1, generator=torch.Generator().manual_seed(0))
    around = beyond(Onward(mesh, 3 * mesh.source_uv), (16, 16))
    torch.testing.assert_close(around.continued(image), image, rtol=0, atol=0)


@pytest.mark.parametrize("size", [(300, 200), (80, 256)])
def test_parts_are_as_the_whole_square_at_once(size, monkeypatch):
    """The nearest texel of the charts for every place of the square, all lines in one go."""
    mesh = cut(mirrored=True)
    onward = Onward(mesh, mesh.source_uv)
    texels = rasterise(mesh, mesh.source_uv, size, gutter_texels=0)
    every, near = torch.arange(size[0] * size[1]), texels.nearest.reshape(-1)
    steps = torch.stack([every % size[1] - near % size[1], every // size[1] - near // size[1]], -1)
    away = steps.square().sum(-1)
    texel = ((away > 0) & (away <= GUTTER_TEXELS**2)).nonzero()[:, 0]
    row = torch.empty_like(near).index_copy(0, texels.index, torch.arange(len(texels)))
    shift = steps[texel].double() / torch.tensor([size[1], size[0]])
    monkeypatch.setattr(beyond_module, "CHUNK_TEXELS", 1 << 10)
    around = beyond(onward, size)
    assert torch.equal(around.texel, texel)
    expected = onward.at(texels.points[row[near[texel]]], shift)
    torch.testing.assert_close(around.place, expected, rtol=0, atol=1e-12)  # measured 0


class Largest(TorchDispatchMode):
    """Notes the bytes of the largest tensor that anything returns."""

    bytes = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        found = func(*args, **(kwargs or {}))
        for part in found if isinstance(found, tuple | list) else [found]:
            if isinstance(part, torch.Tensor):
                self.bytes = max(self.bytes, part.nbytes)
        return found


def test_large_maps_take_little_memory_on_the_way(monkeypatch):
    mesh, size = cut(), (1024, 1024)
    monkeypatch.setattr(beyond_module, "CHUNK_TEXELS", 1 << 14)
    with Largest() as largest:
        beyond(Onward(mesh, mesh.source_uv), size)
    # measured 1.4 per texel: what comes back; 16 where the whole square is looked at at once
    assert largest.bytes < 4 * size[0] * size[1]


@pytest.mark.parametrize("last", [False, True])
def test_every_part_can_be_cancelled(last, monkeypatch):
    mesh, asked = cut(), []
    monkeypatch.setattr(beyond_module, "CHUNK_TEXELS", 1 << 12)

    def count() -> bool:
        asked.append(True)
        return len(asked) == stop

    stop = 0
    beyond(Onward(mesh, mesh.source_uv), (256, 256), count)
    assert len(asked) > 8
    stop = len(asked) if last else len(asked) // 2
    asked.clear()
    with pytest.raises(Cancelled):
        beyond(Onward(mesh, mesh.source_uv), (256, 256), count)


@pytest.mark.parametrize(("way", "asked"), [("continued", ()), ("smoothed", (4.0,))])
def test_maps_that_go_on_can_be_cancelled(way, asked, monkeypatch):
    """Before every part of every time that texels beside charts are looked up."""
    mesh, heard = cut(), []
    around = beyond(Onward(mesh, mesh.source_uv), (256, 256))
    monkeypatch.setattr(beyond_module, "CHUNK_TEXELS", 1 << 12)
    image = torch.rand(256, 256, 1, generator=torch.Generator().manual_seed(0))
    getattr(around, way)(image, *asked, cancel=lambda: heard.append(True))
    parts = -(-len(around.texel) // (1 << 12))
    assert parts > 1 and len(heard) == parts * {"continued": 2, "smoothed": 16}[way]
    with pytest.raises(Cancelled):
        getattr(around, way)(image, *asked, cancel=lambda: len(heard.append(True) or heard) % parts == 0)


def test_a_square_without_area_has_nothing_around():
    """All corners on one centre: there is a texel on an edge, but no face owns any."""
    mesh = sheet(2)
    around = beyond(Onward(mesh, torch.full_like(mesh.source_uv, 0.5)), (3, 3))
    assert bool(around.place.isfinite().all())


def test_caches_count_what_lines_need_and_see_no_graph():
    mesh = cut()
    mesh = mesh.moved(mesh.vertices.clone().requires_grad_())
    cache = StageCache(1 << 30)
    onward, _ = cache.get_or_make("seams", lambda: Onward(mesh, mesh.source_uv))
    points = anywhere(mesh, 10, 5)
    onward.at(points, torch.full((10, 2), 0.3))
    parts = list(vars(onward).values())
    assert all(isinstance(part, torch.Tensor) and not part.requires_grad for part in parts)
    held = sum(part.untyped_storage().nbytes() for part in parts)
    assert cache.bytes_used == onward.held_bytes == held > 0
