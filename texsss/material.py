"""What a scene says of its material: media, layers, depth textures and the surface on them."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from texsss.specs import Cosine, Model, NonNegative, Number, Unit

MOST_PER_MM = 1e6
"""What a medium's coefficients may be [1/mm]: `media.medium.MOST`, before anything is read."""

PerMm = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MOST_PER_MM)]


class MapValue(Model):
    """A coefficient or thickness painted in a map: 0 and 1 of the map mean the ends of `range`, or
    the other way round if `invert` says so; a range that falls is refused.

    Nothing stands in for a range that is left out: a map alone says nothing of millimetres.
    """

    map: str
    range: tuple[NonNegative, NonNegative] | None = None
    invert: bool = False


class MediumSpec(Model):
    """A preset, or coefficients [1/mm]; a map as coefficient varies over the surface.

    `eta` beyond 1.6 wants `methods.profile` layered-diffusion. `g`: mean cosine of scattering. `phase`: the
    shape around it of light that pictures march; diffusion has Henyey and Greenstein's.
    """

    preset: str | None = None
    sigma_a_per_mm: PerMm | tuple[PerMm, PerMm, PerMm] | MapValue | None = None
    sigma_s_per_mm: PerMm | tuple[PerMm, PerMm, PerMm] | MapValue | None = None
    g: Cosine | tuple[Cosine, Cosine, Cosine] = 0.0
    eta: Annotated[Number, Field(ge=1, le=3)] = 1.3
    phase: Literal["henyey-greenstein", "schlick"] = "henyey-greenstein"

    @model_validator(mode="after")
    def _preset_or_coefficients(self) -> "MediumSpec":
        given = [value is not None for value in (self.sigma_a_per_mm, self.sigma_s_per_mm)]
        if any(given) if self.preset is not None else not all(given):
            raise ValueError("expected either preset, or both sigma_a_per_mm and sigma_s_per_mm")
        plain = (0.0, 1.3, "henyey-greenstein")
        if self.preset is not None and (self.g, self.eta, self.phase) != plain:
            raise ValueError(
                "expected a preset alone, got g, eta or phase beside it; give coefficients to change them"
            )
        _check_range("sigma_a_per_mm", self.sigma_a_per_mm, "1/mm")
        _check_range("sigma_s_per_mm", self.sigma_s_per_mm, "1/mm")
        return self


def _check_range(field: str, value: Any, unit: str) -> None:
    if not isinstance(value, MapValue):
        return
    if value.range is None:
        raise ValueError(
            f"expected a range beside the map {value.map!r} of {field}, got none; "
            f'say what its 0 and 1 mean [{unit}], as in "range": [0.1, 2]'
        )
    low, high = value.range
    if low > high:
        raise ValueError(
            f"expected the range of {field} to rise, got {low:g} to {high:g}; exchange them and set invert "
            "to true"
        )
    if unit == "1/mm" and high > MOST_PER_MM:
        raise ValueError(
            f"expected a range of {field} up to {MOST_PER_MM:g} at most, got {high:g}; check the unit"
        )


class Mix(Model):
    """Two media blended by a mask: 0 is the first, 1 the second."""

    mix: tuple[str, str]
    mask: str


class LayerSpec(Model):
    """A medium (a name in `media`, or a preset) and its thickness [mm].

    None is infinite (the last only); 0 is absent, but for the refractive index where light enters.
    """

    medium: str | Mix = "skin1"
    thickness_mm: NonNegative | MapValue | None = None

    @model_validator(mode="after")
    def _map_means_millimetres(self) -> "LayerSpec":
        _check_range("thickness_mm", self.thickness_mm, "mm")
        return self


class SurfaceSpec(Model):
    """What lies on top: albedo and normal maps by name in `maps`, microfacet roughness.

    `albedo_mode` says where the albedo applies: before diffusion, after it, or its root at both.
    With an albedo map, profiles are normalised to total 1 per channel, unless `normalise` says
    otherwise: else skin would darken twice. `normal_y`: whether green leans up (OpenGL) or down
    (DirectX) in the normal map. `roughness` and `specular` are numbers or names of grey maps;
    `second_lobe` is the share of a second, coarser highlight, which skin has.
    """

    albedo: str | None = None
    albedo_mode: Literal["pre", "post", "both"] = "post"
    normalise: bool | None = None
    normal: str | None = None
    normal_y: Literal["+y", "-y"] = "+y"
    roughness: Unit | str = 0.4
    specular: Unit | str = 1.0
    second_lobe: Unit = 0.0


class DepthsSpec(Model):
    """Depth textures: their channels, in order, are the depths of the layers' lower boundaries.

    `maps`: names of maps, whose channels follow each other; "channel": "rgba" reads four of each (an
    alpha of 1 everywhere is none). `range_mm`: what 0 and 1 mean [mm], exchanged by `invert`. A channel
    that lies above the one before it is refused, unless `sort` puts them in order.
    """

    maps: Annotated[tuple[str, ...], Field(min_length=1, max_length=16)]
    range_mm: tuple[NonNegative, NonNegative]
    invert: bool = False
    sort: bool = False

    @model_validator(mode="after")
    def _rises(self) -> "DepthsSpec":
        low, high = self.range_mm
        if low > high:
            raise ValueError(
                f"expected range_mm to rise, got {low:g} to {high:g}; exchange them and set invert to true"
            )
        return self


class MaterialSpec(Model):
    """A stack of layers, outermost first, and the surface on it.

    With `depths` the layers are as thick as these textures say: one layer for every channel, or one more
    that has no end.
    """

    layers: Annotated[tuple[LayerSpec, ...], Field(min_length=1, max_length=64)] = (LayerSpec(),)
    depths: DepthsSpec | None = None
    surface: SurfaceSpec = SurfaceSpec()

    @model_validator(mode="after")
    def _one_thickness(self) -> "MaterialSpec":
        if self.depths is None:
            for number, layer in enumerate(self.layers[:-1]):
                if layer.thickness_mm is None:
                    raise ValueError(
                        f"expected a thickness_mm of layers.{number}, got none; only the last of "
                        f"{len(self.layers)} layers may be without end"
                    )
        else:
            for number, layer in enumerate(self.layers):
                if layer.thickness_mm is not None:
                    raise ValueError(
                        f"expected no thickness_mm beside depths, got one in layers.{number}; leave it out, "
                        "as the depths say where layers end"
                    )
        return self


def _as_material(value: Any) -> Any:
    return {"layers": [{"medium": value}]} if isinstance(value, str) else value


MaterialField = Annotated[MaterialSpec, BeforeValidator(_as_material)]
"""A material, or the name of its only medium."""
