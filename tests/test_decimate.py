"""The example that makes meshes coarser keeps their surface and their texture."""

import runpy
import sys
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent / "transport"))
from march_shapes import hills

from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh

decimated = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "decimate.py"))["decimated"]


def test_charts_keep_their_outlines():
    """A patch that lies elsewhere in uv: it stays as large as it was, and nothing turns over."""
    edge = 12.0
    fine = hills(torch.float32, edge=edge)
    middle = fine.corners[..., [0, 2]].mean(1)
    patch = torch.linalg.vector_norm(middle, dim=-1) < 1.5
    uv = torch.where(patch[:, None, None], fine.source_uv + 2.0, fine.source_uv)
    coarse = decimated(Mesh(fine.vertices, fine.faces, uv), 20)  # as few as go
    assert len(coarse.faces) < len(fine.faces) / 4
    sign = torch.linalg.det(fine.source_uv[0, 1:] - fine.source_uv[0, :1]).sign()
    area = sign * torch.linalg.det(coarse.source_uv[:, 1:] - coarse.source_uv[:, :1])
    before = sign * torch.linalg.det(uv[:, 1:] - uv[:, :1])
    assert bool((area > 0).all())
    there = coarse.source_uv.mean(1).amin(-1) > 1.5
    # measured 1e-7; .48 where outlines may go anywhere
    assert float(area[there].sum() / before[patch].sum()) == pytest.approx(1, abs=0.05)


def test_texture_and_surface_stay_where_they_are():
    edge = 12.0
    fine = hills(torch.float32, edge=edge)
    coarse = decimated(fine, len(fine.faces) // 4)
    assert len(coarse.faces) == pytest.approx(len(fine.faces) / 4, rel=0.05)
    # texture coordinates of this sheet are its x and z
    place = coarse.corners[..., [0, 2]] / edge + 0.5
    torch.testing.assert_close(coarse.source_uv, place, rtol=0, atol=1e-6)
    # from above, away from the open border, which recedes: hills of .4 mm; measured .036 mm
    x, z = torch.meshgrid(*[torch.linspace(-4.0, 4.0, 30)] * 2, indexing="ij")
    eye = torch.stack([x, torch.full_like(x, 5.0), z], -1).reshape(-1, 3)
    down = torch.tensor([0.0, -1.0, 0.0]).expand_as(eye)
    near, far = (Occluder(mesh).closest(eye, down) for mesh in (coarse, fine))
    assert bool((near[0] >= 0).all())
    assert float((near[2] - far[2]).abs().max()) < 0.06
