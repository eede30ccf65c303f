"""The first stages: the mesh, its atlas and texels, and the maps that lie on it."""

from dataclasses import replace
from functools import cached_property

from texsss import resolve
from texsss.cache import Kept, StageCache, content_key
from texsss.errors import DomainError, ShapeError
from texsss.io.sandbox import Sandbox
from texsss.light.thickness import far_side
from texsss.light.visibility import Occluder
from texsss.scene import Scene
from texsss.stages import Stages
from texsss.surface.atlas import make_atlas
from texsss.surface.beyond import beyond
from texsss.surface.onward import Onward
from texsss.surface.pose import Pose
from texsss.surface.raster import rasterise
from texsss.surface.topology import closed_volume, components, shared_edges
from texsss.types import Cancel, Float, Progress, Tensor


class Ground(Stages):
    """What light and matter lie on; each property is a stage, made when first asked for."""

    def __init__(
        self,
        cache: StageCache,
        scene: Scene,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        assets: resolve.Assets | None = None,
        sandbox: Sandbox | None = None,
        pose: Pose | None = None,
    ):
        super().__init__(cache, scene, progress, cancel)
        self.assets, self.sandbox, self.given_pose = assets, sandbox, pose

    # surface

    @cached_property
    def rest(self) -> Kept:
        """(Mesh [mm], notes) as the file has it: what atlas, places of texels and operators belong to."""
        spec, content = self.scene.mesh, resolve.digest(self.scene.mesh.source, self.assets)
        return self.stage(
            "mesh",
            lambda: resolve.load_mesh(spec, self.assets, self.sandbox),
            content,
            spec.unit_mm,
            spec.up,
            spec.v,
        )

    @cached_property
    def pose(self) -> Kept | None:
        """The pose; None at rest. One that is given takes the place of the scene's."""
        given, spec = self.given_pose, self.scene.mesh
        if given is not None:
            key = content_key("pose", given.vertices, int(given.vertices.requires_grad))
            return Kept(given, key, passing=True)
        if spec.pose is None:
            return None
        (mesh, notes), content = self.rest.value, resolve.digest(spec.pose.source, self.assets)
        read = lambda: resolve.load_joined(spec, self.assets, self.sandbox)  # noqa: E731
        joined = self.stage("mesh", read, self.rest, "joined")
        make = lambda: resolve.load_pose(spec, mesh, notes, joined.value, self.assets, self.sandbox)  # noqa: E731
        vertices = self.stage("pose", make, self.rest, content)
        return replace(vertices, value=Pose(vertices.value, spec.pose.operators))

    @property
    def operators_of_pose(self) -> bool:
        """Whether what carries light over the surface is to be made for the pose."""
        return self.pose is not None and self.pose.value.operators == "pose"

    @cached_property
    def mesh(self) -> Kept:
        """(Mesh [mm], notes) in its pose."""
        rest, pose = self.rest, self.pose
        if pose is None:
            return rest
        mesh, notes = rest.value
        return self.stage("pose", lambda: (pose.value.of(mesh, notes.vertices_in_file), notes), rest, pose)

    @cached_property
    def inward(self) -> Kept:
        """What to know of closed parts that face inward, in sentences; none if there are none."""
        mesh, _ = self.rest.value

        def make() -> list[str]:
            part = components(len(mesh.faces), shared_edges(mesh.faces))
            count, turned = int(part.max()) + 1, int((closed_volume(mesh, part) < 0).sum())
            if not turned:
                return []
            return [
                f"{turned:,} of {count:,} closed parts of the mesh face inward: they stay dark, unless they "
                "are the walls of a cavity; turn their faces (Blender: Mesh, Normals, Recalculate Outside)."
            ]

        return self.stage("inward", make, self.rest)

    @cached_property
    def occluder(self) -> Kept:
        mesh, _ = self.mesh.value
        return self.stage("occluder", lambda: Occluder(mesh), self.mesh)

    @cached_property
    def atlas(self) -> Kept:
        (mesh, _), spec = self.rest.value, self.scene.atlas

        def make():
            return make_atlas(
                mesh, uv=spec.uv, size=spec.size, padding_texels=spec.padding_texels, **self.hooks("atlas")
            )

        return self.stage("atlas", make, self.rest, spec.uv, spec.size, spec.padding_texels)

    @cached_property
    def texels_at_rest(self) -> Kept:
        """The texels of the rest pose."""
        (mesh, _), atlas, size = self.rest.value, self.atlas.value, self.scene.atlas.texels

        def make():
            texels = rasterise(mesh, atlas.uv, (size, size), **self.hooks("texels"))
            if not texels.texel_mm > 0:
                raise DomainError(
                    f"Atlas: no texel of {size} × {size} lies on {mesh.name}, whose "
                    f"{atlas.report.charts:,} charts are smaller than one; raise atlas.size (--size)."
                )
            return texels

        return self.stage("texels", make, self.atlas, size)

    @cached_property
    def texels(self) -> Kept:
        """The texels in their pose."""
        rest = self.texels_at_rest
        if self.pose is None:
            return rest
        mesh, _ = self.mesh.value
        return self.stage("texels", lambda: rest.value.moved(mesh.vertices), rest, self.mesh)

    @cached_property
    def far_side(self) -> Kept:
        """What lies opposite the texels, straight through the object."""
        (mesh, _), texels, occluder = self.mesh.value, self.texels.value, self.occluder.value

        def make():
            return far_side(texels.points, mesh, occluder, **self.hooks("thickness"))

        return self.stage("thickness", make, self.texels)

    # maps

    def image(self, name: str) -> Kept:
        """A map by its name in the scene."""
        spec = self.scene.maps[name]
        depends = resolve.digest(spec.source, self.assets), spec.space, spec.channel
        return self.stage("maps", lambda: resolve.load_map(spec, self.assets, self.sandbox), *depends)

    def continued(self, name: str) -> Kept:
        """A map by its name, what lies across the seams of the mesh beside its charts."""
        image, around = self.image(name), self.beyond(name)
        if around is None:
            return image
        return self.stage(
            "maps", lambda: around.value.continued(image.value, cancel=self.cancel), image, around
        )

    def beyond(self, name: str) -> Kept | None:
        """What lies beside the charts of a map; None when the mesh has none."""
        onward, size = self.onward, tuple(self.image(name).value.shape[:2])
        if onward is None:
            return None
        return self.stage("seams", lambda: beyond(onward.value, size, self.cancel), onward, *size)

    @cached_property
    def onward(self) -> Kept | None:
        """Where lines in the author's texture coordinates lead, at rest; None when the mesh has none."""
        mesh, _ = self.rest.value
        uv = mesh.source_uv
        return None if uv is None else self.stage("seams", lambda: Onward(mesh, uv), self.rest)

    @cached_property
    def source_uv(self) -> Float[Tensor, "F 3 2"]:
        """The author's texture coordinates. Raises ShapeError: when the mesh has none."""
        mesh, _ = self.rest.value
        if mesh.source_uv is None:
            raise ShapeError(
                f"Maps: {mesh.name} has no texture coordinates to lay maps on; "
                "unwrap it in the program that painted them, or leave the maps out."
            )
        return mesh.source_uv
