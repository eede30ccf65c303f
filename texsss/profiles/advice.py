"""What to know about a material on a given object, in sentences: `advice`; how far light spreads in it."""

import math

import torch

from texsss.media.stack import LayerTable
from texsss.profiles.hankel import Material, as_table
from texsss.types import Tensor

FINE = 0.25  # diffusion lengths [texels] below which diffusion cannot be seen
FAR = 70.0  # mean free paths within which .99 of the light leaves that is not absorbed
CLEAR = 1e12  # [mm]
HARDLY = 1e-3  # mean free paths below which a layer is told without a number


def advice(
    material: Material,
    *,
    texel_mm: float,
    extent_mm: float,
    thickness_mm: float = math.inf,
    model: str = "layered-sp3",
) -> list[str]:
    """Sentences about a material that does not suit the object's scale, or its model; none if it does.

    `texel_mm`: size of a texel; `extent_mm`: largest extent of the object [mm]; `thickness_mm`: of most of
    it. The scale of a material is how far light goes that enters it: the mean free path of all layers, and
    their diffusion lengths by the share of light that scatters in each, at most FAR mean free paths.
    Raises nothing: materials checked themselves.
    """
    table = as_table(material)
    paths, reaches, absorbs = _scales(table)
    if not bool((paths < CLEAR).any()):
        return ["The material neither absorbs nor scatters: it stays black; give sigma_s_per_mm above 0."]
    shortest, longest = _ends(paths)[0], _ends(reaches)
    sentences = []
    if longest[1] < FINE * texel_mm:
        sentences.append(
            f"The material spreads light by at most {longest[1]:.3g} mm, less than a quarter of a texel "
            f"({texel_mm:.3g} mm): diffusion will not be seen; check the unit of the mesh or raise the size."
        )
    if shortest > extent_mm:
        sentences.append(
            f"The mean free path is {shortest:.3g} mm or more, longer than the object ({extent_mm:.3g} mm): "
            "light crosses it unscattered, which no profile describes; check the unit of the mesh."
        )
    elif longest[0] > extent_mm and absorbs:
        sentences.append(
            f"The material spreads light by {longest[0]:.3g} mm or more, farther than the object is large "
            f"({extent_mm:.3g} mm): profiles of flat stacks will be too wide; check the unit of the mesh."
        )
    inner = table.thickness[..., :-1, :] if table.bottomless else table.thickness
    if inner.shape[-2]:
        depth = _ends(inner.detach().sum(-2))[1]
        if depth > extent_mm:
            sentences.append(
                f"The layers reach down to {depth:.3g} mm, deeper than the object is large "
                f"({extent_mm:.3g} mm): give thicknesses in mm, or check the unit of the mesh."
            )
        elif depth > thickness_mm:
            sentences.append(
                f"The layers reach down to {depth:.3g} mm, deeper than most of the object is thick "
                f"({thickness_mm:.3g} mm): give thicknesses in mm, or ask for methods.transmission, which "
                "cuts them."
            )
    return sentences + _unknown_to(model, table)


def _unknown_to(model: str, table: LayerTable) -> list[str]:
    """What of the layers a published model leaves out."""
    if model in ("dipole", "better-dipole") and (len(table.eta) > 1 or not table.bottomless):
        known = f"the outermost of {len(table.eta)} layers alone" if len(table.eta) > 1 else "the layer"
        return [
            f"{model} knows {known}, as if it had no end: choose layered-sp3, layered-diffusion or "
            "multipole to have all."
        ]
    thickness = table.thickness.detach()
    paths = 1 / (table.sigma_a + table.sigma_s * (1 - table.g)).detach().clamp_min(1 / CLEAR)
    thin = (thickness < paths * (1 - 1e-6)) & (thickness > 0)
    if model != "multipole" or not bool(thin.any()):
        return []
    ratio = float(torch.where(thin, thickness / paths, math.inf).amin())
    here = f"here down to {ratio:.2g} of one" if ratio > HARDLY else "some here hardly scatter or absorb"
    return [
        f"multipole is not made for layers thinner than a mean free path, {here}: choose "
        "layered-sp3, which knows all."
    ]


def spread(material: Material) -> tuple[float, float]:
    """How far light spreads in a material at the least and at the most, over its places and channels [mm].

    0 and infinity where there is nothing that it could meet.
    """
    paths, reaches, _ = _scales(as_table(material))
    return _ends(reaches) if bool((paths < CLEAR).any()) else (0.0, math.inf)


def _scales(table: LayerTable) -> tuple[Tensor, Tensor, bool]:
    """Mean depths of first scattering or absorption, how far light spreads [mm], and whether any is absorbed.

    Per row and channel. A stack with a bottom goes on for ever as its last layer does.
    """
    sigma_a, sigma_s = table.sigma_a.detach(), (table.sigma_s * (1 - table.g)).detach()
    sigma = (sigma_a + sigma_s).clamp_min(1 / CLEAR)
    tau = sigma[..., :-1, :] * table.thickness.detach()[..., :-1, :]
    above = torch.cat([torch.zeros_like(sigma[..., :1, :]), tau.cumsum(-2)], -2)
    below = torch.cat([above[..., 1:, :], torch.full_like(sigma[..., :1, :], math.inf)], -2)
    share = torch.exp(-above) - torch.exp(-below)
    diffuse = 1 / torch.sqrt(3 * sigma_a * sigma).clamp_min(1 / CLEAR)
    reach = torch.maximum(torch.minimum(diffuse, FAR / sigma), 1 / sigma)
    return (share / sigma).sum(-2), (share * reach).sum(-2), bool((sigma_a > 0).any())


def _ends(x: Tensor) -> tuple[float, float]:
    low, high = x.aminmax()
    return float(low), float(high)
