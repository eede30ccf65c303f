"""How large a texel is on the surface, along each axis and at best and worst."""

from dataclasses import dataclass

import torch

from texsss.surface.mesh import Mesh
from texsss.surface.points import TexelMaps, face_jacobian
from texsss.types import Float, Tensor


@dataclass(frozen=True)
class Spread:
    """Least, median and greatest of something over the surface, the median by area."""

    least: float
    median: float
    greatest: float


def texel_mm_per_axis(maps: TexelMaps) -> Float[Tensor, "P 2"]:
    """Length of one texel on the surface along u and along v [mm], gutter texels included.

    This is what turns a width in mm into texels when light is diffused along the axes of uv: a Gaussian
    of standard deviation s [mm] spans s / texel_mm texels. Differentiable in the vertices.
    """
    height, width = maps.size
    jacobian = face_jacobian(maps.mesh, maps.atlas_uv)
    per_uv = torch.linalg.vector_norm(jacobian, dim=1)  # (F, 2)
    return (per_uv / per_uv.new_tensor([width, height]))[maps.points.face.long()]


def face_stretch(mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> Float[Tensor, "F 2"]:
    """Greatest and least length of a texel in any direction of each face [mm]; 0 without area in uv.

    The singular values of ∂position/∂texel; their ratio is 1 where uv is conformal, their product a texel's
    area. float64. Source: Sander et al. 2001, section 3.
    """
    height, width = size
    jacobian = face_jacobian(mesh, uv).detach().double()
    jacobian = jacobian / jacobian.new_tensor([width, height])
    # eigenvalues of the 2 by 2 metric [[a, b], [b, c]]
    metric = jacobian.transpose(-1, -2) @ jacobian
    a, b, c = metric[:, 0, 0], metric[:, 0, 1], metric[:, 1, 1]
    middle, radius = (a + c) / 2, torch.hypot((a - c) / 2, b)
    greatest = middle + radius
    # det / greatest rather than middle − radius, which loses all digits in slivers
    det = torch.linalg.vector_norm(torch.linalg.cross(jacobian[..., 0], jacobian[..., 1]), dim=-1) ** 2
    least = torch.where(greatest > 0, det / greatest.clamp_min(1e-300), 0.0)
    return torch.stack([greatest.sqrt(), least.clamp_min(0).sqrt()], -1)


def texel_sizes(mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> Spread:
    """Edge of a texel on the surface, the root of its area [mm]."""
    greatest, least = face_stretch(mesh, uv, size).unbind(-1)
    return spread((greatest * least).sqrt(), mesh.face_area)


def anisotropies(mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> Spread:
    """Ratio of a texel's longest to its shortest extent on the surface; 1 is without stretch."""
    greatest, least = face_stretch(mesh, uv, size).unbind(-1)
    sound = least > 0
    ratio = torch.where(sound, greatest / torch.where(sound, least, 1.0), 0.0)
    return spread(ratio, mesh.face_area)


def spread(values: Float[Tensor, " F"], area: Float[Tensor, " F"]) -> Spread:
    """Least, area-weighted median and greatest of the values above zero; all 0 if there are none."""
    sound = (values > 0) & (area > 0)
    if not bool(sound.any()):
        return Spread(0.0, 0.0, 0.0)
    ordered, order = torch.sort(values[sound].detach().double())
    share = torch.cumsum(area[sound].detach().double()[order], 0)
    middle = int(torch.searchsorted(share, share[-1] / 2).clamp_max(len(ordered) - 1))
    return Spread(float(ordered[0]), float(ordered[middle]), float(ordered[-1]))
