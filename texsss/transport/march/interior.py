"""What lies beneath, as textures: depths of boundaries and the coefficients between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.depths import check_images, in_order
from texsss.media.medium import Medium
from texsss.media.stack import FAR_MM, Stack
from texsss.surface.mesh import Mesh
from texsss.types import Float, Tensor


@dataclass(frozen=True, eq=False)
class Interior:
    """Layers beneath a textured surface.

    `depth` (H, W, B): depth of B boundaries below the surface [mm], none above the one before it;
    it tiles. `sigma_s`, `sigma_t` [1/mm] (L, C) or maps (H, W, L, C), `g` (L, C) or (H, W, L, C):
    of the L layers. L = B + 1 when the last layer is infinite, else L = B and nothing scatters below
    the last boundary. `eta` = inside / outside. Make one with `from_stack` or `from_depths`.
    """

    depth: Float[Tensor, "H W B"]
    sigma_s: Float[Tensor, "..."]
    sigma_t: Float[Tensor, "..."]
    g: Float[Tensor, "..."]
    eta: float

    @property
    def layers(self) -> int:
        """How many layers there are."""
        return self.sigma_s.shape[-2]

    @property
    def bottomless(self) -> bool:
        """Whether the last layer is infinite."""
        return self.layers > self.depth.shape[-1]

    @property
    def varies(self) -> bool:
        """Whether coefficients differ from texel to texel."""
        return any(x.ndim > 2 for x in (self.sigma_s, self.sigma_t, self.g))

    @property
    def requires_grad(self) -> bool:
        """Whether any field asks for gradients."""
        return any(x.requires_grad for x in (self.depth, self.sigma_s, self.sigma_t, self.g))

    def to(self, other: Tensor) -> "Interior":
        """The same in the dtype and on the device of `other`."""
        fields = (x.to(other) for x in (self.depth, self.sigma_s, self.sigma_t, self.g))
        return Interior(*fields, eta=self.eta)


def from_stack(stack: Stack) -> Interior:
    """The layers of a stack; maps of different sizes are brought to the largest.

    Each layer is as thick in all channels. Only the outermost refractive index counts: rays are not
    bent between layers. Differentiable in maps and coefficients.
    Raises ShapeError: when a thickness differs between channels.
    """
    coloured = _coloured(stack)
    if coloured is not None:
        raise ShapeError(
            f"march: expected one thickness for all channels of layer {coloured}, got different ones; "
            "boundaries cannot depend on colour."
        )
    sizes = [
        x.shape[:2]
        for layer in stack.layers
        for x in (layer.medium.sigma_a, layer.medium.sigma_s, layer.medium.g, layer.thickness)
        if x is not None and x.ndim == 3
    ]
    height, width = (max(s) for s in zip(*sizes)) if sizes else (1, 1)
    if len(set(sizes)) <= 1:
        table = stack.table()
    else:
        home = stack.layers[0].medium.sigma_a
        v, u = ((torch.arange(n, dtype=home.dtype, device=home.device) + 0.5) / n for n in (height, width))
        table = stack.at(torch.stack([u.repeat(height), v.repeat_interleave(width)], -1))
    count = len(stack.layers)
    finite = count - 1 if table.bottomless else count
    thickness = table.thickness[..., :finite, 0].expand(*table.thickness.shape[:-2], finite)
    depth = thickness.clamp(max=FAR_MM).cumsum(-1)
    rows = height * width
    depth = depth.reshape(rows, finite) if table.batch else depth.expand(rows, finite)

    def field(x: Tensor, given: Sequence[Tensor]) -> Tensor:
        if any(y.ndim == 3 for y in given):
            return x.reshape(height, width, *x.shape[-2:])
        return x.reshape(-1, *x.shape[-2:])[0]

    media = [layer.medium for layer in stack.layers]
    scattering = field(table.sigma_s, [m.sigma_s for m in media])
    absorption = field(table.sigma_a, [m.sigma_a for m in media])
    g = field(table.g, [m.g for m in media])
    return Interior(depth.reshape(height, width, finite), scattering, scattering + absorption, g, stack.eta)


def marches(stack: Stack) -> bool:
    """Whether `from_stack` takes a stack: every layer is as thick in all channels."""
    return _coloured(stack) is None


def from_depths(
    textures: Float[Tensor, "H W K"] | Sequence[Float[Tensor, "H W K"]],
    media: Sequence[Medium],
    *,
    scale_mm: float = 1.0,
    invert: bool = False,
    most_mm: float | Sequence[float] | None = None,
    sort: bool = False,
) -> Interior:
    """The layers that depth textures draw: channel i holds the depth of the lower boundary of layer i.

    `textures`: images (H, W, up to 4) with values in 0..1, as many as there are boundaries for, one
    after the other; a lone RGB image is three layers. `scale_mm` [mm] is the depth of 1. `invert`
    reads bright as shallow, as artists paint. `most_mm` [mm] clamps depths, one number or one per
    channel. `media`: one per channel, or one more for an infinite layer below.
    Differentiable in textures and coefficients.
    Raises ShapeError: when textures differ in size or media and channels in number. Raises
    DomainError: when a channel lies above the one before it (`sort` puts them in order instead), or
    depths are negative or not finite.
    Source: François et al. 2006, section 2.1.
    """
    images = [textures] if isinstance(textures, Tensor) else list(textures)
    check_images(images)
    sizes = sorted({tuple(t.shape[:2]) for t in images})
    if len(sizes) != 1:
        raise ShapeError(
            f"Depth texture: expected one or more of one size, got {sizes}; resize them to the largest."
        )
    raw = torch.cat(images, -1)
    channels = raw.shape[-1]
    if len(media) not in (channels, channels + 1):
        raise ShapeError(
            f"Depth texture: expected {channels} media for {channels} channels, or one more for an "
            f"infinite layer below, got {len(media)}; "
            "drop the alpha channel of an image whose alpha is no depth."
        )
    seen = raw.detach()
    if not bool(torch.isfinite(seen).all()) or float(seen.amin()) < 0 or not 0 < scale_mm < math.inf:
        raise DomainError(
            "Depth texture: expected finite values >= 0 and a scale above 0, got "
            f"{float(seen.amin()):g}..{float(seen.amax()):g} and {scale_mm:g} mm; clean or clamp them."
        )
    if invert and float(seen.amax()) > 1:
        raise DomainError(
            f"Depth texture: expected values in 0..1 to invert, got up to {float(seen.amax()):g}; "
            "scale them first."
        )
    depth = (1 - raw if invert else raw) * scale_mm
    if most_mm is not None:
        most = torch.as_tensor(most_mm, dtype=depth.dtype, device=depth.device)
        if most.shape not in ((), (channels,)) or not bool((most >= 0).all()):
            raise DomainError(
                f"Depth texture: expected most_mm as one number >= 0 [mm] or one for each of {channels} "
                f"channels, got {most_mm}."
            )
        depth = torch.minimum(depth, most)
    depth = depth.clamp(max=FAR_MM)
    depth = in_order(depth, sort)
    eta = {m.eta for m in media}
    if len(eta) > 1:
        raise DomainError(
            f"Depth texture: expected media of one refractive index, got {sorted(eta)}; "
            "rays are not bent within."
        )
    wide = max(m.channels for m in media)
    fields = [[x.expand(*x.shape[:-1], wide) for x in (m.sigma_s, m.sigma_t, m.g)] for m in media]
    size = (*raw.shape[:2], wide)
    stacked = []
    for values in zip(*fields):
        if any(v.ndim == 3 and v.shape[:2] != raw.shape[:2] for v in values):
            raise ShapeError(
                f"Depth texture: expected coefficient maps of their size {tuple(raw.shape[:2])}, "
                "got others; resize them."
            )
        mapped = any(v.ndim == 3 for v in values)
        stacked.append(torch.stack([v.expand(size) if mapped else v for v in values], -2))
    return Interior(depth, *stacked, eta=eta.pop())


def check_uv(mesh: Mesh, uv: Float[Tensor, "F 3 2"] | None, interior: Interior) -> Float[Tensor, "F 3 2"]:
    """Texture coordinates for the maps: the given ones, the mesh's own, or none needed.

    In the dtype of the mesh. Raises ShapeError: for those of another mesh. DomainError: when there are maps
    but no coordinates, or coordinates are not finite.
    """
    found = mesh.source_uv if uv is None else uv
    if found is not None:
        if found.shape != (len(mesh.faces), 3, 2):
            raise ShapeError(
                f"march: expected texture coordinates {(len(mesh.faces), 3, 2)}, one per face corner of "
                f"{mesh.name}, got {tuple(found.shape)}."
            )
        if not bool(torch.isfinite(found).all()):
            raise DomainError(
                "march: expected finite texture coordinates, got NaN or infinity in uv; repair it."
            )
        return found.to(mesh.vertices)
    if max(interior.depth.shape[:2]) > 1 or interior.varies:
        raise DomainError(
            f"march: expected texture coordinates for the maps, got none with {mesh.name}; pass uv=atlas.uv."
        )
    return mesh.vertices.new_zeros(mesh.faces.shape[0], 3, 2)


def _coloured(stack: Stack) -> int | None:
    """The first layer whose thickness differs between channels."""
    for i, layer in enumerate(stack.layers):
        d = None if layer.thickness is None else layer.thickness.detach()
        if d is not None and d.shape[-1] > 1 and bool((d != d[..., :1]).any()):
            return i
    return None
