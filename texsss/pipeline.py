"""The pipeline: stages in order, what each depends on, what is kept.

    mesh ─ atlas ─ texels ─ light ─ bank ─ exitance ─ picture
                                stack ─ weights ─┘  └ echo ─ bank ─ exitance, where parts light each other

Stages are pure functions of the rooms; here they are joined. A result is kept under the content of
everything it was made from, so that a material edit costs no blur and a light edit no physics.
"""

import math
from collections.abc import Callable
from functools import cached_property

from texsss import placing
from texsss.cache import Kept
from texsss.diffusing import Diffusing
from texsss.light.enclosed import enclosed
from texsss.light.thickness import far_side
from texsss.look import averaged, bent_away, check_deepest, scattered_once, seer, share_of, shower, tinted
from texsss.profiles.advice import advice, spread
from texsss.report import describe
from texsss.result import Baked
from texsss.surface.pose import doubts_of, stretch
from texsss.transport.bank import BUDGET_BYTES, narrow_stop
from texsss.transport.budget import affordable
from texsss.transport.doubts import unlit, unsuited
from texsss.transport.march.interior import from_stack
from texsss.transport.march.march import fitted_planes, planes_radius
from texsss.types import Float, Tensor
from texsss.view.camera import Hits
from texsss.view.picture import at_centres, picture
from texsss.view.shade import Sight
from texsss.view.tonemap import tonemap

SIGHTS_KEPT = 1 << 20  # pixels of pictures whose sights are kept, a hundred bytes each
LOOKS_PER_MARCH = (
    4  # of an environment's, a panel's or a ball's samples: rays of a pixel and neighbours add up to the rest
)
SPREADING = ("uv", "surface", "octree", "poisson")  # methods to which faults of mesh and atlas matter
ADVISED = 4096  # texels at which a varying material is looked at for advice


