import pytest
import torch
from charted_shapes import sheet
from squares import ball

from texsss.errors import Cancelled
from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps
from texsss.surface.raster import rasterise
from texsss.transport.doubts import doubts

LADDER = torch.tensor([1.0, 100.0])  # mm²


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
        ("coarse", "do not suit a Gaussian of 10 mm"),
        ("fine", "do not suit a Gaussian of 1 mm"),
    ],
)
def test_doubts_name_the_place(name: str, said: str):
    found = doubts(laid_out(name), LADDER)
    assert any(said in sentence and " mm" in sentence for sentence in found), found


def test_where_light_stays_in_charts_only_their_layout_matters():
    assert doubts(laid_out("open"), LADDER, crosses=False) == []
    assert doubts(laid_out("lone"), LADDER, crosses=False) == []
    (said,) = doubts(laid_out("overlap"), LADDER, crosses=False)
    assert "under others in uv" in said


def test_a_sound_surface_leaves_none():
    assert doubts(ball(96), LADDER) == []


def test_stops_on_request_and_tells_how_far_it_is():
    texels, told = laid_out("open"), []
    doubts(texels, LADDER, progress=lambda stage, share: told.append(share))
    assert told[-1] == 1 and told == sorted(told)
    asked = iter([False, False, True])
    with pytest.raises(Cancelled):
        doubts(texels, LADDER, cancel=lambda: next(asked))
