"""Light that scatters first beneath a curved surface: beside where it entered, by its direction."""

import numpy as np
import torch

from texsss.light.visibility import Occluder
from texsss.types import Bool, Float, Tensor

NODES = 8  # of the way to the first scattering
BEYOND = -0.5  # least cosine at which light that entered elsewhere still arrives
FARTHEST = 5.0  # free ways: light that enters so far off does not arrive
DEPTH = 0.5  # free ways: beneath a point beyond the terminator, where what arrives is looked for
BENT = 0.35  # of a free way: more than that no first order tells
MILNE = 0.71  # free ways outside of a surface where the light within would end
MOST = 2.0  # times as much as a plane that faces the light: folds sharper than light goes deep
STEEPEST = 0.98  # of (way × curvature × sine)²: what goes on beyond misses the circle


def arriving(
    cosine: Float[Tensor, " R"],
    direction: Float[Tensor, "R 3"],
    normal: Float[Tensor, "R 3"],
    curvature: Float[Tensor, "R 3 3"],
    free: Float[Tensor, " C"],
    eta: float = 1.0,
) -> Float[Tensor, "R C"]:
    """How much of a beam scatters first beneath a point, per its irradiance on a plane that faces it.

    On a plane as much as enters, μ. Where the surface curves, and light goes `free` [mm] far before it
    scatters, what entered beside a point lies beneath it: less where the beam stands steep on a convex part,
    as it shares the surface above with its neighbours, and more where it grazes; to first order
    μ + free (k (1 - μ²) - 2 H μ²). Here the way s is summed up, ∫ e^-s (1 - 2 H z + K z²) dz, over
    depths z(s) beneath the circle that curves as the surface does along the beam: a sphere receives
    what enters it, 1 % of that beyond the terminator where it is twenty times as wide as `free`.
    `direction`: towards the light outside, `cosine` its product with the unit `normal`; bent by `eta`.
    `curvature` [1/mm]: the shape operator at the point.
    """
    along = (direction - cosine[:, None] * normal) / eta
    sine2 = along.square().sum(-1)
    outside = cosine
    if eta != 1:
        cosine = torch.where(cosine < 0, -1.0, 1.0) * (1 - sine2).clamp_min(0).sqrt()
    bend = (along[:, None] @ curvature @ along[..., None])[:, 0, 0]  # k (1 - μ²)
    trace = curvature.diagonal(dim1=-2, dim2=-1).sum(-1)
    gauss = (trace**2 - (curvature @ curvature).diagonal(dim1=-2, dim2=-1).sum(-1)) / 2
    sharpest = trace / 2 + (trace**2 / 4 - gauss).clamp_min(0).sqrt()
    k = bend / sine2.clamp_min(1e-12)
    free = free.to(k)
    total = k.new_zeros(len(k), len(free))
    for node, weight in zip(*(x.tolist() for x in np.polynomial.laguerre.laggauss(NODES)), strict=True):
        way = node * free
        wide = (k.square() * sine2)[:, None] * way.square()
        root = (1 - wide.clamp_max(STEEPEST)).sqrt()
        sunk = bend[:, None] * way
        depth = way * (cosine[:, None] + sunk / (1 + root))
        steepness = cosine[:, None] + sunk / root
        share = 1 - trace[:, None] * depth + gauss[:, None] * depth.square()
        # rays that pass above the point, or beneath the centre of the sharpest curve, do not count
        counts = (depth > 0) & (steepness > 0) & (share > 0) & (depth * sharpest[:, None] < 1)
        total = total + weight * torch.where(counts, share * steepness, 0)
    if eta != 1:  # what enters does so through less of the beam within
        total = total * (outside.clamp_min(0) / cosine.abs().clamp_min(1e-6))[:, None]
    return total.clamp_max(MOST)


def leaving(
    cosine: Float[Tensor, " R"],
    view: Float[Tensor, "R 3"],
    normal: Float[Tensor, "R 3"],
    curvature: Float[Tensor, "R 3 3"],
    free: Float[Tensor, " C"],
) -> Float[Tensor, "R C"]:
    """How much light leaves towards `view` (unit), per what leaves a plane that sends out as much in all.

    Light grows with depth from outside of the surface, as .71 + z / free, and what leaves left at depth z(s)
    after the way s: μ s - k (1 - μ²) s² / 2. A convex part is seen less deep at grazing angles, which leaves
    more for steep ones. To first order in free × curvature; `cosine`, `curvature` and `free` as in
    `arriving`, without refraction.
    """
    along = view - cosine[:, None] * normal
    bend = (along[:, None] @ curvature @ along[..., None])[:, 0]
    mean = curvature.diagonal(dim1=-2, dim2=-1).sum(-1)[:, None] / 2
    free = free.to(bend)
    flat = (MILNE + cosine.clamp_min(0))[:, None]
    seen = 1 - (bend * free).clamp(-BENT, BENT) / flat
    # the same, integrated over all directions by 2 μ dμ
    sent = 1 - (mean * free / 2).clamp(-BENT, BENT) / (MILNE + 2 / 3)
    return seen / sent


def enters_freely(
    occluder: Occluder,
    inside: Float[Tensor, "R 3"],
    direction: Float[Tensor, "R 3"],
    distance: Float[Tensor, " R"],
    most_mm: float,
) -> Bool[Tensor, " R"]:
    """Whether light at `direction` and `distance` [mm] reaches points in an object at most `most_mm` deep.

    Nothing may stand before where it enters.
    """
    _, _, way = occluder.closest(inside, direction)
    near = way < most_mm
    way = torch.where(near, way, 0) + 2 * occluder.offset_mm
    return near & ~occluder.occluded(inside + way[:, None] * direction, direction, distance - way)
