"""Weights of the Gaussian bank for every texel, computed once per distinct material."""

from dataclasses import dataclass, replace

import torch

from texsss.media.stack import LayerTable, Stack
from texsss.numerics.memory import room
from texsss.numerics.threads import in_threads
from texsss.profiles.blocks import Loops
from texsss.profiles.fused import MODELS, Fused
from texsss.profiles.hankel import Material, as_table, tame_profile
from texsss.profiles.incidence import Incidence
from texsss.profiles.project import NODES, frequencies, projector
from texsss.profiles.rows import distinct
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled, chunks

LEVELS = 256  # an 8-bit map keeps its values
CHUNK = 16_384  # rows solved at once
JITTED_CHUNK = 32_768  # ... by the loop of numba, among which are some for torch
LOOP_CHUNK = 4096  # ... by the loop in C++
WORTH_COMPILING = 10_000  # rows; fewer are done before the loop is built
WORKSPACE = 2**22  # [numbers] set aside before


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights per texel as a table of distinct rows and an index into it.

    `variances` (K,) [mm²]; `table` (U, K, C); `row` (P,): the row of each texel.
    """

    variances: Float[Tensor, " K"]
    table: Float[Tensor, "U K C"]
    row: Int[Tensor, " P"]

    def at(self, points: slice | Tensor = slice(None)) -> Float[Tensor, "P K C"]:
        """Weights of some texels, of all unless told."""
        return self.table[self.row[points].long()]

    @property
    def total(self) -> Float[Tensor, "P C"]:
        """Share of the light that comes back at every texel."""
        return self.table.sum(1)[self.row.long()]

    def scaled(self, share: Float[Tensor, "V _"], row: Int[Tensor, " P"]) -> "Weights":
        """The same shapes times `share[row]` at every texel."""
        if share.shape[0] == 1:
            return replace(self, table=self.table * share[:, None])
        keys, rows = torch.unique(self.row.long() * share.shape[0] + row, return_inverse=True)
        table = self.table[keys // share.shape[0]] * share[keys % share.shape[0]][:, None]
        return replace(self, table=table, row=rows.to(torch.int32))

    def plus(self, other: "Weights", sign: float = 1.0) -> "Weights":
        """The sum with `sign` times the weights of the same Gaussians at the same texels."""
        few = len(other.table)
        keys, rows = torch.unique(self.row.long() * few + other.row, return_inverse=True)
        table = torch.add(self.table[keys // few], other.table[keys % few], alpha=sign)
        return replace(self, table=table, row=rows.to(torch.int32))


def without_negative(table: Float[Tensor, "U K C"]) -> Float[Tensor, "U K C"]:
    """Negative weights as 0 and the others scaled to keep their sum; all 0 where that is not above 0.

    Differentiable.
    """
    positive = table.clamp_min(0)
    whole, kept = positive.sum(1, keepdim=True), table.sum(1, keepdim=True).clamp_min(0)
    return positive * (kept / torch.where(whole > 0, whole, 1))


def weights_for(
    material: Material,
    variances: Float[Tensor, " K"],
    *,
    points_uv: Float[Tensor, "P 2"] | None = None,
    points: int | None = None,
    model: str = "layered-sp3",
    scattering: str = "total",
    incidence: Incidence = "diffuse",
    side: str = "reflectance",
    nodes: int = NODES,
    channels: int = 3,
    levels: int | None = LEVELS,
    dtype: torch.dtype = torch.float32,
    compiled: bool = False,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Weights:
    """Weights of the ladder `variances` [mm²] for every texel.

    `material`: a stack whose maps are looked up at `points_uv` (P, 2); a uniform one has a single row,
    shared by all of `points_uv` or by `points` texels. `side`: reflectance or transmittance. Equal rows
    are solved once; where they are many and one or two maps make all that varies, every coefficient is
    first rounded to `levels` steps between its extremes, so that they become a table (None: exact; ignored
    while gradients are asked for, and where a few great values would cost the others over 2 % on average).
    Maps of 8 bits keep their values. Others are rounded to steps that are finest near their least value:
    totals move by .0004 on average, by .003 or more at one in 100, by up to .013 where little is absorbed.
    Grey materials are shown in `channels` channels. `compiled`: many rows of the layered models by a loop in
    C++, or without a compiler by one of numba, once that is built (torch answers until then); in float32 and
    without gradients.
    Differentiable in maps and coefficients, of white half-spaces, too (`tame_profile`).
    Raises DomainError: for unknown names; Cancelled.
    """
    if not isinstance(material, (LayerTable, Stack)):
        material = Stack(material)
    if points_uv is not None:
        points = points_uv.shape[0]
    if points_uv is not None and isinstance(material, Stack) and material.varies:
        table = material.at(points_uv, dtype)
    else:
        table = as_table(material, dtype)
    table = table.expand(channels)
    table, row = distinct(table, points, None if table.requires_grad else levels)
    if model == "layered-sp3":
        table = replace(table, known_isotropic=table.isotropic)  # one look for all blocks

    s, ds = frequencies(variances, nodes)
    matrix = projector(variances, s, ds).to(table.sigma_a)
    s = torch.cat([s, s.new_zeros(1)]).to(table.sigma_a)
    options = {"model": model, "scattering": scattering, "incidence": incidence, "side": side}
    worth = compiled and not table.requires_grad and table.batch[0] >= WORTH_COMPILING
    fused = Fused(table, s, matrix, **options) if worth else None
    loops = None
    if fused is None or not fused.ready:
        fused = None
        if worth and model in MODELS and Loops.serve(s):
            loops = Loops()
        # glibc hands memory back after every operation until it has seen something large freed: half the time
        torch.empty(WORKSPACE, device=matrix.device)
    count, done = table.batch[0], []

    def solve(part: slice) -> Float[Tensor, "B K C"]:
        spectrum = tame_profile(table.rows(part), s, loops=loops, **options)
        # channels and rows, flattened → rows, weights and channels
        made = (matrix @ spectrum).view(len(variances) * table.channels, -1).t()
        return made.reshape(-1, len(variances), table.channels)

    parts = chunks(count, LOOP_CHUNK if fused else JITTED_CHUNK if loops else CHUNK)
    if table.requires_grad:
        return Weights(variances.to(table.sigma_a), torch.cat([solve(part) for part in parts]), row)
    weights = room(matrix, count, len(variances), table.channels)

    def fill(part: slice) -> None:
        check_cancelled(cancel)
        if fused is None:
            weights[part] = solve(part)
        else:
            fused(part, weights)
        done.append(part.stop - part.start)
        if progress is not None:
            progress("weights", sum(done) / count)

    in_threads(fill, parts, cancel)
    return Weights(variances.to(table.sigma_a), weights, row)
