"""Blocks of two by two texels, and the way back from blocks to texels."""

import torch

from texsss.numerics.sparse import Sparse, starts
from texsss.surface.points import TexelMaps
from texsss.transport.clusters import Clusters, gathered
from texsss.transport.interpolation import interpolation
from texsss.types import Cancel, Float, Int, Tensor

LARGEST = 1.6  # typical texels from a block's centre to its texels; others stay alone
LEVEL = 0.12  # typical texels that four blocks may miss a texel by
NEAR = 0.75, 0.25  # weights of a texel's own row of blocks and the next


def texel_blocks(
    texels: TexelMaps, place: Float[Tensor, "P 3"], area: Float[Tensor, " P"], typical: float
) -> tuple[Clusters, Int[Tensor, "h w"]]:
    """Texels with area in blocks of four, where those lie close together, and an image of the whole ones.

    The image has a block's number, or -1. Blocks hold fewer texels on the rim of a chart.
    """
    height, width = texels.size
    across = width // 2 + 2  # a frame of one block around all
    lit = torch.nonzero(area > 0)[:, 0]
    index = texels.index[lit]
    key = (index // width // 2 + 1) * across + index % width // 2 + 1
    kept, member = torch.unique(key, return_inverse=True)
    blocks = gathered(member, lit, place, area)
    away = (place[lit] - blocks.centre[member]).square().sum(1).sqrt()
    far = away.new_zeros(len(kept)).scatter_reduce(0, member, away, "amax") > LARGEST * typical
    if bool(far.any()):
        alone = key.max() + 1 + torch.arange(len(lit), device=key.device)
        kept, member = torch.unique(torch.where(far[member], alone, key), return_inverse=True)
        blocks = gathered(member, lit, place, area)
    whole = (torch.bincount(member) == 4) & (kept < (height // 2 + 2) * across)
    image = torch.full(((height // 2 + 2) * across,), -1, device=key.device)
    image[kept[whole]] = torch.nonzero(whole)[:, 0]
    return blocks, image.reshape(-1, across)


def from_blocks(
    texels: TexelMaps,
    blocks: Clusters,
    image: Int[Tensor, "h w"],
    place: Float[Tensor, "P 3"],
    typical: float,
    deviation: float,
    cancel: Cancel | None = None,
) -> tuple[Sparse, float]:
    """Values at the texels from those of blocks, and the variance [mm²] that this adds.

    Bilinear in the middle of charts; elsewhere an `interpolation` by a Gaussian of `deviation` [mm].
    """
    width = texels.size[1]
    i, j = texels.index // width, texels.index % width
    row, column = i // 2 + 1, j // 2 + 1
    rows, columns = (
        torch.stack([row, row + i % 2 * 2 - 1], 1),
        torch.stack([column, column + j % 2 * 2 - 1], 1),
    )
    four = image[rows[:, :, None], columns[:, None, :]].reshape(-1, 4)
    near = place.new_tensor(NEAR)
    weight = (near[:, None] * near).flatten()
    sound = torch.nonzero((four >= 0).all(1))[:, 0]
    missed = torch.einsum("k,pkx->px", weight, blocks.centre[four[sound]]) - place[sound]
    held = (blocks.centre[four[sound]] - place[sound][:, None]).square().sum(2) @ weight / 2
    level = (missed.square().sum(1) < (LEVEL * typical) ** 2) & (held < deviation**2)
    sound = sound[level]
    four = four[sound]
    added = float(held[level].mean()) if len(sound) else (deviation / 2) ** 2

    other = torch.ones(len(texels), dtype=torch.bool, device=place.device)
    other[sound] = False
    other = torch.nonzero(other)[:, 0]
    rest = interpolation(blocks, place[other], deviation, added, cancel)
    count = torch.full((len(texels),), 4, device=place.device)
    count[other] = rest.start.diff().long()
    start = starts(count)
    of_rest = torch.ones(int(start[-1]), dtype=torch.bool, device=place.device)
    of_rest[start[sound].long()[:, None] + torch.arange(4, device=place.device)] = False
    columns, value = four.new_empty(len(of_rest), dtype=torch.int32), place.new_empty(len(of_rest))
    columns[of_rest], value[of_rest] = rest.column, rest.value
    columns[~of_rest], value[~of_rest] = four.flatten().to(torch.int32), weight.repeat(len(sound))
    return Sparse(start, columns, value, len(blocks)), added
