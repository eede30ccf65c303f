"""Which method computes each stage of a scene, and its options."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from texsss.specs import Count, Model, NonNegative, Number, Positive, Unit

MOST_BOUNCES = 16
ALONE = ("octree", "parallax")  # methods whose light no other part receives, and that know no angles
SPLITS = ("better-dipole", "layered-sp3")  # profiles that know what scattered once from the rest


class OctreeSpec(Model):
    """Hierarchical integration: nodes of an area below `epsilon` × distance² stand for their samples.

    `spacing_mm` of the samples of irradiance; the mean free path if left out. `receivers`: exitance is
    summed for the texels, or for every hit of the camera in pictures. `normalise`: even light comes back
    evenly, in folds too; without it they send more than entered (the plain sum of Jensen & Buhler 2002).
    """

    epsilon: Annotated[Number, Field(gt=0, le=10)] = 0.05
    spacing_mm: Positive | None = None
    receivers: Literal["texels", "hits"] = "texels"
    normalise: bool = True


class PoissonSpec(Model):
    """The blur by a Poisson disc: its radius (that of the material's light if left out), samples, passes.

    The lightmap is blurred `reduction` times smaller.
    """

    radius_mm: Positive | None = None
    taps: Annotated[Count, Field(ge=1, le=256)] = 12
    passes: Annotated[Count, Field(ge=1, le=16)] = 2
    reduction: Annotated[Count, Field(ge=1, le=16)] = 2


class MarchSpec(Model):
    """What hides the steps of the march, and how deep its layers go (Norberg 2010).

    `noise` shifts the start of uniform steps by up to this share of their distance, `noise_uv` the places
    where maps are read [uv]; `noise_map` (a name in `maps`) is where the numbers come from, so that noise
    sticks to the surface, else a seed. `deepest_mm`: boundaries between layers lie no deeper; one number,
    or one for every boundary, from the outermost.
    """

    noise: Annotated[Number, Field(ge=0, le=1)] = 0.0
    noise_uv: Annotated[Number, Field(ge=0, le=1)] = 0.0
    noise_map: str | None = None
    deepest_mm: Positive | Annotated[tuple[Positive, ...], Field(min_length=1, max_length=64)] | None = None

    @model_validator(mode="after")
    def _deeper_and_deeper(self) -> "MarchSpec":
        deepest = self.deepest_mm
        if isinstance(deepest, tuple) and list(deepest) != sorted(deepest):
            raise ValueError(
                f"expected deepest_mm that do not decrease, got {list(deepest)}; boundaries lie in order"
            )
        return self


class InnerLayerSpec(Model):
    """A layer seen through the surface: its colour (a name in `maps`), `depth_mm` below the one above.

    `opacity`: a number or a grey map; of a layer that has another one below. `spread`: how much it blurs
    per distance looked through [mm per mm].
    """

    base: str
    depth_mm: Annotated[Number, Field(gt=0, le=1e6)] = 1.0
    opacity: Unit | str = 1.0
    spread: NonNegative = 0.25


class ParallaxSpec(Model):
    """Layered textures that shift with the view (Oat 2006): the albedo map, and what lies beneath it.

    `opacity` of the surface: a number or a grey map; None is taken from the albedo map, where pale and even
    is see-through (Norberg 2010).
    """

    opacity: Unit | str | None = None
    layers: Annotated[tuple[InnerLayerSpec, ...], Field(max_length=16)] = ()


class AngleSpec(Model):
    """Light that arrives at one angle from the normal, all around [degrees]."""

    angle_deg: Annotated[Number, Field(ge=0, le=90)]


class MethodsSpec(Model):
    """Which method computes each stage; all are named, so that they can be compared.

    With `single_scattering`, pictures march light scattered once through the layers in `march_samples`
    steps and diffuse only the rest; textures hold both, since they know no eye. `auto`: `exact` with
    profile `layered-sp3` and diffusion `surface` or `uv`, lights with an extent scaled to what of them enters
    at the texels, without rays or grain; `none` with others, and where a thickness differs between colours.
    With `transmission`, light also comes through from the far side of the object, as much as its
    thickness there lets pass.
    `incidence`: how light arrives for the profile, the same at all texels; irradiance knows its own angles.
    `interreflection`: how often light that left one part of the object lights others. `angular`: beside a
    march all other light enters and leaves by its angle, not evenly; where the surface curves it first
    scatters beside where it entered, and leaves as steeper light does. Neither with `octree` or `parallax`.
    `diffusion: parallax` shows textures beneath textures instead; pictures alone see them shift.
    """

    profile: Literal["dipole", "better-dipole", "multipole", "layered-diffusion", "layered-sp3"] = (
        "layered-sp3"
    )
    diffusion: Literal["none", "uv", "surface", "octree", "poisson", "parallax"] = "surface"
    rule: Literal["exit", "entry", "geometric-mean"] = "exit"
    terms: Annotated[Count, Field(ge=1, le=32)] = 8
    incidence: Literal["diffuse", "normal"] | AngleSpec = "diffuse"
    single_scattering: Literal["auto", "none", "uniform", "exact"] = "auto"
    march_samples: Annotated[Count, Field(ge=1, le=10000)] = 4
    transmission: bool = False
    angular: bool = False
    interreflection: Annotated[Count, Field(ge=0, le=MOST_BOUNCES)] = 0
    octree: OctreeSpec = OctreeSpec()
    poisson: PoissonSpec = PoissonSpec()
    march: MarchSpec = MarchSpec()
    parallax: ParallaxSpec = ParallaxSpec()

    @property
    def arriving(self) -> str | float:
        """`incidence` as profiles take it: a name, or an angle [rad]."""
        given = self.incidence
        return math.radians(given.angle_deg) if isinstance(given, AngleSpec) else given

    @property
    def marches_unasked(self) -> bool:
        """Whether `auto` marches: where diffusion knows what is left, and stands for no older system."""
        return self.profile == "layered-sp3" and self.diffusion in ("surface", "uv")

    @model_validator(mode="after")
    def _asks_what_there_is(self) -> "MethodsSpec":
        if self.interreflection and self.diffusion in ALONE:
            raise ValueError(
                f"interreflection: expected 0 with diffusion {self.diffusion!r}, got {self.interreflection}; "
                "choose surface or uv to have parts light each other"
            )
        if self.angular and self.diffusion in ALONE:
            raise ValueError(
                f"angular: expected false with diffusion {self.diffusion!r}, got true; choose surface or uv"
            )
        marched = self.single_scattering in ("uniform", "exact") and self.diffusion != "parallax"
        if marched and self.profile not in SPLITS:
            raise ValueError(
                f"single_scattering: expected none with profile {self.profile!r}, which holds all that is "
                f"marched, too, got {self.single_scattering}; choose layered-sp3 to march"
            )
        return self
