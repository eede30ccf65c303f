"""Which texel lies on which triangle of an atlas: exact coverage, barycentrics, gutter."""

import torch

from texsss.errors import DomainError, ShapeError
from texsss.surface._gutter import gutter_texels
from texsss.surface._scanline import SUBTEXELS, Spans, barycentric_steps, disjoint, filled, spans
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points, TexelMaps
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

CHUNK_TEXELS = 1 << 18  # texels written at once: small enough for the cache
MAX_STEP = 4.0  # of a gutter texel beyond its face, in typical texels per texel
MAX_CLAIMS = (
    1 << 22
)  # texels that triangles which lie on each other may claim where only shares are asked for
MAX_SIZE = 16384  # keeps edge functions of texels with 16 fractional bits inside int64


def rasterise(
    mesh: Mesh,
    atlas_uv: Float[Tensor, "F 3 2"],
    size: tuple[int, int],
    *,
    gutter_texels: float | int = 2.2,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> TexelMaps:
    """Face and barycentrics of every texel that the atlas covers, then of its gutter.

    `atlas_uv` [unit square, v down]: corners outside it are clipped. `size` is (H, W) [texels].
    A texel is covered when its centre lies in a triangle, decided exactly in integers on a grid of
    2⁻¹⁶ texels: of two triangles that share an edge exactly one owns a centre on it, and no centre
    between them is lost, whatever their orientation. Where triangles overlap, the lowest face wins.
    The gutter holds every other texel within `gutter_texels` of a triangle; its barycentrics continue
    the nearest triangle affinely (weights go negative), but no farther on the surface than four
    texels' length per texel, so that slivers do not throw it off. With 2.2 a bilinear look-up from
    any point of the surface, and from one texel around, meets no empty texel, triangles smaller than
    a texel included. Faces without area in uv own no texel.
    Raises ShapeError or DomainError: when uv or size cannot be an atlas. Cancelled: on request.
    """
    check_size(size)
    _check_uv(mesh, atlas_uv)
    grid = snapped(atlas_uv, size)
    claims = disjoint(spans(grid, size, cancel), cancel)
    _report(progress, 0.3)
    inside, inside_texel = covered_points(grid, claims, size, cancel)
    _report(progress, 0.7)
    around, around_texel = _gutter_points(mesh, atlas_uv, grid, claims, size, float(gutter_texels), cancel)
    _report(progress, 1.0)
    points = Points(
        torch.cat([inside.face, around.face]),
        torch.cat([inside.bary, around.bary]),
        torch.cat([inside_texel, around_texel]),
    )
    is_covered = torch.arange(len(points), device=grid.device) < len(inside)
    return TexelMaps(mesh, atlas_uv, points, is_covered, (size[0], size[1]))


def contested_area(
    mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int], cancel: Cancel | None = None
) -> Float[Tensor, " F"]:
    """Surface area of every face whose place in uv another face owns [mm²].

    Counted on texel centres, each standing for its share of the face; mirrored charts do not matter,
    overlaps do: of the faces that claim a texel all but the lowest lose it. Parts of `uv` outside the
    square are not counted. float64.
    """
    claims = spans(snapped(uv, size), size, cancel)
    faces = mesh.faces.shape[0]
    lost = claims.texels_per_face(faces) - disjoint(claims, cancel).texels_per_face(faces)
    return lost * area_per_texel(mesh, uv, size)


def times_covered(uv: Float[Tensor, "F 3 2"]) -> float:
    """How many times the triangles of `uv` would cover the unit square together; above 1 they overlap."""
    edges = (uv[:, 1:] - uv[:, :1]).detach().double()
    return float(torch.linalg.det(edges).abs().sum() / 2)


