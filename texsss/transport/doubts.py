"""What is doubtful about a surface that light is to cross, and where: sentences for the user."""

import torch

from texsss.surface.points import TexelMaps
from texsss.surface.raster import contested_area
from texsss.surface.topology import charts, components, edges, shared_edges
from texsss.types import Cancel, Float, Int, Progress, Tensor, check_cancelled

COARSE, FINE = 100.0, 0.01  # times that light spreads; a texel may be so wide
LOST = 1e-3  # share of a face's area under others that is not rounding
BELOW = 1e-4  # share of the texels that may be of doubtful size, and of the surface that may have none


def doubts(
    texels: TexelMaps,
    *,
    crosses: bool = True,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> list[str]:
    """Sentences about open borders, crowded edges, lone charts, charts without texels, overlaps and padding.

    `crosses`: whether light passes edges and seams, else the first three do not matter. Each sentence names
    a place [mm, as the mesh is scaled]; none if all is well.
    Raises Cancelled.
    """
    said = []
    steps = (
        lambda: _of_edges(texels) if crosses else [],
        lambda: _of_charts(texels, crosses, cancel),
    )
    for k, step in enumerate(steps):
        check_cancelled(cancel)
        said += step()
        if progress is not None:
            progress("doubts", (k + 1) / len(steps))
    return said


def _of_edges(texels: TexelMaps) -> list[str]:
    mesh = texels.mesh
    both = edges(mesh.faces.long()).reshape(-1, 2)
    code = both.amin(1) * len(mesh.vertices) + both.amax(1)
    _, number, count = torch.unique(code, return_inverse=True, return_counts=True)
    meeting = count[number]
    middle = mesh.vertices.detach()[both].mean(1)
    said = []
    lone, crowded = torch.nonzero(meeting == 1)[:, 0], torch.nonzero(meeting > 2)[:, 0]
    if len(lone):
        said.append(
            f"The surface is open: light ends at {len(lone):,} edges, as near {_place(middle[lone[0]])}."
        )
    if len(crowded):
        said.append(
            f"{int((count > 2).sum()):,} edges join more than two faces, as near "
            f"{_place(middle[crowded[0]])}: light crosses to all of them."
        )
    return said


def _of_charts(texels: TexelMaps, crosses: bool, cancel: Cancel | None) -> list[str]:
    mesh, said = texels.mesh, []
    chart = charts(mesh.faces, texels.atlas_uv)
    number = int(chart.max()) + 1
    centre = mesh.corners.detach().mean(1)
    if crosses and number > 1:
        part = components(len(mesh.faces), shared_edges(mesh.faces))
        pairs = torch.unique(torch.stack([part, chart], 1), dim=0)
        alone = torch.bincount(pairs[:, 0])[part] == 1
        if bool(alone.any()) and int(part.max()):
            lone = chart[alone].unique()
            said.append(
                f"{len(lone):,} of {number:,} charts share no edge with another, as near "
                f"{_place(centre[alone][0])}: light leaves them only for what lies within its reach."
            )
    lost = contested_area(mesh, texels.atlas_uv, texels.size, cancel)
    under = lost > LOST * mesh.face_area
    held = torch.bincount(chart[texels.points.face[texels.covered].long()], minlength=number)
    starved = (held == 0)[chart] & ~under
    if float(mesh.face_area[starved].sum()) > BELOW * float(mesh.face_area.sum()):
        at = torch.where(starved, mesh.face_area, 0).argmax()
        said.append(
            f"{_many(len(chart[starved].unique()), 'chart holds', 'charts hold')} no texel, "
            f"{float(mesh.face_area[starved].sum()):.3g} mm² in all, as near {_place(centre[at])}: light of "
            "others shows there; take a larger atlas, or give them more room in uv."
        )
    if bool(under.any()):
        said.append(
            f"{_many(int(under.sum()), 'face lies', 'faces lie')} under others in uv, lit as those are, "
            f"as near {_place(centre[lost.argmax()])}; unwrap the mesh, or take uv xatlas."
        )
    touching = _touching(texels, chart)
    if len(touching):
        at = texels.points[touching[:1]].position(mesh).detach()[0]
        said.append(
            f"{_many(len(touching), 'texel touches', 'texels touch')} another chart, as near {_place(at)}: "
            "look-ups mix both; leave padding between charts, or take a larger atlas."
        )
    return said


def _touching(texels: TexelMaps, chart: Int[Tensor, " F"]) -> Int[Tensor, " N"]:
    """Covered texels whose right or lower neighbour belongs to another chart."""
    real = torch.nonzero(texels.covered)[:, 0]
    height, width = texels.size
    image = torch.full((height * width,), -1, dtype=chart.dtype, device=chart.device)
    image[texels.index[real]] = chart[texels.points.face[real].long()]
    image = image.reshape(height, width)
    differs = torch.zeros_like(image, dtype=torch.bool)
    for here, there in ((image[:, :-1], image[:, 1:]), (image[:-1], image[1:])):
        other = (here >= 0) & (there >= 0) & (here != there)
        differs[: here.shape[0], : here.shape[1]] |= other
    return real[differs.reshape(-1)[texels.index[real]]]


def unsuited(texels: TexelMaps, least_mm: float, most_mm: float) -> list[str]:
    """Sentences about texels far wider or narrower than light spreads, and where; none if all is well.

    `least_mm`, `most_mm`: how far it does at the least and at the most.
    """
    real = torch.nonzero(texels.area > 0)[:, 0]
    edge = texels.area[real].detach().sqrt()
    said = []
    for out, extent, than, remedy in (
        (
            edge > COARSE * most_mm,
            edge,
            f"more than {COARSE:g} times as wide as the material spreads light ({most_mm:.3g} mm)",
            "nothing is seen of it there; check the unit of the mesh, or give that part more room in uv.",
        ),
        (
            edge < FINE * least_mm,
            -edge,
            f"less than {FINE:g} times as wide as the material spreads light ({least_mm:.3g} mm)",
            "a smaller atlas would do; check the unit of the mesh, or give that part less room in uv.",
        ),
    ):
        count = int(out.sum())
        if count > BELOW * len(edge):
            worst = int(extent.argmax())
            place = _place(texels.points[real[worst : worst + 1]].position(texels.mesh).detach()[0])
            said.append(
                f"{_many(count, 'texel is', 'texels are')} {than}, {count / len(edge):.2%} of all, "
                f"as that of {float(edge[worst]):.3g} mm near {place}: {remedy}"
            )
    return said


def unlit(overlapping: float) -> str:
    """Why no texel is lit, `overlapping` of the surface having its texels from others."""
    if overlapping > LOST:
        return (
            f"No light reaches the faces that own texels: {overlapping:.0%} of the surface lie under others "
            "in uv, so what they get is lost; unwrap the mesh, or take uv xatlas."
        )
    return "No light reaches the surface: it shines past it, from within it, or not at all; check the lights."


def _place(at: Float[Tensor, "3"]) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) mm".format(*at.tolist())


def _many(count: int, one: str, more: str) -> str:
    """How many of what there are, as English has it."""
    return f"{count:,} {one if count == 1 else more}"