class Run(Diffusing):
    """One scene on its way through the stages; each property is a stage, made when first asked for."""

    @property
    def advice(self) -> list[str]:
        """What to know of the mesh, the atlas and the material on this object, in sentences."""
        (mesh, notes), texels, stack = self.mesh.value, self.texels.value, self.stack.value
        some = texels.points[:: max(len(texels) // ADVISED, 1)]
        material = stack.at(some.uv(self.source_uv)) if stack.varies else stack
        thick = far_side(some, mesh, self.occluder.value).thickness.median()
        said = advice(
            material,
            texel_mm=texels.texel_mm,
            extent_mm=float(mesh.extent.max()),
            thickness_mm=math.inf if self.scene.methods.transmission else float(thick),
            model=self.scene.methods.profile,
        )
        if self.scene.methods.diffusion == "surface":
            stopped = int((~affordable(self.crossed.value, self.variances, BUDGET_BYTES)).sum())
            if stopped:
                said.append(narrow_stop(stopped, len(self.variances), BUDGET_BYTES))
        if self.scene.methods.diffusion in SPREADING:
            said += [*unsuited(texels, *spread(material)), *self.doubts.value]
        said += self.stretched
        said += enclosed(self.lights, mesh, self.occluder.value)
        said += placing.stretched({name: kept.value for name, kept in self.panoramas.items()})
        said += averaged(
            self.scene.material.surface, {n: kept.value for n, kept in self.surface_maps.items()}
        )
        said += self.why_unmarched
        return [*self.inward.value, *said, *notes.messages, *self.atlas.value.report.messages]

    # picture

    @cached_property
    def planes(self) -> Kept:
        """The surface as it looks from within, for the march."""
        (mesh, _), radius = self.mesh.value, planes_radius(from_stack(self.stack.value))
        return self.stage("planes", lambda: fitted_planes(mesh, radius), self.mesh, radius)

    @property
    def marches(self) -> dict[str, str | int]:
        """How pictures march, as the report says it."""
        if self.marching == "none":
            return {"method": "none"}
        steps, lights = self.scene.methods.march_samples, len(self.scene.lights)
        return {"method": self.marching, "steps": steps, "lights": lights}

    @property
    def known_to_enter(self) -> list[Kept | None]:
        """Per light part, what enters of it at the texels, where the march takes that from there."""
        return self.entered_apart if self.marches_what_entered else []

    @property
    def posed(self) -> dict[str, str | float] | None:
        """Whose surface light spreads over in a pose, and by how much that is stretched."""
        if self.pose is None:
            return None
        stretched = stretch(self.rest.value[0], self.mesh.value[0])
        operators = self.pose.value.operators if self.scene.methods.diffusion == "surface" else "pose"
        return {"operators": operators, "stretch": round(stretched, 5)}

    @property
    def stretched(self) -> list[str]:
        """What to know of a pose that is inside out, or stretches what light spreads over, in sentences."""
        pose = self.posed
        if pose is None:
            return []
        kept = pose["operators"] == "rest"
        return doubts_of(self.rest.value[0], self.mesh.value[0], float(pose["stretch"]), kept)

    @cached_property
    def single(self) -> Callable[[Hits], Tensor] | None:
        """Radiance of light scattered once, at camera hits; None where the profiles hold it."""
        methods, method = self.scene.methods, self.marching
        if method == "none":
            return None
        (mesh, _), texels = self.mesh.value, self.texels.value
        scale = None
        if self.normalised:
            total = self.profile("total").value
            scale = texels.to_image(share_of(total.table.sum(1))[total.row.long()])
        thickness = None
        if methods.transmission and self.stack.value.layers[-1].thickness is None:
            # as the weights: a stack without a bottom ends with the object, one with a bottom by itself
            far = self.far_side.value.thickness.clamp_max(mesh.diagonal_mm)
            thickness = texels.to_image(far[:, None])
        known = self.known_to_enter
        looks = placing.environment_samples(self.scene), placing.area_samples(self.scene)
        return scattered_once(
            self.marched_stack.value,
            mesh,
            self.planes.value,
            self.parts if known else self.lights,
            entered=[None if light is None else texels.to_image(light.value) for light in known],
            atlas_uv=texels.atlas_uv,
            bumps=self.normals_at,
            scale=scale,
            thickness=thickness,
            method=method,
            samples=methods.march_samples,
            how=methods.march,
            grain=None if self.grain is None else self.grain.value.clamp(0, 1),
            phase=self.phase,
            pixels=math.prod(self.scene.camera.resolution),
            occluder=self.occluder.value,
            environment_samples=-(-looks[0] // LOOKS_PER_MARCH),
            area_samples=looks[1] if known else -(-looks[1] // LOOKS_PER_MARCH),
            seed=self.scene.seed,
        )

    @property
    def beside(self) -> Kept | None:
        """What leaves the texels where it entered [W/m²], by its angles at both; None unless known."""
        light, pre = self.irradiance_beside, self.albedo_share("pre")
        if light is None:
            return None
        total = self.profile("total") if self.normalised else None

        def make():
            entered = light.value if pre is None else light.value * pre.value
            return (
                entered
                if total is None
                else entered * share_of(total.value.table.sum(1))[total.value.row.long()]
            )

        return self.stage("exitance", make, light, pre, total)

    @cached_property
    def camera(self) -> Kept:
        """Where the picture is taken from; it does not follow poses."""
        spec, (mesh, _) = self.scene.camera, self.rest.value
        return self.stage("camera", lambda: placing.camera(spec, mesh), self.rest, spec)

    @cached_property
    def see(self) -> Callable[[Hits], Sight]:
        """What camera hits show but for scattered light."""
        images = {name: kept.value for name, kept in self.surface_maps.items()}
        return seer(
            self.upper_surface,
            images,
            self.mesh.value[0],
            self.lights,
            eta=self.stack.value.eta,
            occluder=self.occluder.value,
            seed=self.scene.seed,
        )

    @property
    def sights(self) -> Kept:
        """What the centres of the picture's pixels show but for scattered light."""
        camera, occluder = self.camera, self.occluder.value

        def make():
            return list(at_centres(camera.value, occluder, self.see, self.cancel))

        surface, eta = self.upper_surface, self.stack.value.eta
        return self.stage(
            "sights",
            make,
            camera,
            self.mesh,
            self.surface_maps,
            self.lights_key,
            surface,
            eta,
            self.scene.seed,
        )

    @cached_property
    def picture(self) -> Float[Tensor, "h w 3"]:
        """The picture, linear RGB."""
        scene, surface = self.scene, self.scene.material.surface
        (mesh, _), atlas, occluder = self.mesh.value, self.atlas.value, self.occluder.value
        methods, eta, maps = scene.methods, self.stack.value.eta, self.surface_maps
        once, how_leaves, beside = self.single, self.angular, self.beside
        scattering = "total" if once is None else "unmarched"
        at_hits = methods.diffusion == "octree" and methods.octree.receivers == "hits"
        image = (self.emission if at_hits else self.diffused)(scattering)

        def scattered() -> Tensor | Callable[[Hits], Tensor]:
            if self.layered_textures:
                return self.seen_from_camera()
            return self.exitance_of_hits(scattering) if at_hits else self.texels.value.to_image(image.value)

        def make():
            tint = None if surface.albedo is None else maps[surface.albedo].value
            single = once if once is None or tint is None else tinted(once, tint, mesh)
            angles = None if how_leaves is None else how_leaves.value
            near = None if beside is None else self.texels.value.to_image(beside.value)
            bent = None if angles is None or eta != 1 else bent_away(mesh, angles.free)
            show = shower(scattered(), atlas.uv, single, angles, near, bent)
            width, height = scene.camera.resolution
            known = self.sights.value if width * height <= SIGHTS_KEPT else None
            return picture(
                self.camera.value,
                occluder,
                lambda hits: show(self.see(hits)),  # packed when first looked
                samples=scene.camera.samples,
                background=placing.background(scene),
                seed=scene.seed,
                centres=None if known is None else ((seen.hits.pixel, show(seen)) for seen in known),
                **self.hooks("picture"),
            )

        marched = None
        if once is not None:
            how = self.marching, methods.march_samples, methods.march, self.grain, self.phase
            marched = self.planes, how, self.known_to_enter
        lit = (
            self.mesh,
            image,
            how_leaves,
            beside,
            (self.irradiance, methods.octree) if at_hits else None,
            marched,
            maps,
            self.lights_key,
            eta,
            surface,
            scene.camera,
            scene.output.background,
            scene.seed,
        )
        return self.stage("picture", make, *lit).value[..., :3]

    def baked(self) -> Baked:
        """Everything but the picture, which is taken when asked for."""
        scene = self.scene
        _ = self.surface_maps, self.stack  # what cannot be read is told before it is waited for
        if self.marching != "none":
            _ = self.phase
            check_deepest(scene.methods.march, self.stack.value)
        result = (self.entered_light, self.exitance, self.weights("total").value)

        _ = self.inward  # the report tells of it, which asks for nothing new
        if scene.methods.diffusion in SPREADING:
            _ = self.doubts

        def encode(image: Tensor) -> Tensor:
            return tonemap(image, exposure_ev=scene.output.exposure_ev, name=scene.output.tonemap)

        def report() -> dict:
            atlas, texels, weights = self.atlas.value, self.texels.value, self.weights("total").value
            energies = self.entered_light, self.exitance
            advice = (
                self.advice
                if bool((energies[0] > 0).any())
                else [unlit(atlas.report.overlapping), *self.advice]
            )
            energies = *energies, self.marches, self.posed
            return describe(scene, self.seconds, advice, atlas, texels, weights, *energies)

        return Baked(self.texels.value, *result, report, lambda: self.picture, encode)
