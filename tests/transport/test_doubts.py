import pytest
import torch
from charted_shapes import sheet
from squares import ball

from texsss.errors import Cancelled
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.doubts import doubts, unsuited

SPREADS = 1.0, 10.0  # mm


def closed() -> Mesh:
    """A tetrahedron of about 10 mm."""
    vertices = torch.tensor([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]])
    return Mesh(vertices, torch.tensor([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


def apart(count: int) -> torch.Tensor:
    """A chart for every face, side by side in a row, with gaps between."""
    corner = torch.tensor([[0.0, 0.0], [0.7, 0.0], [0.0, 0.7]])
    return torch.stack([(corner + torch.tensor([i + 0.15, 0.15])) / count for i in range(count)])


def laid_out(name: str) -> TexelMaps:
    if name == "open":
        mesh = sheet(2)
        assert mesh.source_uv is not None
        return rasterise(mesh, mesh.source_uv, (32, 32))
    mesh = closed()
    if name == "non-manifold":
        fin = torch.tensor([[0, 1, 4], [1, 0, 4]])
        mesh = Mesh(torch.cat([mesh.vertices, torch.tensor([[0.0, -5, -5]])]), torch.cat([mesh.faces, fin]))
    if name == "lone":
        mesh = Mesh(
            torch.cat([mesh.vertices, torch.tensor([[50.0, 0, 0], [60, 0, 0], [50, 9, 0]])]),
            torch.cat([mesh.faces, torch.tensor([[4, 5, 6]])]),
        )
    uv = apart(len(mesh.faces))
    if name == "no padding":  # the other half of a square
        uv[0] = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) / 4
        uv[1] = torch.tensor([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]) / 4
        uv[2:] += torch.tensor([0.0, 0.5])
    if name == "overlap":
        uv[1] = uv[0]
    if name == "starved":
        uv[1] = uv[1].mean(0) + (uv[1] - uv[1].mean(0)) / 1000
    scale = {"coarse": 1e5, "fine": 1e-4}.get(name, 1.0)
    return rasterise(Mesh(mesh.vertices * scale, mesh.faces), uv, (64, 64))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("open", "surface is open: light ends at 8 edges, as near ("),
        ("non-manifold", "1 edges join more than two faces, as near (5, 0, 0) mm"),
        ("lone", "1 of 5 charts share no edge with another, as near (53.33, 3, 0) mm"),
        ("overlap", "1 face lies under others in uv, lit as those are, as near ("),
        ("no padding", "touch another chart, as near ("),
        ("starved", "1 chart holds no texel, 50 mm² in all, as near (3.333, 0, 3.333) mm"),
    ],
)
def test_doubts_name_the_place(name: str, said: str):
    found = doubts(laid_out(name))
    assert any(said in sentence and " mm" in sentence for sentence in found), found


@pytest.mark.parametrize(
    ("name", "than", "remedy"),
    [
        ("coarse", "more than 100 times as wide as the material spreads light (10 mm)", "more room in uv"),
        ("fine", "less than 0.01 times as wide as the material spreads light (1 mm)", "smaller atlas"),
    ],
)
def test_texels_that_do_not_suit_are_counted_and_placed(name: str, than: str, remedy: str):
    texels = laid_out(name)
    (said,) = unsuited(texels, *SPREADS)
    assert than in said and remedy in said and f"{texels.covered_count:,} texels" in said
    assert "100.00% of all, as that of " in said and " mm near (" in said


def test_one_chart_of_coarse_texels_is_where_it_is_said_to_be():
    mesh = closed()
    uv = apart(len(mesh.faces))
    uv[3] = uv[3, :1] + (uv[3] - uv[3, :1]) / 5  # the slanted face
    texels = rasterise(mesh, uv, (256, 256))
    own = texels.points.face == 3
    edge = float(texels.area[own & texels.covered].amax().sqrt())
    (said,) = unsuited(texels, 0.0, edge / 150)
    assert f"{int((own & texels.covered).sum()):,} texels are" in said and f"as that of {edge:.3g} mm" in said
    at = torch.tensor([float(x) for x in said.split("near (")[1].split(")")[0].split(", ")])
    assert float(at.sum()) == pytest.approx(10, abs=0.01)  # x + y + z = 10 there


def test_where_light_stays_in_charts_only_their_layout_matters():
    assert doubts(laid_out("open"), crosses=False) == []
    assert doubts(laid_out("lone"), crosses=False) == []
    (said,) = doubts(laid_out("overlap"), crosses=False)
    assert "under others in uv" in said


def test_a_sound_surface_leaves_none():
    assert doubts(ball(96)) == [] and unsuited(ball(96), *SPREADS) == []


def test_stops_on_request_and_tells_how_far_it_is():
    texels, told = laid_out("open"), []
    doubts(texels, progress=lambda stage, share: told.append(share))
    assert told[-1] == 1 and told == sorted(told)
    asked = iter([False, True])
    with pytest.raises(Cancelled):
        doubts(texels, cancel=lambda: next(asked))
