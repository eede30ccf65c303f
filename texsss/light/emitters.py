"""Lights: each tells a point from where how much of it arrives."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch

from texsss.errors import DomainError, ShapeError
from texsss.media import fresnel
from texsss.types import Float, Int, Tensor, unit

Triple = Sequence[int | float] | Tensor
MM2_PER_M2 = 1e6
MOST = 1e18  # of what describes a light: its square is still a number
POOL = 256  # cells along a square from which directions are drawn


@dataclass(frozen=True, eq=False)
class LightSamples:
    """One look at a light from each of P points.

    `direction` (P, 3): unit, towards the light. `distance` (P,): to it [mm], infinite for the sky.
    `irradiance` (P, 3): what this sample stands for on a plane that faces it [W/m²]; the mean over
    samples of irradiance × cosine is the light's irradiance.
    """

    direction: Float[Tensor, "P 3"]
    distance: Float[Tensor, " P"]
    irradiance: Float[Tensor, "P 3"]


@runtime_checkable
class Light(Protocol):
    """What every light offers; `irradiance` and the highlights in view ask for nothing else."""

    @property
    def is_delta(self) -> bool:
        """Whether all its light comes from one direction, so that one sample is exact."""
        ...

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """One sample per point of `position` [mm], chosen by `square` in 0..1².

        `normal` is the unit shading normal; lights that surround the point sample its hemisphere.
        Differentiable in the light's values and in `position`.
        """
        ...


def graded(lights: Sequence[Light]) -> bool:
    """Whether a light asks for gradients."""
    return any(x.requires_grad for light in lights for x in vars(light).values() if isinstance(x, Tensor))


@dataclass(frozen=True, eq=False)
class Spots:
    """What in the surroundings is far brighter than the rest, a sun or lamps, for highlights to look for.

    `drawn`: unit directions (P, 3) towards it, by a place in 0..1² each. `above`: of unit directions and the
    radiance (P, 3) from there, the part that belongs to it, and the density of `drawn` (P,) [1/sr].
    """

    drawn: Callable[[Tensor], Tensor]
    above: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@runtime_checkable
class Environment(Light, Protocol):
    """A light that surrounds the scene."""

    def radiance_from(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """Radiance that arrives from unit `direction` [W/(m² sr)]."""
        ...

    @property
    def parts(self) -> "tuple[Environment, ...]":
        """Lights that are this one together, each of about one brightness where it is bright.

        What hides a sun is told for itself: else a shadow of it would be as noisy as its looks are few.
        """
        ...

    @property
    def looks(self) -> tuple[bool, ...]:
        """The kinds of looks that are taken, as many of each; see `look`."""
        ...

    @property
    def spots(self) -> Spots | None:
        """What is far brighter than the rest; None where nothing is."""
        ...

    def unoccluded(self, eta: float) -> Callable[[Tensor], Tensor]:
        """Irradiance that enters where nothing shadows [W/m²], as a function of unit normals (P, 3)."""
        ...

    def look(
        self,
        bright: bool,
        cell: Int[Tensor, " P"],
        sphere: Float[Tensor, "D 3"],
        normal: Float[Tensor, "P 3"],
    ) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P C"]]:
        """Directions to look in, and what comes from there in proportion to radiance × cosine / density.

        `bright`: whether to look where light comes from or all around. The density is that of all `looks`.
        `cell`: which of POOL² parts of a square, or of the `sphere`'s unit directions, to draw from. C is
        1 where all channels are alike, else 3. Without gradients.
        """
        ...


@dataclass(frozen=True, eq=False)
class PointLight:
    """A point that shines alike in all directions: `position` (3,) [mm], `intensity` (3,) [W/sr].

    Raises ShapeError, DomainError: when these are not three finite numbers, or intensity is negative.
    """

    position: Triple
    intensity: Triple
    is_delta = True

    def __post_init__(self):
        triple(self, "position")
        triple(self, "intensity", least=0.0)

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`."""
        offset = like(self.position, position) - position
        # a micrometre away is as near as a light gets
        squared = (offset * offset).sum(-1).clamp_min(1e-6)
        irradiance = like(self.intensity, position) * (MM2_PER_M2 / squared)[:, None]
        return LightSamples(unit(offset), squared.sqrt(), irradiance)


