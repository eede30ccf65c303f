"""A scattering medium: what a millimetre of it absorbs, scatters and deflects."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import torch

from texsss.errors import DomainError, ShapeError
from texsss.media import fresnel
from texsss.types import Float, Tensor

Coefficient = float | int | Sequence[float] | Tensor
"""A number, one value per channel (C,), a grey map (H, W) or a map per channel (H, W, C)."""

MOST = 1e6  # [1/mm]


@dataclass(frozen=True, eq=False, init=False)
class Medium:
    """Absorption, scattering, mean cosine of deflection and refractive index of a homogeneous medium.

    `sigma_a`, `sigma_s` [1/mm], `g`: numbers, values per channel (C,), grey maps (H, W) or maps per
    channel (H, W, C), mixed freely; kept as (1,), (C,), (H, W, 1) or (H, W, C), which broadcast.
    Tensors keep their dtype; numbers alone become float64. `eta` = inside / outside, at least 1.
    Every property is elementwise and differentiable. A medium that absorbs nothing has an infinite
    diffusion length, one that does nothing at all an infinite mean free path.
    Raises DomainError: for negative or non-finite values, such over MOST, |g| ≥ 1, eta < 1; ShapeError:
    when channels differ.
    """

    sigma_a: Float[Tensor, "..."]
    sigma_s: Float[Tensor, "..."]
    g: Float[Tensor, "..."]
    eta: float

    def __init__(self, sigma_a: Coefficient, sigma_s: Coefficient, g: Coefficient = 0.0, eta: float = 1.3):
        eta = number("Medium.eta", eta)
        given = {"sigma_a": sigma_a, "sigma_s": sigma_s, "g": g}
        dtype, device = home(given.values())
        values = {name: as_map(f"Medium.{name}", value, dtype, device) for name, value in given.items()}
        channels = {v.shape[-1] for v in values.values()} - {1}
        if len(channels) > 1:
            raise ShapeError(
                f"Medium: expected as many channels in every coefficient, got {sorted(channels)}; "
                "pass one number for all channels or one per channel."
            )
        for name in ("sigma_a", "sigma_s"):
            check_at_least_zero(f"Medium.{name}", values[name], "1/mm")
            most = float(values[name].detach().amax())
            if most > MOST:
                raise DomainError(
                    f"Medium.{name}: expected at most {MOST:g} [1/mm], got {most:g}; its free paths are "
                    "under a nanometre, so check the unit."
                )
        outside = values["g"].detach().abs().amax()
        if not bool(outside < 1):
            raise DomainError(
                f"Medium: expected -1 < g < 1, got a magnitude of {float(outside):g}; "
                "g = 1 deflects nothing, so set sigma_s = 0."
            )
        if not (math.isfinite(eta) and eta >= 1):
            raise DomainError(
                f"Medium: expected a finite eta >= 1, got {eta:g}; eta is the index inside / outside, "
                "1 to blend in and 1.3 to 1.5 for most materials."
            )
        for name, value in {**values, "eta": eta}.items():
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> int:
        """How many channels the coefficients have; 1 when all are numbers."""
        return max(x.shape[-1] for x in (self.sigma_a, self.sigma_s, self.g))

    @property
    def sigma_s_prime(self) -> Tensor:
        """Reduced scattering coefficient [1/mm]."""
        return self.sigma_s * (1 - self.g)

    @property
    def sigma_t(self) -> Tensor:
        """Extinction coefficient [1/mm]."""
        return self.sigma_a + self.sigma_s

    @property
    def sigma_t_prime(self) -> Tensor:
        """Reduced extinction coefficient [1/mm]."""
        return self.sigma_a + self.sigma_s_prime

    @property
    def albedo(self) -> Tensor:
        """Share of extinguished light that is scattered; 0 in a clear medium."""
        return _share(self.sigma_s, self.sigma_t)

    @property
    def albedo_prime(self) -> Tensor:
        """Reduced albedo; 0 in a clear medium."""
        return _share(self.sigma_s_prime, self.sigma_t_prime)

    @property
    def mean_free_path(self) -> Tensor:
        """Reduced mean free path 1 / sigma_t' [mm]; infinite in a clear medium."""
        return 1 / self.sigma_t_prime

    @property
    def D(self) -> Tensor:
        """Diffusion coefficient [mm]. Source: Grosjean, in d'Eon & Irving 2011, eq. 15."""
        return (2 - self.albedo_prime) / (3 * self.sigma_t_prime)

    @property
    def D_classical(self) -> Tensor:
        """Diffusion coefficient 1 / (3 sigma_t') of Jensen et al. 2001 [mm]."""
        return 1 / (3 * self.sigma_t_prime)

    @property
    def sigma_tr(self) -> Tensor:
        """Effective transport coefficient √(sigma_a / D) [1/mm]; 0 where nothing is absorbed."""
        return torch.sqrt(self.sigma_a / self.D)

    @property
    def sigma_tr_classical(self) -> Tensor:
        """√(3 sigma_a sigma_t') of Jensen et al. 2001 [1/mm]."""
        return torch.sqrt(self.sigma_a / self.D_classical)

    @property
    def diffusion_length(self) -> Tensor:
        """1 / sigma_tr [mm]; infinite where nothing is absorbed."""
        return 1 / self.sigma_tr

    @property
    def A(self) -> float:
        """Boundary factor of the outer surface."""
        return fresnel.A(self.eta)

    @property
    def z_b(self) -> Tensor:
        """Height above the surface at which the fluence would vanish, 2 A D [mm]."""
        return 2 * self.A * self.D


