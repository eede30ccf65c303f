"""Unique texture coordinates for a mesh: the author's where they serve, else an unwrap of our own."""

from dataclasses import dataclass
from typing import Literal

import torch

from texsss.errors import DomainError
from texsss.surface._fallback import projected_uv
from texsss.surface._scanline import doubled_area, spans
from texsss.surface._unwrap import LONG_S, check_room, patience, xatlas_uv
from texsss.surface.mesh import Mesh
from texsss.surface.raster import check_size, contested_area, looked_at, snapped, times_covered
from texsss.surface.topology import charts
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

Origin = Literal["source", "xatlas", "fallback"]

MAX_USELESS = 1e-3  # share of the surface that may be flat or overlap in uv
MAX_STARVED = 1e-2  # share of the surface that may lie in charts too small for a single texel
LEAST_FILLED = 1e-2  # of the square: less, and texels are wasted a hundred times over
MAX_COVERED = 16  # times that the author's coordinates may cover the square if they are insisted on
MARGIN = 1e-5  # how far outside the square still counts as on its edge: exporters round
TEST_SIZES = (1024, 2048)  # between these the texels lie in which overlaps are looked for


@dataclass(frozen=True)
class AtlasReport:
    """How good an atlas is, all shares of the surface's area in 0..1.

    `flat`: faces without area in uv; `overlapping`: parts whose place another face owns; `starved`:
    charts that own no texel. `filled`: share of the square that faces cover. `outside`: faces that leave
    the unit square. `padding_texels`: between charts, as packed; None for the author's. `messages`:
    sentences for the user.
    """

    charts: int
    flat: float
    overlapping: float
    starved: float
    filled: float
    outside: int
    padding_texels: float | None
    messages: tuple[str, ...]

    @property
    def serves(self) -> bool:
        """Whether light can be stored in it: every point of the surface has a texel of its own, nearly."""
        useless = self.flat + self.overlapping
        sound = self.outside == 0 and useless <= MAX_USELESS and self.starved <= MAX_STARVED
        return sound and self.filled >= LEAST_FILLED

    @property
    def fault(self) -> str:
        """Why it does not serve, as the second half of a sentence."""
        if self.outside:
            return f"{self.outside:,} faces leave the unit square"
        if self.flat + self.overlapping > MAX_USELESS:
            return f"{self.overlapping:.2%} of the surface overlaps and {self.flat:.2%} is flat in uv"
        if self.starved > MAX_STARVED:
            return f"{self.starved:.2%} of the surface lies in charts without a texel"
        return f"only {self.filled:.2g} of the unit square is covered"


@dataclass(frozen=True, eq=False)
class Atlas:
    """Texture coordinates in which every point of the surface has a place of its own.

    `uv` (F, 3, 2) in the unit square, v down. `chart` (F,): the connected part in uv of every face.
    """

    uv: Float[Tensor, "F 3 2"]
    chart: Int[Tensor, " F"]
    origin: Origin
    report: AtlasReport


