"""Scenes baked one after the other, with the results of their stages kept in between."""

from collections.abc import Callable
from pathlib import Path

from texsss.cache import StageCache
from texsss.curve import curve
from texsss.diffusing import KINDS
from texsss.errors import DomainError
from texsss.estimate import described, forewarning
from texsss.inspection import inspect
from texsss.intermediates import intermediate
from texsss.io.sandbox import Sandbox
from texsss.pipeline import Run
from texsss.resolve import Assets
from texsss.result import Baked
from texsss.scene import Scene
from texsss.shelf import Shelf, users_shelf
from texsss.showing import model, showing
from texsss.surface.mesh import Mesh
from texsss.surface.pose import Pose
from texsss.types import Cancel, Float, Progress, Tensor
from texsss.view.tonemap import tonemap


class Baker:
    """Runs the stages of scenes in order and keeps their results, at most `cache_bytes` in all.

    `shelf` keeps those that are dear on disk, from one run to the next (`lasting_shelf()`). `assets` finds
    the file of an uploaded asset by its sha256, for scenes that name some. `sandbox` reads all files, in a
    child of limited memory and time; without it they are read here.
    Not for use from several threads at once. Raises TexsssError: whatever a stage says of its input.
    """

    def __init__(
        self,
        cache_bytes: int = 4 << 30,
        *,
        assets: Assets | None = None,
        shelf: Shelf | None = None,
        sandbox: Sandbox | None = None,
    ):
        self.cache = StageCache(cache_bytes, shelf)
        self.assets, self.sandbox = assets, sandbox

    def bake(
        self,
        scene: Scene,
        *,
        pose: Pose | None = None,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        notice: Callable[[str], object] | None = None,
    ) -> Baked:
        """The baked scene, bent if there is a `pose`. `progress` hears (stage, fraction).

        A pose keeps atlas, texels, weights of the material and, unless it says otherwise, what carries light
        over the surface; positions, normals, shadows, light, its bank, planes and pictures are made for it.
        Lights and cameras placed around the mesh stay where the rest pose put them.
        `cancel` is asked between steps. `notice` hears beforehand, in a sentence, how long it will take if
        that is long.
        Raises Cancelled: when `cancel` says so; nothing is lost of what was already kept.
        """
        run = self._run(scene, progress, cancel, pose)
        if notice is not None and (warning := forewarning(run)):
            notice(warning)
        return run.baked()

    def render(
        self,
        scene: Scene,
        *,
        pose: Pose | None = None,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> Float[Tensor, "h w 3"]:
        """The scene's picture, linear RGB. As `bake` otherwise."""
        return self._run(scene, progress, cancel, pose).picture

    def mesh(self, scene: Scene, *, cancel: Cancel | None = None) -> Mesh:
        """The scene's mesh [mm] at rest, whose vertices poses move."""
        return self._run(scene, None, cancel).rest.value[0]

    def estimate(self, scene: Scene) -> dict[str, str]:
        """What `bake` is expected to cost, as lines to show; see `texsss.estimate`. As `bake` otherwise."""
        return described(self._run(scene, None, None))

    def intermediate(
        self,
        scene: Scene,
        name: str,
        *,
        pose: Pose | None = None,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> Float[Tensor, "H W C"]:
        """What lies between the stages, over the atlas; see `texsss.intermediates`. As `bake` otherwise."""
        return intermediate(self._run(scene, progress, cancel, pose), name)

    def map(self, scene: Scene, name: str, *, cancel: Cancel | None = None) -> Float[Tensor, "H W C"]:
        """A map of the scene by its name, linear. Raises DomainError: when no map has that name."""
        if name not in scene.maps:
            raise DomainError(f"Baker: no map is named {name!r}; maps has {sorted(scene.maps) or 'none'}.")
        return self._run(scene, None, cancel).image(name).value

    def model(self, scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None) -> bytes:
        """The mesh with its atlas as a GLB without textures."""
        return model(self._run(scene, progress, cancel))

    def showing(
        self, scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None
    ) -> dict:
        """Where lights and camera stand, for viewers; see `texsss.showing`."""
        return showing(self._run(scene, progress, cancel))

    def display(self, scene: Scene, image: Float[Tensor, "H W C"]) -> Float[Tensor, "H W C"]:
        """Linear light as display values in 0..1, exposed and tone mapped as the scene's output asks."""
        return tonemap(image, exposure_ev=scene.output.exposure_ev, name=scene.output.tonemap)

    def curve(self, scene: Scene, *, cancel: Cancel | None = None) -> dict:
        """The scattering profile of the scene's material as numbers to plot; see `texsss.curve`."""
        return curve(self._run(scene, None, cancel))

    def inspect(
        self,
        scene: Scene,
        *,
        picture: Path | None = None,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
    ) -> dict:
        """Mesh, texture coordinates and scale of a scene, examined; see `texsss.inspection`."""
        return inspect(self._run(scene, progress, cancel), picture)

    def _run(
        self, scene: Scene, progress: Progress | None, cancel: Cancel | None, pose: Pose | None = None
    ) -> Run:
        if not isinstance(scene, Scene):
            raise DomainError(
                f"Baker: expected a Scene, got a {type(scene).__name__}; "
                "make one by Scene.load(path) or Scene.parse(data)."
            )
        if not isinstance(pose, Pose | None):
            raise DomainError(
                f"Baker: expected a Pose, got a {type(pose).__name__}; make one by Pose(vertices)."
            )
        return Run(self.cache, scene, progress, cancel, self.assets, self.sandbox, pose)


def lasting_shelf(size_mb: float | None = None) -> Shelf:
    """The user's shelf for results that are dear; see `texsss.shelf.users_shelf`."""
    return users_shelf(KINDS, size_mb)


def bake(scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None) -> Baked:
    """The baked scene, by a fresh `Baker`."""
    return Baker().bake(scene, progress=progress, cancel=cancel)


def render(
    scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None
) -> Float[Tensor, "h w 3"]:
    """The scene's picture, linear RGB, by a fresh `Baker`."""
    return Baker().render(scene, progress=progress, cancel=cancel)
