"""What lies between the stages, as images over the atlas: to look inside."""

import re
from collections.abc import Callable

import torch

from texsss.errors import DomainError
from texsss.methods import ALONE
from texsss.numerics.sampling import bilinear
from texsss.pipeline import Run
from texsss.specs import INTERMEDIATES
from texsss.surface.metric import face_stretch
from texsss.surface.topology import seams
from texsss.types import Float, Tensor
from texsss.view.picture import picture


def intermediate(run: Run, name: str) -> Float[Tensor, "H W C"]:
    """An intermediate result over the atlas, dilated to the full square.

    irradiance, exitance [W/m²], radiance [W/(m² sr)], albedo; diffused: exitance before the albedo that
    applies after diffusion; position [mm], normal; texel-mm: edge of a texel [mm]; metric: its longest and
    shortest extent e as e / (e + the atlas' typical texel), and shortest / longest; through-mm: how thick the
    object is [mm], 0 without a far side; seam-jump: by how much exitance differs across seams [W/m²], at
    their texels alone; coverage: 1 on the surface; gaussian-N: lights blurred by the N-th Gaussian [W/m²];
    weight-N: its share; thickness-N: of the N-th layer [mm], 0 where it has no end. `single` alone lies over
    the picture: radiance of light that was scattered once.
    Raises DomainError: for another name, more Gaussians or layers than there are, a Gaussian where the
    diffusion has none, or `single` of a scene that does not march.
    """
    if not re.fullmatch(INTERMEDIATES, name):
        raise DomainError(
            f"intermediate: expected irradiance, diffused, exitance, radiance, single, coverage, albedo, "
            f"position, normal, texel-mm, metric, through-mm, seam-jump, gaussian-N, weight-N or "
            f"thickness-N, got {name!r}."
        )
    kind, _, number = name.partition("-")
    if kind in ("gaussian", "weight"):
        return run.baked().image(_numbered(run, kind, int(number)))
    if kind == "thickness":
        return run.baked().image(_thickness(run, int(number)))
    return _NAMED[name](run)


def _numbered(run: Run, kind: str, number: int) -> Float[Tensor, "P 3"]:
    count, diffusion = len(run.variances), run.scene.methods.diffusion
    if diffusion in ALONE and kind == "gaussian":
        raise DomainError(
            f"intermediate: diffusion {diffusion!r} blurs no light by Gaussians; "
            "choose surface or uv to see them."
        )
    if number > count:
        raise DomainError(
            f"intermediate: this scene has {count} Gaussians, got number {number}; raise methods.terms."
        )
    return (
        run.bank.value.values[number - 1]
        if kind == "gaussian"
        else run.weights("total").value.at()[:, number - 1]
    )


def _thickness(run: Run, number: int) -> Float[Tensor, "P 1"]:
    layers, texels = run.stack.value.layers, run.texels.value
    if number > len(layers):
        raise DomainError(f"intermediate: this scene has {len(layers)} layers, got number {number}.")
    thickness = layers[number - 1].thickness
    if thickness is None:
        return texels.area.new_zeros(len(texels), 1)
    if thickness.ndim == 3:
        thickness = bilinear(thickness, texels.points.uv(run.source_uv), wrap="repeat")
    return thickness.to(texels.area).mean(-1, keepdim=True).expand(len(texels), 1)


def _single(run: Run) -> Float[Tensor, "h w 3"]:
    once = run.single
    if once is None:
        raise DomainError(
            "intermediate: single scattering is part of the profiles here; "
            "set methods.single_scattering to exact or uniform to see it alone."
        )
    scene = run.scene
    hooks = run.hooks("picture")
    seen = picture(
        run.camera.value, run.occluder.value, once, samples=scene.camera.samples, seed=scene.seed, **hooks
    )
    return seen[..., :3]


def _albedo(run: Run) -> Float[Tensor, "H W 3"]:
    texels = run.texels.value
    white = texels.area.new_ones(len(texels), 3)
    return run.baked().image(white if run.albedo is None else run.albedo.value)


def _texel_mm(run: Run) -> Float[Tensor, "H W 1"]:
    texels = run.texels.value
    height, width = texels.size
    metric = texels.points.metric(texels.mesh, texels.atlas_uv)
    area = torch.linalg.det(metric.double()).clamp_min(0).sqrt() / (height * width)
    return run.baked().image(area.sqrt().to(texels.area)[:, None])


def _metric(run: Run) -> Float[Tensor, "H W 3"]:
    texels = run.texels.value
    longest, shortest = face_stretch(texels.mesh, texels.atlas_uv, texels.size).unbind(-1)
    ratio = torch.where(longest > 0, shortest / torch.where(longest > 0, longest, 1), 0)
    typical = texels.texel_mm  # slivers are many times as long: they must not darken all the others
    faces = torch.stack([longest / (longest + typical), shortest / (shortest + typical), ratio], -1)
    faces = faces.to(texels.area)
    return run.baked().image(faces[texels.points.face.long()])


def _through_mm(run: Run) -> Float[Tensor, "H W 1"]:
    far = run.far_side.value
    return run.baked().image(torch.where(far.found, far.thickness, 0)[:, None])


def _seam_jump(run: Run) -> Float[Tensor, "H W 1"]:
    texels, (height, width) = run.texels.value, run.texels.value.size
    sides = seams(texels.mesh.faces, texels.atlas_uv)
    values = texels.to_image(run.exitance)
    # two places per texel of the longer side
    length = ((sides[:, :, 1] - sides[:, :, 0]) * sides.new_tensor([width, height])).norm(dim=-1).amax(1)
    count = (2 * length).ceil().clamp_min(1).long()
    edge = torch.arange(len(sides)).repeat_interleave(count)
    along = torch.arange(len(edge)) - (count.cumsum(0) - count).repeat_interleave(count)
    along = ((along + 0.5) / count[edge])[:, None]
    uv = [torch.lerp(sides[edge, side, 0], sides[edge, side, 1], along) for side in (0, 1)]
    jump = (bilinear(values, uv[0]) - bilinear(values, uv[1])).abs().amax(1)
    image = values.new_zeros(height * width)
    for place in uv:
        column, row = (place * place.new_tensor([width, height])).long().unbind(1)
        texel = row.clamp(0, height - 1) * width + column.clamp(0, width - 1)
        image = image.scatter_reduce(0, texel, jump, "amax")
    return image.reshape(height, width, 1)


_NAMED: dict[str, Callable[[Run], Tensor]] = {
    "irradiance": lambda run: run.baked().irradiance,
    "diffused": lambda run: run.baked().image(run.diffused("total").value),
    "single": _single,
    "exitance": lambda run: run.baked().exitance,
    "radiance": lambda run: run.baked().radiance,
    "coverage": lambda run: run.baked().coverage.float()[..., None],
    "albedo": _albedo,
    "position": lambda run: run.baked().image(run.texels.value.points.position(run.mesh.value[0])),
    "normal": lambda run: run.baked().image(run.texels.value.points.normal(run.mesh.value[0])),
    "texel-mm": _texel_mm,
    "metric": _metric,
    "through-mm": _through_mm,
    "seam-jump": _seam_jump,
}
