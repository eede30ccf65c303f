"""How light that entered spreads and leaves, and enters anew where parts of an object see each other."""

from functools import cached_property
from typing import Literal

from texsss.beneath import Beneath
from texsss.cache import Kept
from texsss.light.exchange import exchange
from texsss.numerics.sparse import Sparse
from texsss.transport.bank import BUDGET_BYTES, Bank, Diffusion, diffusion, exitance
from texsss.transport.bricks import Blur, Bricks
from texsss.transport.budget import affordable
from texsss.transport.doubts import doubts
from texsss.transport.kernels import Kernel
from texsss.transport.levels import Level
from texsss.transport.operators import Operators, surface_operators
from texsss.transport.poisson import diffuse_poisson
from texsss.transport.through import Across, on_one_side, transmitted
from texsss.transport.ways import Ways
from texsss.types import Float, Tensor

# what results that last on disk are made of
KINDS = (Operators, Kernel, Level, Ways, Blur, Bricks, Sparse)


class Diffusing(Beneath):
    """Exitance; each property is a stage, made when first asked for."""

    @property
    def crossed(self) -> Kept:
        """The texels over whose surface operators carry light: those at rest, unless it is to be the pose."""
        anew = self.operators_of_pose and self.scene.methods.diffusion == "surface"
        return self.texels if anew else self.texels_at_rest

    @cached_property
    def operators(self) -> Kept | None:
        """What carries light over the surface and its seams; None for methods that work in uv."""
        if self.scene.methods.diffusion != "surface":
            return None
        texels, variances = self.crossed.value, self.variances

        def make():
            fits = affordable(texels, variances, BUDGET_BYTES)
            return surface_operators(texels, variances[fits], **self.hooks("operators"))

        return self.stage("operators", make, self.crossed, variances)

    @cached_property
    def doubts(self) -> Kept:
        """What is doubtful about the surface that light is to cross, in sentences."""
        texels, crosses = self.crossed.value, self.scene.methods.diffusion in ("surface", "octree")
        make = lambda: doubts(texels, crosses=crosses, **self.hooks("doubts"))  # noqa: E731
        return self.stage("doubts", make, self.crossed, int(crosses))

    def blur(self, stage: str) -> Diffusion:
        """The scene's diffusion of values at the texels."""
        texels, methods = self.texels.value, self.scene.methods
        if methods.diffusion == "poisson":
            options = methods.poisson.model_dump(exclude={"radius_mm"}) | {"seed": self.scene.seed}
            return lambda values, variances: diffuse_poisson(
                values, texels, variances, **options, **self.hooks(stage)
            )
        built = None if self.operators is None else self.operators.value
        blur = diffusion(texels, methods.diffusion, operators=built, **self.hooks(stage))
        if methods.transmission and methods.diffusion == "surface":
            # straight lines cross thin parts: the far side is not to count twice
            return on_one_side(blur, texels.points.normal(texels.mesh))
        return blur

    @cached_property
    def bank(self) -> Kept:
        """One blurred copy of what the lights send per variance, the albedo in it as its mode says."""
        return self._bank(self.irradiance)

    def diffused(self, scattering: str) -> Kept:
        """Exitance at the texels (P, 3) [W/m²], but for the albedo that applies after diffusion."""
        if self.scene.methods.diffusion == "octree":
            return self.hierarchical(scattering)
        if self.scene.methods.diffusion == "parallax":
            return self.seen_along_normals
        left, echo = (
            self._unmarched() if scattering == "unmarched" else self._spread(self.bank, "total"),
            self.echo,
        )
        if echo is None:
            return left
        # of light from other parts no march knows anything
        again = self._spread(self._bank(echo), "total")
        return self.stage("exitance", lambda: left.value + again.value, "both", left, again)

    def _unmarched(self) -> Kept:
        """Exitance of what comes straight from lights and is not marched."""
        # an eye sees angles; textures do not
        light = self.irradiance if self.angular is None else self.irradiance_by_angle
        return self._spread(self._bank(light), "unmarched")

    @cached_property
    def echo(self) -> Kept | None:
        """What enters at the texels from other parts of the object [W/m²]; None unless asked for."""
        bounces = self.scene.methods.interreflection
        if not bounces:
            return None
        who, share, direct = self._exchange, self.albedo_share("post"), self._spread(self.bank, "total")
        echo: Kept | None = None
        for _ in range(bounces):
            again = None if echo is None else self._spread(self._bank(echo), "total")

            def make(again: Kept | None = again) -> Tensor:
                left = direct.value if again is None else direct.value + again.value
                return who.value.gathered(left if share is None else left * share.value, self.cancel)

            echo = self.stage("echo", make, who, share, direct, again)
        return echo

    @property
    def _exchange(self) -> Kept:
        """Which parts of the object see each other."""
        texels, sites, eta, seed = self.texels, self.sites, self.stack.value.eta, self.scene.seed

        def make():
            hooks = self.hooks("exchange")
            return exchange(texels.value, sites.value, self.occluder.value, eta=eta, seed=seed, **hooks)

        return self.stage("exchange", make, sites, eta, seed)

    def _bank(self, light: Kept) -> Kept:
        share = self.albedo_share("pre")

        def make():
            blur = self.blur("bank")
            entered = light.value if share is None else light.value * share.value
            return Bank(self.variances, entered, blur(entered, self.variances))

        methods = self.scene.methods
        how = methods.diffusion, int(methods.transmission), methods.poisson, self.scene.seed
        return self.stage("bank", make, light, share, self.variances, self.crossed, how)

    def _spread(self, bank: Kept, scattering: str) -> Kept:
        """Exitance of the light in a bank."""
        weights, rule, passed = self.weights(scattering), self.scene.methods.rule, self.passed

        def make():
            blur = None if rule == "exit" else self.blur("exitance")
            how = {"rule": rule, "blur": blur, "cancel": self.cancel}
            back = exitance(bank.value, weights.value, **how)
            if passed is None:
                return back
            across = Across(self.far_side.value, self.texels.value)
            return back + transmitted(bank.value, passed.value, across, **how)

        return self.stage("exitance", make, bank, weights, rule, passed)

    def albedo_share(self, side: Literal["pre", "post"]) -> Kept | None:
        """The part of the albedo that applies before or after diffusion at the texels."""
        mode = self.scene.material.surface.albedo_mode
        if self.albedo is None or mode not in (side, "both") or self.layered_textures:
            return None
        return self.albedo if mode == side else self.albedo.turned(self.albedo.value.sqrt(), "root")

    @property
    def exitance(self) -> Float[Tensor, "P 3"]:
        """Exitance at the texels [W/m²]."""
        share, diffused = self.albedo_share("post"), self.diffused("total").value
        return diffused if share is None else diffused * share.value

    @property
    def entered_light(self) -> Float[Tensor, "P 3"]:
        """Irradiance that enters at the texels [W/m²], from lights and from other parts of the object."""
        light, echo = self.irradiance.value, self.echo
        return light if echo is None else light + echo.value
