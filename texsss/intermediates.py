"""What lies between the stages, as images over the atlas: to look inside."""

import re
from collections.abc import Callable

import torch

from texsss.errors import DomainError
from texsss.pipeline import Run
from texsss.specs import INTERMEDIATES
from texsss.types import Float, Tensor


def intermediate(run: Run, name: str) -> Float[Tensor, "H W C"]:
    """An intermediate result over the atlas, dilated to the full square.

    irradiance, exitance [W/m²], radiance [W/(m² sr)], albedo; position [mm], normal; texel-mm: edge of a
    texel [mm]; coverage: 1 on the surface; gaussian-N: the light blurred by the N-th Gaussian [W/m²];
    weight-N: its share. Raises DomainError: for another name, or more Gaussians than there are.
    """
    if not re.fullmatch(INTERMEDIATES, name):
        raise DomainError(
            f"intermediate: expected irradiance, exitance, radiance, coverage, albedo, position, normal, "
            f"texel-mm, gaussian-N or weight-N, got {name!r}."
        )
    kind, _, number = name.partition("-")
    if kind in ("gaussian", "weight"):
        return run.baked().image(_numbered(run, kind, int(number)))
    return _NAMED[name](run)


def _numbered(run: Run, kind: str, number: int) -> Float[Tensor, "P 3"]:
    count = len(run.variances)
    if number > count:
        raise DomainError(
            f"intermediate: this scene has {count} Gaussians, got number {number}; raise methods.terms."
        )
    return (
        run.bank.value.values[number - 1]
        if kind == "gaussian"
        else run.weights("total").value.at()[:, number - 1]
    )


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


_NAMED: dict[str, Callable[[Run], Tensor]] = {
    "irradiance": lambda run: run.baked().irradiance,
    "exitance": lambda run: run.baked().exitance,
    "radiance": lambda run: run.baked().radiance,
    "coverage": lambda run: run.baked().coverage.float()[..., None],
    "albedo": _albedo,
    "position": lambda run: run.baked().image(run.texels.value.points.position(run.mesh.value[0])),
    "normal": lambda run: run.baked().image(run.texels.value.points.normal(run.mesh.value[0])),
    "texel-mm": _texel_mm,
}
