"""What the operators of surface diffusion take in memory, before they are built."""

import math

import torch

from texsss.surface.points import TexelMaps
from texsss.transport.gutter import BYTES as gutter_bytes
from texsss.transport.operators import edge_for, fine_texel, lattice_from
from texsss.transport.smoothing import PAIRS, REACH
from texsss.types import Bool, Float, Tensor

# bytes, measured on heads in the author's and our own atlas of 512² to 4096² texels
KERNEL_ENTRY = 2.0  # of a kernel, all in all, as long as texels are even
KERNEL_TEXEL = 20
PAIR = 8  # a place and a distance, while a kernel is made
CROWDED = 1.3  # texels are that much denser than typical ones where pairs are counted
FIRST_NODES, NODES = 3.4, 6.8  # of the finest lattice, and of coarser ones, per edge² of surface
MOST_NODES = 8.0  # per texel
WAY = 17  # of a point to the next lattice
NODE = 110  # of a lattice with one Gaussian
SHARE = 8  # of a texel per Gaussian over lattices
MAKING_LATTICE, MAKING_NODE = 100, 80  # of a texel and of a node, while they are made
ASKED = 32  # texels that are asked how many others are near
TEXEL = 64  # places, normals and areas, while anything is made


def affordable(
    texels: TexelMaps, variances: Float[Tensor, " K"], budget_bytes: float | int
) -> Bool[Tensor, " K"]:
    """Which Gaussians have surface operators within `budget_bytes`: the widest, as far as it goes.

    Seams show the more the wider the Gaussian. Variances of 0 cost nothing. An upper bound for evenly
    sized texels, what building takes included: what a kernel is made of is gone before there are lattices.
    Where sheets lie together, or texels at one place, some of them tell how many are within reach.
    """
    count, texel = max(texels.covered_count, 1), fine_texel(texels)
    mean = float(texels.area.sum()) / count / texel**2  # area of a texel, in fine ones
    left = budget_bytes - (len(texels) - texels.covered_count) * gutter_bytes
    wide = lattice_from(texels)
    narrow = [REACH * float(v) ** 0.5 for v in variances if 0 < float(v) ** 0.5 < wide]
    near = dict(zip(narrow, _near(texels, narrow), strict=True))
    kernels, pairs, lattices, making = 0.0, 0.0, 0.0, 0.0
    fits = torch.zeros(len(variances), dtype=torch.bool)
    for k in torch.argsort(variances, descending=True).tolist():
        deviation = float(variances[k]) ** 0.5 / texel
        if deviation * texel >= wide:
            nodes = mean / edge_for(deviation, 1.0, count) ** 2
            first, nodes = min(MOST_NODES, FIRST_NODES * nodes), min(MOST_NODES, NODES * nodes)
            # of all but the finest lattice, nodes are points of the way to the next one
            lattices += (NODE + WAY) * (first if lattices == 0 else nodes) + SHARE
            making = WAY + MAKING_LATTICE + MAKING_NODE * first
        elif deviation > 0:
            around = max(math.pi * (REACH * deviation) ** 2, near[REACH * float(variances[k]) ** 0.5])
            kernels += KERNEL_TEXEL + KERNEL_ENTRY * around
            # some pairs at once, then the parts of a kernel until it is whole
            pairs = max(pairs, min(PAIR * CROWDED * around, PAIR * PAIRS / count), KERNEL_ENTRY * around)
        taken = TEXEL + kernels + max(pairs, lattices + making) if deviation > 0 else 0.0
        fits[k] = taken * count <= left
    return fits


def _near(texels: TexelMaps, radii: list[float]) -> list[float]:
    """How many texels lie within each of `radii` [mm] of one, the mean of some."""
    place = texels.points.position(texels.mesh).detach()[texels.covered]
    if not radii or not len(place):
        return [0.0] * len(radii)
    asked = place[:: math.ceil(len(place) / ASKED)]
    found = [0] * len(radii)
    for one in asked:
        squared = (place - one).square_().sum(1)
        found = [count + int((squared < radius**2).sum()) for count, radius in zip(found, radii, strict=True)]
    return [count / len(asked) for count in found]
