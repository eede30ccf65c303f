"""Layers of media on top of each other, and their coefficients per texel."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import torch

from texsss.errors import DomainError, ShapeError
from texsss.media.medium import Coefficient, Medium, as_map, check_at_least_zero, check_same_size, expect
from texsss.numerics.sampling import bilinear
from texsss.types import Float, Tensor

FAR_MM = 1e5  # layers this thick and beyond are as good as infinite


@dataclass(frozen=True, eq=False, init=False)
class Layer:
    """A medium of some thickness.

    `thickness` [mm]: a number, one value per channel, or a map (H, W) or (H, W, C); infinite unless
    given. 0 is allowed and means that its matter is absent there: it neither absorbs nor scatters. Its
    refractive index, the same everywhere, still bends the light that enters, as a film's does; what gets
    out is left to the indices beneath, so that nothing jumps at 0. Over an endless base that changes R by
    7 % at most, over a slab of .2 mm by up to 24 % (an index of 1.5 on 1).
    Raises DomainError: for a negative or NaN thickness, or an infinite one within a map.
    """

    medium: Medium
    thickness: Float[Tensor, "..."] | None

    def __init__(self, medium: Medium, thickness: Coefficient | None = None):
        expect("Layer", medium, Medium, "a medium")
        if isinstance(thickness, (int, float)) and thickness == float("inf"):
            thickness = None
        if thickness is not None:
            home = medium.sigma_a
            thickness = as_map("Layer.thickness", thickness, home.dtype, home.device)
            check_at_least_zero("Layer.thickness", thickness, "mm")
        object.__setattr__(self, "medium", medium)
        object.__setattr__(self, "thickness", thickness)


@dataclass(frozen=True, eq=False)
class LayerTable:
    """Coefficients of L layers at every row of a batch: what profiles are computed from.

    `sigma_a`, `sigma_s` [1/mm], `g`, `thickness` [mm]: (..., L, C); an infinite last layer has
    thickness inf and makes `bottomless` True. `eta` (L,): inside / outside, the same in all rows.
    Differentiable. Trusts its maker.
    """

    sigma_a: Float[Tensor, "*B L C"]
    sigma_s: Float[Tensor, "*B L C"]
    g: Float[Tensor, "*B L C"]
    thickness: Float[Tensor, "*B L C"]
    eta: tuple[float, ...]
    bottomless: bool
    known_isotropic: bool = False  # saves the look at g

    @property
    def isotropic(self) -> bool:
        """Whether g is 0 everywhere, and no gradient in it is asked for, which 0 has too."""
        if self.g.requires_grad:
            return False
        return self.known_isotropic or not bool((self.g != 0).any())

    @property
    def batch(self) -> torch.Size:
        """Shape of the batch of rows."""
        return self.sigma_a.shape[:-2]

    @property
    def channels(self) -> int:
        return self.sigma_a.shape[-1]

    @property
    def requires_grad(self) -> bool:
        return any(x.requires_grad for x in self.fields)

    @property
    def fields(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        return self.sigma_a, self.sigma_s, self.g, self.thickness

    def of(self, fields: Sequence[Tensor]) -> "LayerTable":
        """The same layers with other values of `fields`."""
        sigma_a, sigma_s, g, thickness = fields
        return replace(self, sigma_a=sigma_a, sigma_s=sigma_s, g=g, thickness=thickness)

    @property
    def first(self) -> "LayerTable":
        """The first layer alone, as a half-space."""
        return replace(self.of([x[..., :1, :] for x in self.fields]), eta=self.eta[:1], bottomless=True)

    def to(self, dtype: torch.dtype | None = None, device: torch.device | str | None = None) -> "LayerTable":
        return self.of([x.to(device=device, dtype=dtype) for x in self.fields])

    def rows(self, index: slice | Tensor) -> "LayerTable":
        """Some rows of a batch (U,)."""
        return self.of([x[index] for x in self.fields])

    def expand(self, channels: int) -> "LayerTable":
        """One channel shown as many; more are left as they are."""
        return self.of([x.expand(*x.shape[:-1], max(channels, x.shape[-1])) for x in self.fields])


@dataclass(frozen=True, eq=False, init=False)
class Stack:
    """Layers from the surface inwards; only the last may be infinite, else its bottom is free.

    A medium stands for an endless layer of it. The refractive indices are each layer's own, relative to the
    outside on either side. Raises ShapeError: when there is no layer, or channels differ; DomainError: when
    an inner layer is infinite, and for what is no layer.
    """

    layers: tuple[Layer, ...]

    def __init__(self, layers: Sequence[Layer | Medium] | Layer | Medium):
        given = (layers,) if isinstance(layers, (Layer, Medium)) else layers
        expect("Stack", given, (tuple, list), "a list of layers, a layer or a medium")
        layers = tuple(Layer(one) if isinstance(one, Medium) else one for one in given)
        for one in layers:
            expect("Stack", one, Layer, "layers or media")
        if not layers:
            raise ShapeError("Stack: expected at least one layer, got none; add Layer(medium).")
        for i, layer in enumerate(layers[:-1]):
            if layer.thickness is None:
                raise DomainError(
                    f"Stack: expected a finite thickness [mm] for layer {i} of {len(layers)}, got infinity; "
                    "only the last layer may be infinite."
                )
        object.__setattr__(self, "layers", layers)
        channels = {x.shape[-1] for x in self._given()} - {1}
        if len(channels) > 1:
            raise ShapeError(
                f"Stack: expected as many channels in every layer, got {sorted(channels)}; "
                "give one number for all channels or one per channel."
            )

    @property
    def eta(self) -> float:
        """Index of the outermost layer / outside."""
        return self.layers[0].medium.eta

    @property
    def upside_down(self) -> "Stack":
        """The same layers seen from below. Raises DomainError: where the last is infinite."""
        if self.layers[-1].thickness is None:
            raise DomainError(
                "Stack: expected a finite last layer to look at from below, got an infinite one; give it a "
                "thickness [mm]."
            )
        return Stack(self.layers[::-1])

    @property
    def varies(self) -> bool:
        """Whether anything is a map."""
        return any(x.ndim == 3 for x in self._given())

    def table(self, dtype: torch.dtype | None = None) -> LayerTable:
        """Coefficients per row: batch () for a uniform stack, (H, W) where anything is a map.

        In the widest type of them unless told.
        Raises ShapeError: when maps differ in size; `at` looks them up at texture coordinates instead.
        """
        check_same_size("Stack.table", self._given())
        return self._build(lambda x: x, dtype)

    def at(self, uv: Float[Tensor, "P 2"], dtype: torch.dtype | None = None) -> LayerTable:
        """Coefficients at texture coordinates, batch (P,); maps are looked up bilinearly and tile.

        Their sizes may differ. Differentiable in maps and coefficients.
        """
        count = uv.shape[0]

        def look_up(x: Tensor) -> Tensor:
            if x.ndim == 3:
                return bilinear(x, uv, wrap="repeat")
            return x.expand(count, x.shape[0])

        return self._build(look_up, dtype)

    def _given(self) -> list[Tensor]:
        return [
            x
            for layer in self.layers
            for x in (layer.medium.sigma_a, layer.medium.sigma_s, layer.medium.g, layer.thickness)
            if x is not None
        ]

    def _build(self, sample: Callable[[Tensor], Tensor], dtype: torch.dtype | None) -> LayerTable:
        bottomless = self.layers[-1].thickness is None
        media = [layer.medium for layer in self.layers]
        infinite = media[-1].sigma_a.new_full((1,), float("inf"))
        depths = [
            infinite if layer.thickness is None else layer.thickness.clamp(max=FAR_MM)
            for layer in self.layers
        ]
        fields = [[m.sigma_a for m in media], [m.sigma_s for m in media], [m.g for m in media], depths]
        if dtype is None:
            dtype = reduce(torch.promote_types, (x.dtype for field in fields for x in field))
        sampled = [[sample(x.to(dtype)) for x in field] for field in fields]
        shape = np.broadcast_shapes(
            *(x.shape for field in sampled for x in field)
        )  # torch's imports sympy: a second
        fields = [_stacked(field, shape) for field in sampled]
        return LayerTable(*fields, eta=tuple(m.eta for m in media), bottomless=bottomless)


def _stacked(field: list[Tensor], shape: tuple[int, ...]) -> Float[Tensor, "*B L C"]:
    """One field of all layers at every row; what is alike in all rows or channels takes no memory."""
    own = np.broadcast_shapes(*(x.shape for x in field))
    made = torch.stack([x.expand(own) for x in field], -2)
    return made.expand(*shape[:-1], len(field), shape[-1])