@dataclass(frozen=True, eq=False)
class SpotLight:
    """A point that shines into a cone around `direction` (3,), the way its light goes.

    `position` (3,) [mm], `intensity` (3,) [W/sr] along the axis; full within `inner`, none beyond
    `outer`, smooth between them: angles from the axis [radians].
    Raises ShapeError, DomainError: as PointLight, and unless 0 ≤ inner ≤ outer ≤ π.
    """

    position: Triple
    intensity: Triple
    direction: Triple
    inner: float = math.radians(20)
    outer: float = math.radians(25)
    is_delta = True

    def __post_init__(self):
        triple(self, "position")
        triple(self, "intensity", least=0.0)
        if not float(torch.linalg.vector_norm(triple(self, "direction").detach())) > 0:
            raise DomainError("SpotLight: expected a direction, got (0, 0, 0); (0, -1, 0) shines down.")
        if not 0 <= self.inner <= self.outer <= math.pi:
            raise DomainError(
                f"SpotLight: expected 0 ≤ inner ≤ outer ≤ π radians, got {self.inner:g} and {self.outer:g}."
            )

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`."""
        seen = PointLight(self.position, self.intensity).sample(position, normal, square)
        cosine = -(seen.direction * unit(like(self.direction, position))).sum(-1)
        full, none = math.cos(self.inner), math.cos(self.outer)
        share = ((cosine - none) / max(full - none, 1e-6)).clamp(0, 1)
        smooth = share * share * (3 - 2 * share)
        return LightSamples(seen.direction, seen.distance, seen.irradiance * smooth[:, None])


@dataclass(frozen=True, eq=False)
class DirectionalLight:
    """Parallel light: `direction` (3,) points *towards* the light, `irradiance` (3,) [W/m²] facing it.

    Raises ShapeError, DomainError: when these are not three finite numbers, the direction is zero
    or the irradiance negative.
    """

    direction: Triple
    irradiance: Triple
    is_delta = True

    def __post_init__(self):
        direction = triple(self, "direction")
        triple(self, "irradiance", least=0.0)
        if not float(torch.linalg.vector_norm(direction.detach())) > 0:
            raise DomainError(
                "DirectionalLight: expected a direction, got (0, 0, 0); (0, 1, 0) is from above."
            )

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`."""
        direction = unit(like(self.direction, position)).expand_as(position)
        distance = position.new_full(position.shape[:1], math.inf)
        return LightSamples(direction, distance, like(self.irradiance, position).expand_as(position))


@dataclass(frozen=True, eq=False)
class ConstantEnvironment:
    """The same `radiance` (3,) [W/(m² sr)] from everywhere.

    Raises ShapeError, DomainError: when it is not three finite numbers of at least 0.
    """

    radiance: Triple
    is_delta = False
    looks = (True, False)
    spots = None

    def __post_init__(self):
        triple(self, "radiance", least=0.0)

    @property
    def parts(self) -> "tuple[ConstantEnvironment, ...]":
        """See `Environment.parts`: itself."""
        return (self,)

    def sample(
        self, position: Float[Tensor, "P 3"], normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
    ) -> LightSamples:
        """See `Light.sample`; directions are distributed as the cosine."""
        direction, cosine = cosine_hemisphere(normal, square)
        irradiance = math.pi * like(self.radiance, position) / cosine[:, None]
        return LightSamples(direction, position.new_full(position.shape[:1], math.inf), irradiance)

    def radiance_from(self, direction: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """See `Environment.radiance_from`."""
        return like(self.radiance, direction).expand_as(direction)

    def unoccluded(self, eta: float) -> Callable[[Tensor], Tensor]:
        """See `Environment.unoccluded`: π L F_dt(eta) for every normal."""
        share = math.pi * fresnel.F_dt(eta)
        return lambda normal: share * like(self.radiance, normal).expand_as(normal)

    def look(
        self,
        bright: bool,
        cell: Int[Tensor, " P"],
        sphere: Float[Tensor, "D 3"],
        normal: Float[Tensor, "P 3"],
    ) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 1"]]:
        """See `Environment.look`; directions are distributed as the cosine."""
        direction, _ = tilted(normal, sphere.index_select(0, cell))
        return direction, torch.ones_like(direction[:, :1])


def cosine_hemisphere(
    normal: Float[Tensor, "P 3"], square: Float[Tensor, "P 2"]
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """Unit directions around `normal` with density cosine / π, and their cosines (at least 1e-6).

    `square` in 0..1² is mapped without tearing strata apart. Source: Shirley & Chiu 1997.
    """
    x, y = disk(square)
    z = torch.sqrt((1 - x * x - y * y).clamp_min(1e-12))
    tangent, bitangent = basis(normal)
    direction = x[:, None] * tangent + y[:, None] * bitangent + z[:, None] * normal
    return direction, z


def tilted(
    normal: Float[Tensor, "P 3"], sphere: Float[Tensor, "P 3"]
) -> tuple[Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """Unit directions around `normal` with density cosine / π, and their cosines.

    `sphere`: unit directions that are uniform; a sphere that rests on the surface shows what each is
    worth: seen from where it touches, its area is spread as the cosine.
    """
    direction = normal + sphere
    length = torch.linalg.vector_norm(direction, dim=1).clamp_min(1e-6)
    return direction / length[:, None], length / 2


def disk(square: Float[Tensor, "P 2"]) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
    """Points of the unit disk, uniform and without torn strata. Source: Shirley & Chiu 1997."""
    a, b = (2 * square - 1).unbind(-1)
    wide = a.abs() > b.abs()
    radius = torch.where(wide, a, b)
    safe = torch.where(radius == 0, torch.ones_like(radius), radius)
    ratio = torch.where(wide, b, a) / safe * (math.pi / 4)
    angle = torch.where(wide, ratio, math.pi / 2 - ratio)
    return radius * torch.cos(angle), radius * torch.sin(angle)


def basis(normal: Float[Tensor, "P 3"]) -> tuple[Float[Tensor, "P 3"], Float[Tensor, "P 3"]]:
    """Two unit vectors across each unit `normal`, right-handed with it. Source: Duff et al. 2017."""
    x, y, z = normal.unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0).to(normal.dtype)
    a = -1 / (sign + z)
    b = x * y * a
    tangent = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    bitangent = torch.stack([b, sign + y * y * a, -y], -1)
    return tangent, bitangent


def like(value: Triple, other: Tensor) -> Tensor:
    """A field that `triple` has checked, in the dtype and on the device of `other`."""
    assert isinstance(value, Tensor)
    return value.to(other)


def triple(light: object, field: str, least: float = -math.inf) -> Tensor:
    """The field as a tensor of three finite numbers, which takes the field's place."""
    value = getattr(light, field)
    if not isinstance(value, Tensor):
        value = torch.tensor([float(v) for v in value], dtype=torch.float32)
    who = type(light).__name__
    if value.shape != (3,):
        raise ShapeError(f"{who}: expected three numbers for {field}, got shape {tuple(value.shape)}.")
    seen = value.detach()
    if not bool((seen.abs() <= MOST).all()) or not bool((seen >= least).all()):
        need = f"from {-MOST if least == -math.inf else least:g} to {MOST:g}"
        raise DomainError(f"{who}: expected finite numbers {need} for {field}, got {seen.tolist()}.")
    object.__setattr__(light, field, value)
    return value
