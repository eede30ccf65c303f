"""Which texture coordinates serve, and what is made where they don't."""

import signal
import subprocess
import time

import pytest
import torch
from charted_shapes import sheet, soup, sphere

from texsss.errors import Cancelled, DomainError
from texsss.io.meshes import read_mesh
from texsss.surface import _scanline
from texsss.surface._scanline import spans
from texsss.surface.atlas import examine_uv, make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.raster import contested_area, rasterise, snapped
from texsss.surface.topology import charts


def gap_texels(atlas, size: int) -> float:
    """The least distance between covered texels of different charts, by brute force on their borders."""
    maps = rasterise(atlas.mesh, atlas.uv, (size, size))
    inside = maps.covered
    chart = torch.full((size * size,), -1)
    chart[maps.points.texel[inside].long()] = atlas.chart[maps.points.face[inside].long()]
    chart = chart.reshape(size, size)
    for reach in range(1, 12):
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                here = chart[max(0, dy) : size + min(0, dy), max(0, dx) : size + min(0, dx)]
                there = chart[max(0, -dy) : size + min(0, -dy), max(0, -dx) : size + min(0, -dx)]
                if bool(((here >= 0) & (there >= 0) & (here != there)).any()):
                    return reach
    return 12


class Made:
    """An atlas together with the mesh that it was made for."""

    def __init__(self, mesh, rule, **options):
        self.mesh = mesh
        self.atlas = make_atlas(mesh, rule, **options)
        self.uv, self.chart = self.atlas.uv, self.atlas.chart


def test_a_sheet_keeps_its_authors_coordinates():
    mesh = sheet(4)
    atlas = make_atlas(mesh, size=64)
    assert atlas.origin == "source" and torch.equal(atlas.uv, mesh.source_uv)
    assert atlas.report.charts == 1 and atlas.report.serves and not atlas.report.messages


def test_mirrored_charts_serve():
    mesh = sheet(4)
    mirrored = Mesh(
        mesh.vertices, mesh.faces, mesh.source_uv * torch.tensor([-1.0, 1]) + torch.tensor([1.0, 0])
    )
    assert make_atlas(mirrored, size=64).origin == "source"


@pytest.mark.parametrize(
    "spoil, word",
    [
        (lambda uv: uv * 7 - 3, "leave the unit square"),
        (lambda uv: uv * 0 + 0.5, "flat"),
        (lambda uv: (uv - torch.tensor([0.5, 0])).abs() * torch.tensor([2.0, 1]), "overlaps"),
        (lambda uv: uv * 1e-4 + 0.3, "without a texel"),
    ],
    ids=["outside", "flat", "mirrored halves overlap", "too small"],
)
def test_coordinates_that_cannot_store_light_are_replaced(spoil, word):
    mesh = sheet(4)
    spoilt = Mesh(mesh.vertices, mesh.faces, spoil(mesh.source_uv))
    atlas = make_atlas(spoilt, size=64)
    assert atlas.origin == "xatlas" and atlas.report.serves
    assert any(word in message for message in atlas.report.messages)


def test_insisting_on_coordinates_that_overlap_is_told():
    mesh = sheet(4)
    uv = (mesh.source_uv - torch.tensor([0.5, 0])).abs() * torch.tensor([2.0, 1])
    atlas = make_atlas(Mesh(mesh.vertices, mesh.faces, uv), "source", size=64)
    assert atlas.origin == "source" and "although 50.00%" in atlas.report.messages[0]


def test_insisting_on_none_or_useless_coordinates_raises():
    mesh = sheet(2)
    with pytest.raises(DomainError, match="has none"):
        make_atlas(Mesh(mesh.vertices, mesh.faces), "source")
    with pytest.raises(DomainError, match="leave the unit square"):
        make_atlas(Mesh(mesh.vertices, mesh.faces, mesh.source_uv + 2), "source")


@pytest.mark.parametrize("rule", ["xatlas", "fallback"])
def test_unwraps_are_unique_complete_padded_and_the_same_every_time(rule):
    mesh = sphere(12, 20)
    made = Made(mesh, rule, size=256)
    assert made.atlas.origin == rule
    assert made.atlas.report.serves and made.atlas.report.overlapping == 0
    assert gap_texels(made, 256) >= 5
    again = make_atlas(mesh, rule, size=256)
    assert torch.equal(again.uv, made.uv) and torch.equal(again.chart, made.chart)
    maps = rasterise(mesh, made.uv, (256, 256))
    torch.testing.assert_close(maps.area.sum(), mesh.face_area.sum(), rtol=5e-3, atol=0)


def test_fallback_keeps_charts_unmirrored():
    """Seen from outside, with v down: corners turn as they do on the surface."""
    mesh = sphere(16, 32)
    a, b, c = make_atlas(mesh, "fallback", size=256).uv.unbind(1)
    p, q = b - a, c - a
    assert bool((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] < 0).all())


def test_fallback_unfolds_what_overlaps_in_its_projection():
    """A ramp that winds three times around: seen from above, one turn lies on the other."""
    turn = torch.linspace(0, 6 * torch.pi, 200)
    around = torch.stack([torch.cos(turn), 0.05 * turn, -torch.sin(turn)], -1)
    vertices = torch.cat([around * torch.tensor([1.0, 1, 1]), around * torch.tensor([2.0, 1, 2])])
    a = torch.arange(199)
    faces = torch.cat([torch.stack([a, a + 200, a + 201], -1), torch.stack([a, a + 201, a + 1], -1)])
    mesh = Mesh(vertices, faces)
    atlas = make_atlas(mesh, "fallback", size=512)
    assert atlas.report.charts >= 3
    assert float(contested_area(mesh, atlas.uv, (512, 512)).sum()) <= 1e-3 * float(mesh.face_area.sum())