def looked_at(uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> tuple[int, int]:
    """`size` (H, W), or a coarser one where triangles that lie on each other would claim too many texels."""
    texels, covered = size[0] * size[1], times_covered(uv)
    allowed = max(MAX_CLAIMS, 2 * texels)
    if covered * texels <= allowed:
        return size
    shrink = (allowed / (covered * texels)) ** 0.5
    return max(round(size[0] * shrink), min(size[0], 16)), max(round(size[1] * shrink), min(size[1], 16))


def area_per_texel(mesh: Mesh, uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> Float[Tensor, " F"]:
    """Surface area that a texel on each face stands for [mm²]; 0 for faces without area in uv. float64."""
    edges = (uv[:, 1:] - uv[:, :1]).double() * uv.new_tensor([size[1], size[0]]).double()
    texels = torch.linalg.det(edges).abs() / 2
    return torch.where(texels > 0, mesh.face_area.double() / texels.clamp_min(1e-300), 0.0)


def snapped(uv: Float[Tensor, "F 3 2"], size: tuple[int, int]) -> Int[Tensor, "F 3 2"]:
    """Corners on the integer grid of 2⁻¹⁶ texels on which coverage is decided."""
    height, width = size
    scale = uv.new_tensor([width, height], dtype=torch.float64) * SUBTEXELS
    return torch.round(uv.detach().double() * scale).long()


def check_size(size: tuple[int, int]) -> None:
    """Raises DomainError if `size` (H, W) is no size of an atlas."""
    if not all(isinstance(side, int) and 1 <= side <= MAX_SIZE for side in size):
        raise DomainError(
            f"rasterise: expected a size of 1..{MAX_SIZE} texels a side, got {size[0]} by {size[1]}; "
            "512 to 4096 serve most objects."
        )


def _check_uv(mesh: Mesh, uv: Tensor) -> None:
    if uv.shape[0] != mesh.faces.shape[0]:
        raise ShapeError(
            f"rasterise: expected texture coordinates for {mesh.faces.shape[0]} faces, got {uv.shape[0]}; "
            "pass one uv per face corner."
        )
    if not bool(torch.isfinite(uv).all()) or float((uv - 0.5).abs().max()) > 1:
        raise DomainError(
            "rasterise: expected atlas coordinates in the unit square, got some far outside or not finite; "
            'make an atlas with make_atlas(mesh, uv="xatlas").'
        )


def _report(progress: Progress | None, share: float) -> None:
    if progress is not None:
        progress("raster", share)


def covered_points(
    grid: Tensor, claims: Spans, size: tuple[int, int], cancel: Cancel | None
) -> tuple[Points, Tensor]:
    """Points of the texels of disjoint `claims` on the `snapped` corners, and these texels, int32.

    Barycentrics run affinely along every span.
    """
    used = claims.face
    dx, dy = (steps[used] for steps in barycentric_steps(grid))
    # relative to the third corner, where both are 0, in float64: no digits are lost far from the origin
    last = grid[:, 2].double()[used] / SUBTEXELS
    column, row = (claims.start % size[1]).double(), (claims.start // size[1]).double()
    at_start = dx * (column + 0.5 - last[:, 0])[:, None] + dy * (row + 0.5 - last[:, 1])[:, None]
    lines = torch.cat([at_start, dx], -1).float()
    total = int(claims.length.sum())
    face, texel = (torch.empty(total, dtype=torch.int32, device=grid.device) for _ in range(2))
    bary = torch.empty((total, 3), dtype=torch.float32, device=grid.device)
    ends = torch.cumsum(claims.length, 0)
    marks = torch.arange(CHUNK_TEXELS, total + CHUNK_TEXELS, CHUNK_TEXELS, device=grid.device)
    stops = torch.unique(torch.searchsorted(ends, marks, right=True)).tolist()
    done = 0
    for low, high in zip([0, *stops[:-1]], stops):
        check_cancelled(cancel)
        part = claims[slice(low, high)]
        number, at = part.expanded()
        out = slice(done, done + at.numel())
        done = out.stop
        texel[out], face[out] = at, part.face.index_select(0, number)
        line = lines[low:high].index_select(0, number)
        along = at.sub_(part.start.index_select(0, number)).float()[:, None]
        # centres up to 2⁻¹⁷ texel outside the true edge belong to the snapped one: put them onto it
        two = torch.addcmul(line[:, :2], line[:, 2:], along).clamp_(0, 1)
        sum_of_two = two.sum(-1, keepdim=True)
        whole = sum_of_two.clamp_min(1)
        torch.div(two, whole, out=bary[out, :2])
        torch.sub(1, sum_of_two, out=bary[out, 2:]).clamp_min_(0)
    return Points(face, bary), texel


def _gutter_points(
    mesh: Mesh,
    uv: Tensor,
    grid: Tensor,
    claims: Spans,
    size: tuple[int, int],
    radius: float,
    cancel: Cancel | None,
) -> tuple[Points, Tensor]:
    """The gutter's texels; steps beyond a face are held to four times what a typical texel spans."""
    texel, face, nearest, beyond = gutter_texels(grid, filled(claims, size), size, radius, cancel)
    step = beyond - nearest
    offset = torch.einsum("pc,pcd->pd", step, mesh.corners.detach().double()[face])
    reach = torch.linalg.vector_norm(offset, dim=-1)  # mm
    texels = torch.einsum("pc,pcd->pd", step, grid.double()[face] / SUBTEXELS)
    texels = torch.linalg.vector_norm(texels, dim=-1)
    counts = claims.texels_per_face(mesh.faces.shape[0])
    area = (area_per_texel(mesh, uv, size) * counts).sum() / counts.sum().clamp_min(1)  # mm²
    allowed = MAX_STEP * area.sqrt() * texels
    shrink = torch.where(reach > allowed, allowed / reach.clamp_min(1e-300), 1.0)
    return Points(face.int(), (nearest + step * shrink[:, None]).float()), texel.int()
