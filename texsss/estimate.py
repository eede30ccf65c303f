"""What a bake is expected to cost, before it is run."""

from dataclasses import dataclass

from texsss import placing
from texsss.light.exchange import LOOKS
from texsss.light.irradiance import AREA_SAMPLES, SHARING
from texsss.light.sky import own_looks
from texsss.pipeline import Run
from texsss.scene import Scene
from texsss.surface._unwrap import LONG_S, check_room, unwrap_seconds
from texsss.surface.atlas import examine_uv, make_atlas
from texsss.surface.mesh import Mesh
from texsss.surface.topology import charts

FIXED_BYTES = 420 << 20  # interpreter, PyTorch and the libraries
POINT_BYTES = 28 + 6 * 12  # a texel's place, and what every stage holds of it in float32 RGB
GAUSSIAN_BYTES = 12  # one blurred copy, RGB
GRID_BYTES = 120  # images of the full square during diffusion and export
SECONDS_PER_TEXEL = {"uv": 1.6e-6, "none": 0.2e-6}  # per texel and Gaussian of the full square
OPERATOR_SECONDS = 10e-6  # to build and apply the operators of one texel
OPERATOR_BYTES = 800
SIDES_SECONDS = 0.5e-6  # per texel and Gaussian to leave out what faces away: five blurs for one
OCTREE_SECONDS = 50e-6  # to sum over an octree at one texel
RAYS_PER_LIGHT = {"studio": 3, "rectangle": AREA_SAMPLES, "sphere": AREA_SAMPLES}
RAYS_PER_SECOND = 1.5e6
THROUGH_RAYS = 15  # that thickness and what it lets pass cost, at about
EXCHANGE_RAYS, ECHO_RAYS = 12, 4  # what it costs to see other parts, and to gather their light once
EXCHANGE_BYTES = 12 * LOOKS  # if every look ends on the object
LAMPS = {"studio": 3, "rectangle": 4, "sphere": 4, "environment": 16}  # samples of a light in the march
UNSHADOWED = {"studio": 3, "rectangle": 3, "sphere": 3, "environment": 3}  # the same, of looks without rays
MARCH_SECONDS, STEP_SECONDS = 5e-6, 3e-7  # per hit and lamp, and for each of its steps
PICTURE_SHARE = 0.6  # of a picture's pixels that show the object, edges counted as often as they are sampled
PROJECTED_FACES_PER_SECOND = 2.5e4  # where xatlas would take too long
LARGE_FACES, LARGE_SIZE = 50_000, 2048  # from which it may take long
LONG_BAKE_S = 10.0  # worth a word beforehand
PACKED_SHARE = 0.7  # of the square that a made atlas covers


@dataclass(frozen=True)
class Estimate:
    """What a bake is expected to cost: `seconds`, `memory` [bytes], `texels`; `atlas`: how it is made."""

    seconds: float
    memory: int
    texels: int
    share: float
    atlas: str