def test_fallback_says_so_when_charts_must_move_together():
    atlas = make_atlas(soup(0, 3000), "fallback", size=64)
    assert any("texels apart" in message for message in atlas.report.messages)
    assert bool(((atlas.uv >= 0) & (atlas.uv <= 1)).all())


def test_a_hopeless_unwrap_is_not_attempted_and_a_slow_one_ends():
    mesh = sphere(100, 200)
    start = time.monotonic()
    atlas = make_atlas(mesh, "xatlas", size=128, timeout_s=0.05)
    assert atlas.origin == "fallback" and "would take about" in atlas.report.messages[0]
    atlas = make_atlas(sphere(8, 16), "xatlas", size=128, timeout_s=0.04)
    assert atlas.origin == "fallback" and "did not end within" in atlas.report.messages[0]
    assert time.monotonic() - start < 30


def test_cancelling_ends_the_child(monkeypatch):
    children = []
    start = subprocess.Popen
    monkeypatch.setattr(
        subprocess, "Popen", lambda *given, **more: children.append(start(*given, **more)) or children[-1]
    )
    asked = []
    with pytest.raises(Cancelled):
        make_atlas(
            sphere(60, 100),
            "xatlas",
            size=128,
            cancel=lambda: bool(children) and bool(asked.append(1) or asked[1:]),
        )
    assert len(children) == 1 and children[0].returncode == -signal.SIGKILL, "it was still at work"


def test_charts_that_find_no_room_are_told(monkeypatch):
    """xatlas ends with a code of ours, not a traceback: here for a size at which none can be packed."""
    monkeypatch.setattr("texsss.surface.atlas.check_room", lambda *_: None)
    plain = sphere(16, 32)
    noise = torch.rand(len(plain.vertices), 1, generator=torch.Generator().manual_seed(0))
    rough = plain.moved(plain.vertices * (1 + 0.5 * noise))
    atlas = make_atlas(rough, "xatlas", size=12)
    assert atlas.origin == "fallback"
    assert "find no room in 12 × 12 texels" in atlas.report.messages[0]


def test_progress_names_its_stage():
    seen = []
    make_atlas(sphere(8, 16), "xatlas", size=128, progress=lambda name, share: seen.append((name, share)))
    assert seen and all(name == "unwrap" and 0 <= share <= 1 for name, share in seen)


def test_charts_are_connected_over_uv_edges():
    """Two sheets that share a row of vertices but not of uv are two charts."""
    mesh = sheet(4)
    uv = mesh.source_uv.clone()
    assert int(charts(mesh.faces, uv).max()) == 0
    uv[:16] = uv[:16] * 0.9
    assert charts(mesh.faces, uv).tolist() == [0] * 16 + [1] * 16


def test_the_scanned_heads_coordinates_serve(shared_data):
    """Its 666 mirrored faces are fine, its overlaps and 16 flat faces stay below 0.1 %."""
    mesh, _ = read_mesh(shared_data / "head" / "LeePerrySmith.obj", unit_mm=1000)
    atlas = make_atlas(mesh, size=1024)
    assert atlas.origin == "source"
    assert atlas.report.flat + atlas.report.overlapping <= 1e-3  # measured 9.0e-4
    assert atlas.report.charts == 11


def stacked(count: int) -> Mesh:
    """A sheet every quad of which lies over the whole square in uv, as after "Reset" in Blender."""
    mesh = sheet(count)
    square = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    uv = square[torch.tensor([[0, 2, 3], [0, 2, 1]])].repeat(count * count, 1, 1)
    return Mesh(mesh.vertices, mesh.faces, uv)


def test_coordinates_that_lie_on_each_other_are_examined_quickly():
    """17,000 faces, each over half of the square; texel by texel it took 8 s for every 128."""
    mesh = stacked(92)
    start = time.monotonic()
    report = examine_uv(mesh, mesh.source_uv, charts(mesh.faces, mesh.source_uv), (1024, 1024))
    assert time.monotonic() - start < 10  # measured 1.4 s
    assert report.overlapping > 0.999 and "overlaps" in report.fault and report.outside == 0
    with pytest.raises(DomainError, match="8,464 times"):
        make_atlas(mesh, "source", size=64)


def test_examining_stops_on_request():
    mesh, asked = stacked(8), []
    with pytest.raises(Cancelled):
        make_atlas(mesh, size=64, cancel=lambda: asked.append(1) or len(asked) > 2)
    assert len(asked) == 3


def test_tall_slivers_are_rastered_in_parts():
    """Five thousand, side by side: rows of centres are tried a part at a time, in the same order."""
    count, size = 5000, (512, 64)
    edge = torch.linspace(0, 1, count + 1)
    top, bottom = torch.stack([edge, edge * 0], -1), torch.stack([edge, edge * 0 + 1], -1)
    uv = torch.stack([top[:-1], bottom[:-1], bottom[1:]], 1)
    grid = snapped(uv, size)
    found = spans(grid, size)
    assert len(_scanline._chunks(grid, size)) > 1
    whole = torch.cat([spans(part, size).start for part in grid.split(2500)]).sort()[0]
    assert torch.equal(found.start, whole)


def test_an_atlas_of_our_own_that_does_not_serve_says_so():
    atlas = make_atlas(soup(0, 3000), "fallback", size=64)
    assert not atlas.report.serves
    assert any("charts without a texel" in said and "--size" in said for said in atlas.report.messages)
