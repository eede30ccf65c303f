"""What to know about a material on a given object, in sentences: `advice`."""

import torch

from texsss.profiles.hankel import Material, as_table
from texsss.types import Tensor

FINE = 0.25  # diffusion lengths [texels] below which diffusion cannot be seen


def advice(material: Material, *, texel_mm: float, extent_mm: float) -> list[str]:
    """Sentences about a material that does not suit the object's scale; none if it does.

    `texel_mm`: size of a texel; `extent_mm`: largest extent of the object [mm]. The scale of a material
    is the diffusion length of its first layer, 1 / sigma_tr, or its mean free path if that is longer.
    Raises nothing: materials checked themselves.
    """
    table = as_table(material)
    sigma_a, sigma_s = table.sigma_a.detach(), (table.sigma_s * (1 - table.g)).detach()
    sigma_t = (sigma_a + sigma_s).clamp_min(1e-12)
    # of the layers that are there; light leaves the first one after a mean free path at least
    reach = torch.maximum(1 / torch.sqrt(3 * sigma_a * sigma_t).clamp_min(1e-12), 1 / sigma_t)[..., 0, :]
    shortest, longest = _ends(1 / sigma_t[..., 0, :])[0], _ends(reach)
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
    elif longest[0] > extent_mm and bool((sigma_a > 0).any()):
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
    return sentences


def _ends(x: Tensor) -> tuple[float, float]:
    low, high = x.aminmax()
    return float(low), float(high)