def estimate(run: Run) -> Estimate:
    """The cost of a bake, within a factor of two; reads the mesh but bakes nothing.

    The seconds were measured on two cores of 2020s server hardware. Raises TexsssError: of the mesh, and
    where it has no room in the atlas or its texture coordinates are insisted on and of no use.
    """
    (mesh, _), scene = run.rest.value, run.scene
    size, terms = scene.atlas.texels, scene.methods.terms
    unwraps = scene.atlas.uv in ("xatlas", "fallback") or (
        scene.atlas.uv == "auto" and not serves(mesh, scene.atlas.size)
    )
    if scene.atlas.uv == "source":
        make_atlas(mesh, "source", size=scene.atlas.size)
    if unwraps:
        check_room(mesh, scene.atlas.size, scene.atlas.padding_texels)
    share = PACKED_SHARE if unwraps else source_share(mesh)
    texels = round(share * size * size)
    memory = FIXED_BYTES + texels * (POINT_BYTES + terms * GAUSSIAN_BYTES) + size * size * GRID_BYTES
    blur = SECONDS_PER_TEXEL.get(scene.methods.diffusion, max(SECONDS_PER_TEXEL.values())) * terms
    rays = rays_per_texel(scene)
    if scene.methods.transmission:
        rays += THROUGH_RAYS
        memory += texels * terms * GAUSSIAN_BYTES
    bounces = scene.methods.interreflection
    if bounces:
        rays += EXCHANGE_RAYS + bounces * ECHO_RAYS
        memory += texels * EXCHANGE_BYTES
    seconds = 2.0 + size * size * blur * (1 + bounces) / 3 + texels * rays / RAYS_PER_SECOND
    if run.marching != "none":
        width, height = scene.camera.resolution
        looks = UNSHADOWED if scene.methods.single_scattering == "auto" else LAMPS
        lamps = sum(looks.get(light.type, 1) for light in scene.lights)
        each = MARCH_SECONDS + scene.methods.march_samples * STEP_SECONDS
        seconds += PICTURE_SHARE * width * height * lamps * each
    faces = mesh.faces.shape[0]
    projected = scene.atlas.uv == "fallback" or (scene.atlas.uv == "auto" and unwrap_seconds(faces) > LONG_S)
    made = "projected along the axes" if projected else "made by xatlas"
    if unwraps:
        seconds += faces / PROJECTED_FACES_PER_SECOND if projected else unwrap_seconds(faces)
    if scene.methods.diffusion == "surface":
        seconds += texels * OPERATOR_SECONDS
        memory += texels * OPERATOR_BYTES
    if scene.methods.diffusion == "surface" and scene.methods.transmission:
        seconds += texels * terms * SIDES_SECONDS * (1 + bounces)
        memory += texels * terms * GAUSSIAN_BYTES
    if scene.methods.diffusion == "octree":
        seconds += texels * OCTREE_SECONDS
    atlas = made if unwraps else "the texture coordinates serve"
    return Estimate(seconds, memory, texels, share, atlas)


def rays_per_texel(scene: Scene) -> int:
    """Rays that look for light from each texel, by the samples of every light."""
    surroundings = sum(light.type == "environment" for light in scene.lights)
    looks = own_looks(placing.environment_samples(scene), SHARING)
    others = (light.type for light in scene.lights if light.type != "environment")
    return surroundings * looks + sum(RAYS_PER_LIGHT.get(kind, 1) for kind in others)


def described(run: Run) -> dict[str, str]:
    """The estimate as lines to show, after a look at everything that the scene names.

    Raises TexsssError: as a bake would of names and files.
    """
    (mesh, notes), _, _ = run.mesh.value, run.stack, run.surface_maps
    _ = run.lights
    if run.layered_textures:
        _ = run.inner, run.outer_opacity
    cost, size = estimate(run), run.scene.atlas.texels
    width, height, depth = mesh.extent.tolist()
    lines = {
        "object": f"{width:.4g} × {height:.4g} × {depth:.4g} mm, {mesh.faces.shape[0]:,} faces",
        "atlas": f"{size} × {size}, {cost.atlas}",
        "texels": f"{cost.texels:,} ({cost.share:.0%} of the square)",
        "memory": f"{cost.memory / 2**20:,.0f} MB at the peak",
        "seconds": f"{cost.seconds:.1f}",
    }
    if notes.messages:
        lines["notes"] = " ".join(notes.messages)
    return lines


def forewarning(run: Run) -> str | None:
    """A sentence on how long a bake will take, if that is long; small ones are not looked at closely."""
    (mesh, _), size = run.rest.value, run.scene.atlas.texels
    faces = mesh.faces.shape[0]
    if faces < LARGE_FACES and size < LARGE_SIZE:
        return None
    cost = estimate(run)
    if cost.seconds < LONG_BAKE_S:
        return None
    return f"{faces:,} faces at {size} × {size} ({cost.atlas}): about {cost.seconds:.0f} s; Ctrl-C stops."


def serves(mesh: Mesh, size: int) -> bool:
    """Whether the author's texture coordinates can carry the light."""
    if mesh.source_uv is None:
        return False
    chart = charts(mesh.faces, mesh.source_uv)
    return examine_uv(mesh, mesh.source_uv, chart, (size, size)).serves


def source_share(mesh: Mesh) -> float:
    """Share of the unit square that the author's texture coordinates cover, counted once per face."""
    assert mesh.source_uv is not None
    a, b, c = mesh.source_uv.unbind(1)
    (p, q), (r, s) = (b - a).unbind(-1), (c - a).unbind(-1)
    return min(float((p * s - q * r).abs().sum() / 2), 1.0)