def make_atlas(
    mesh: Mesh,
    uv: Literal["auto", "source", "xatlas", "fallback"] = "auto",
    *,
    size: int | tuple[int, int] = 1024,
    padding_texels: int = 5,
    timeout_s: float | int | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Atlas:
    """An atlas of the mesh by rule `uv`.

    `auto`: the author's coordinates if they lie in the square, at most 0.1 % of the surface overlaps or is
    flat (mirrored charts serve), at most 1 % lies in charts smaller than a texel, and they fill 1 % of the
    square or more; else `xatlas`, in a
    process of its own, charts `padding_texels` apart at `size` (H, W) [texels] where they have room; and
    should that fail, or be bound to take longer than a minute, the `fallback`: projections along the axes,
    which always end. `source` insists on the author's, `xatlas` on several times as long. `timeout_s`:
    processor time that xatlas gets at most [s].
    Same input, same atlas. Raises DomainError: when `source` cannot serve at all, or the size is too small
    for the mesh. Cancelled: on request.
    """
    shape = (size, size) if isinstance(size, int) else size
    check_size(shape)
    if uv not in ("auto", "source", "xatlas", "fallback"):
        raise DomainError(f"make_atlas: expected uv as one of auto, source, xatlas, fallback, got {uv!r}.")
    messages: list[str] = []
    if uv in ("auto", "source"):
        found = _source_atlas(mesh, shape, uv == "source", cancel)
        if isinstance(found, Atlas):
            return found
        messages.append(found)
    check_cancelled(cancel)
    side = min(shape)
    check_room(mesh, side, padding_texels)
    if uv != "fallback":
        limit = (patience(mesh) if uv == "xatlas" else LONG_S) if timeout_s is None else float(timeout_s)
        texture, padding, why = xatlas_uv(
            mesh, side, padding_texels, timeout_s=limit, progress=progress, cancel=cancel
        )
        if texture is not None:
            said = [*messages, *_crowded(padding, padding_texels)]
            atlas = _atlas(mesh, texture.clamp(0, 1), shape, "xatlas", padding, said, cancel)
            if atlas.report.serves or uv == "xatlas":
                return atlas
            why = f"xatlas' unwrap does not serve: {atlas.report.fault}"
        messages.append(f"{why}, so the faces were projected along the axes instead")
    texture, padding = projected_uv(mesh, side, padding_texels, progress=progress, cancel=cancel)
    messages += _crowded(padding, padding_texels)
    return _atlas(mesh, texture, shape, "fallback", padding, messages, cancel)


def _crowded(padding: float, asked: int) -> list[str]:
    """What to say of charts that got less padding [texels] than asked for."""
    if padding >= asked:
        return []
    return [f"the charts are only {padding:.3g} texels apart, not {asked}: take a larger atlas"]


def examine_uv(
    mesh: Mesh,
    uv: Float[Tensor, "F 3 2"],
    chart: Int[Tensor, " F"],
    size: tuple[int, int],
    cancel: Cancel | None = None,
) -> AtlasReport:
    """How well `uv` would serve as an atlas of `size` (H, W) [texels].

    Where faces cover the square many times over, shares are those of a coarser grid: it does not serve.
    Raises Cancelled.
    """
    area = mesh.face_area.detach().double()
    total = area.sum()
    outside = ((uv < -MARGIN) | (uv > 1 + MARGIN)).any(-1).any(-1)
    near = torch.where(outside[:, None, None], torch.zeros_like(uv), uv.detach()).clamp(0, 1)
    test = tuple(min(max(side, TEST_SIZES[0]), TEST_SIZES[1]) for side in size)
    size, test = looked_at(near, size), looked_at(near, (test[0], test[1]))
    grid = snapped(near, size)
    flat = (doubled_area(grid) == 0) & ~outside
    texels = spans(grid, size, cancel).texels_per_face(len(area))
    per_chart = torch.zeros(int(chart.max()) + 1, dtype=torch.float64, device=area.device)
    starved = (per_chart.index_add(0, chart, texels) == 0)[chart] & ~flat & ~outside
    return AtlasReport(
        charts=len(per_chart),
        flat=float(area[flat].sum() / total),
        overlapping=float(contested_area(mesh, near, test, cancel).sum() / total),
        starved=float(area[starved].sum() / total),
        filled=float(texels.sum() / (size[0] * size[1])),
        outside=int(outside.sum()),
        padding_texels=None,
        messages=(),
    )


def _atlas(
    mesh: Mesh,
    uv: Float[Tensor, "F 3 2"],
    size: tuple[int, int],
    origin: Origin,
    padding: float | None,
    messages: list[str],
    cancel: Cancel | None,
) -> Atlas:
    """An atlas and what is to be said of it: of one of our own, that it does not serve, too."""
    chart = charts(mesh.faces, uv)
    found = examine_uv(mesh, uv, chart, size, cancel)
    if origin != "source" and not found.serves:
        messages = [*messages, f"{found.fault}: raise atlas.size (--size)"]
    values = {**vars(found), "padding_texels": padding, "messages": tuple(messages)}
    return Atlas(uv, chart, origin, AtlasReport(**values))


def _source_atlas(mesh: Mesh, size: tuple[int, int], insisted: bool, cancel: Cancel | None) -> Atlas | str:
    """The author's coordinates as an atlas, or why they are none."""
    remedy = 'choose uv="xatlas" (--uv xatlas) to have it unwrapped.'
    if mesh.source_uv is None:
        if insisted:
            raise DomainError(f"make_atlas: expected texture coordinates, but {mesh.name} has none; {remedy}")
        return "the mesh has no texture coordinates and was unwrapped"
    atlas = _atlas(mesh, mesh.source_uv, size, "source", None, [], cancel)
    report = atlas.report
    if report.serves:
        return Atlas(atlas.uv.clamp(0, 1), atlas.chart, "source", report)
    if not insisted:
        return f"the author's texture coordinates do not serve as an atlas ({report.fault}): unwrapped anew"
    if report.outside or report.flat > 0.5:
        raise DomainError(f"make_atlas: expected texture coordinates of use, but {report.fault}; {remedy}")
    covered = times_covered(mesh.source_uv)
    if covered > MAX_COVERED:
        raise DomainError(
            "make_atlas: expected texture coordinates of use, but they cover the square "
            f"{covered:,.0f} times; {remedy}"
        )
    values = {
        **vars(report),
        "messages": (f"the author's texture coordinates are used although {report.fault}",),
    }
    return Atlas(atlas.uv.clamp(0, 1), atlas.chart, "source", AtlasReport(**values))