def mix(first: Medium, second: Medium, mask: Coefficient) -> Medium:
    """The mixture of two media by volume: `first` where `mask` is 0, `second` where it is 1.

    Coefficients mix linearly, g by the share of scattering. Differentiable in all. `mask` 0..1, a
    number or map of the size of the media's own maps. Raises DomainError: when the mask leaves 0..1
    or the indices differ; ShapeError: when maps differ in size.
    """
    for medium in (first, second):
        expect("mix", medium, Medium, "two media")
    if first.eta != second.eta:
        raise DomainError(
            f"mix: expected media of one refractive index, got eta {first.eta:g} and {second.eta:g}; "
            "an index cannot vary within a layer, so give both the same."
        )
    share = as_map("mix.mask", mask, first.sigma_a.dtype, first.sigma_a.device)
    low, high = (float(x) for x in share.detach().aminmax())
    if not (low >= 0 and high <= 1):
        raise DomainError(f"mix: expected a mask in 0..1, got {low:g}..{high:g}; scale or clamp it.")
    fields = [x for m in (first, second) for x in (m.sigma_a, m.sigma_s, m.g)]
    check_same_size("mix", [share, *fields])
    sigma_a = torch.lerp(*_alike(first.sigma_a, second.sigma_a, share))
    sigma_s = torch.lerp(*_alike(first.sigma_s, second.sigma_s, share))
    forward = torch.lerp(*_alike(first.sigma_s * first.g, second.sigma_s * second.g, share))
    return Medium(sigma_a, sigma_s, _share(forward, sigma_s), first.eta)


def as_map(name: str, value: Coefficient, dtype: torch.dtype, device: torch.device) -> Tensor:
    """`value` as (1,), (C,), (H, W, 1) or (H, W, C) in `dtype`. Raises ShapeError or DomainError."""
    try:
        if _holds_bools(value) or (isinstance(value, Tensor) and value.is_complex()):
            raise TypeError("a real number is meant")
        x = torch.as_tensor(value, dtype=dtype, device=device)
    except (TypeError, ValueError, RuntimeError) as e:
        came = (
            "true or false in a list"
            if isinstance(value, (list, tuple)) and _holds_bools(value)
            else told(value)
        )
        raise DomainError(
            f"{name}: expected a number, a list of numbers or a tensor, got {came}; pass one of these."
        ) from e
    if x.ndim > 3 or x.numel() == 0:
        raise ShapeError(
            f"{name}: expected a number, (C,), (H, W) or (H, W, C), got shape {tuple(x.shape)}; "
            "pass one of these."
        )
    x = x.reshape(1) if x.ndim == 0 else x[..., None] if x.ndim == 2 else x
    if not bool(torch.isfinite(x.detach()).all()):
        raise DomainError(
            f"{name}: expected finite values, got NaN or infinity; clean the map or the number."
        )
    return x


def _holds_bools(value: Any) -> bool:
    """Whether `value` is or lists true or false, which a mask as a tensor may hold."""
    if isinstance(value, (list, tuple)):
        return any(map(_holds_bools, value))
    return isinstance(value, (bool, np.bool_))


def expect(name: str, value: Any, kinds: type | tuple[type, ...], what: str) -> None:
    """Raises DomainError unless `value` is of `kinds`, `what` in words."""
    if not isinstance(value, kinds):
        raise DomainError(
            f"{name}: expected {what}, got {told(value)}; see docs/python.md for how to make one."
        )


def number(name: str, value: Any) -> float:
    """`value` as a number, without its gradient; one too large is infinite. Raises DomainError."""
    if isinstance(value, Tensor) and value.numel() == 1 and not value.is_complex():
        return float(value.detach())
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value == abs(value) else -math.inf
    raise DomainError(f"{name}: expected one number, got {told(value)}; it is the same everywhere.")


def told(value: Any) -> str:
    """A value in a few words."""
    if isinstance(value, Tensor):
        return f"a tensor of shape {tuple(value.shape)}"
    plain = value is None or isinstance(value, (str, bytes, Real))
    return repr(value)[:60] if plain else f"a {type(value).__name__}"


def check_at_least_zero(name: str, x: Tensor, unit: str) -> None:
    """Raises DomainError if `x` is negative anywhere."""
    low = float(x.detach().amin())
    if low < 0:
        raise DomainError(f"{name}: expected values >= 0 [{unit}], got {low:g}; check its sign and range.")


def check_same_size(name: str, maps: Sequence[Tensor]) -> None:
    """Raises ShapeError unless all maps (H, W, ·) among `maps` have one size."""
    sizes = sorted({tuple(x.shape[:2]) for x in maps if x.ndim == 3})
    if len(sizes) > 1:
        raise ShapeError(
            f"{name}: expected maps of one size, got {sizes[0]} and {sizes[1]}; resize them, or look "
            "them up at texture coordinates, where sizes may differ."
        )


def _alike(a: Tensor, b: Tensor, share: Tensor) -> list[Tensor]:
    return list(torch.broadcast_tensors(a.to(share.dtype), b.to(share.dtype), share))


def home(values: Iterable[Any]) -> tuple[torch.dtype, torch.device]:
    """The widest real dtype and the device of the tensors among `values`; float64 on the CPU without any."""
    tensors = [v for v in values if isinstance(v, Tensor)]
    real = [t.dtype for t in tensors if t.dtype.is_floating_point]
    dtype = real[0] if real else torch.float64
    for other in real[1:]:
        dtype = torch.promote_types(dtype, other)
    return dtype, tensors[0].device if tensors else torch.device("cpu")


def _share(part: Tensor, whole: Tensor) -> Tensor:
    """part / whole, 0 where there is nothing to share."""
    some = whole > 0
    return torch.where(some, part / torch.where(some, whole, torch.ones_like(whole)), torch.zeros_like(whole))
