"""A perspective camera, and what its rays hit first."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from texsss.errors import DomainError
from texsss.light.visibility import Occluder
from texsss.surface.mesh import Mesh
from texsss.surface.points import Points
from texsss.types import Float, Int, Tensor, unit

Triple = Sequence[int | float] | Tensor
SEEDS_APART = 65_537  # between the rays of a pixel


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a picture is taken from.

    `position`, `target` (3,) [mm]; `up` (3,): any direction that leans upwards in the picture;
    `fov_y`: angle that the height of the picture subtends [radians]; `resolution` (w, h) [pixels].
    Pixel (i, j), i down, has its centre at x = j + ½, y = i + ½.
    Raises DomainError: when these span no picture.
    """

    position: Triple
    target: Triple
    up: Triple = (0.0, 1.0, 0.0)
    fov_y: float = math.radians(35)
    resolution: tuple[int, int] = (800, 600)

    def __post_init__(self):
        for field in ("position", "target", "up"):
            value = torch.as_tensor(getattr(self, field)).to(torch.float64)
            if value.shape != (3,) or not bool(torch.isfinite(value).all()):
                raise DomainError(f"Camera: expected three finite numbers for {field}, got {value.tolist()}.")
            object.__setattr__(self, field, value)
        if not 0 < self.fov_y < math.pi:
            raise DomainError(
                f"Camera: expected a field of view between 0 and π radians, got {self.fov_y}; "
                "35 degrees are .61 radians."
            )
        if not all(1 <= side <= 16384 for side in self.resolution):
            raise DomainError(f"Camera: expected 1 to 16384 pixels a side, got {self.resolution}.")
        if not float(torch.linalg.vector_norm(self._ahead)) > 0:
            raise DomainError("Camera: expected position and target apart, got the same point; move one.")

    @property
    def _ahead(self) -> Float[Tensor, "3"]:
        return self.target - self.position  # type: ignore[operator]

    @property
    def axes(self) -> Float[Tensor, "3 3"]:
        """Orthonormal rows: right, up, ahead. float64."""
        ahead = unit(self._ahead)
        right = torch.linalg.cross(ahead, self.up)  # type: ignore[arg-type]
        if float(torch.linalg.vector_norm(right)) < 1e-9 * float(torch.linalg.vector_norm(self.up)):  # type: ignore[arg-type]
            # looking along `up`: z is up in the picture
            right = torch.linalg.cross(ahead, ahead.new_tensor([0.0, 0.0, -1.0 if ahead[1] > 0 else 1.0]))
        if float(torch.linalg.vector_norm(right)) < 1e-9:
            right = ahead.new_tensor([1.0, 0.0, 0.0])
        right = unit(right)
        return torch.stack([right, torch.linalg.cross(right, ahead), ahead])

    @property
    def pixel_scale(self) -> float:
        """Pixels per unit of tangent."""
        return self.resolution[1] / 2 / math.tan(self.fov_y / 2)

    def directions(self, xy: Float[Tensor, "P 2"]) -> Float[Tensor, "P 3"]:
        """Unit directions of the rays through `xy` [pixels]."""
        width, height = self.resolution
        x = (xy[:, 0] - width / 2) / self.pixel_scale
        y = (height / 2 - xy[:, 1]) / self.pixel_scale
        return unit(torch.stack([x, y, torch.ones_like(x)], -1) @ self.axes.to(xy))

    def project(self, position: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """Where points [mm] appear: x, y [pixels] and depth along the axis [mm]; nan behind the camera."""
        local = (position - self.position.to(position)) @ self.axes.to(position).T  # type: ignore[union-attr]
        x, y, depth = local.unbind(-1)
        width, height = self.resolution
        ahead = torch.where(depth > 0, depth, torch.full_like(depth, torch.nan))
        return torch.stack(
            [width / 2 + self.pixel_scale * x / ahead, height / 2 - self.pixel_scale * y / ahead, depth], -1
        )


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays of a camera hit: `pixel` (P,) row-major index; `points` on the mesh; `view` (P, 3) unit
    directions from there to the camera; `distance` (P,) [mm]. `sample`: which of a pixel's rays these
    are, so that each can draw random numbers of its own."""

    pixel: Int[Tensor, " P"]
    points: Points
    view: Float[Tensor, "P 3"]
    distance: Float[Tensor, " P"]
    sample: int = 0

    def seed(self, seed: int) -> int:
        """A seed of their own, made from that of the picture."""
        return seed + SEEDS_APART * self.sample + int(self.pixel[:1].sum())


def fit_camera(
    mesh: Mesh,
    *,
    direction: Triple = (0.0, 0.0, 1.0),
    up: Triple = (0.0, 1.0, 0.0),
    fov_y: float = math.radians(35),
    resolution: tuple[int, int] = (800, 600),
    margin: float = 0.04,
) -> Camera:
    """The nearest camera that sees all of `mesh`, centred, from `direction` (+z: from the front).

    `margin`: share of the picture left free on each side. Exact: every vertex bounds the four sides
    of the view, and the tightest ones fix where the camera stands.
    Raises DomainError: when direction is 0 or margin outside 0..½.
    """
    if not 0 <= margin < 0.5:
        raise DomainError(f"fit_camera: expected a margin from 0 to below .5, got {margin}.")
    towards = torch.as_tensor(direction).to(torch.float64)
    used = mesh.vertices.detach()[mesh.faces.reshape(-1).long().unique()].to("cpu", torch.float64)
    centre = (used.amin(0) + used.amax(0)) / 2
    extent = max(float((used.amax(0) - used.amin(0)).amax()), 1e-12)
    if not float(torch.linalg.vector_norm(towards)) > 0:
        raise DomainError("fit_camera: expected a direction, got (0, 0, 0); (0, 0, 1) is the front.")
    aim = Camera(centre + unit(towards) * extent, centre, up, fov_y, resolution)
    right, over, ahead = ((used - centre) @ aim.axes.T).unbind(-1)
    half = math.tan(fov_y / 2) * (1 - 2 * margin)
    tangents = (half * resolution[0] / resolution[1], half)
    middle, back = [], []
    for across, tangent in zip((right, over), tangents):
        # a vertex is in view when ±(across - middle) ≤ tangent (ahead + back)
        high, low = (across - tangent * ahead).amax(), (-across - tangent * ahead).amax()
        middle.append((high - low) / 2)
        back.append((high + low) / 2 / tangent)
    away = torch.stack(back).amax()
    eye = centre + torch.stack([middle[0], middle[1], -away]) @ aim.axes
    return Camera(eye, eye + (away + 0.5 * extent) * aim.axes[2], up, fov_y, resolution)


def primary_hits(
    camera: Camera,
    occluder: Occluder,
    xy: Float[Tensor, "P 2"],
    pixel: Int[Tensor, " P"],
    dtype: torch.dtype,
    *,
    sample: int = 0,
) -> Hits:
    """First hits of the rays through `xy` [pixels]; rays that miss are left out.

    `pixel` (P,): the row-major index of the pixel that each ray belongs to; `sample` as in `Hits`.
    """
    directions = camera.directions(xy)
    origin = camera.position.to(directions).expand_as(directions)  # type: ignore[union-attr]
    face, bary, distance = occluder.closest(origin, directions)
    rows = (face >= 0).nonzero()[:, 0]
    points = Points(face[rows], bary[rows].to(dtype))
    return Hits(pixel[rows], points, -directions[rows].to(dtype), distance[rows].to(dtype), sample)


def pixel_centres(camera: Camera) -> Float[Tensor, "P 2"]:
    """Centres of all pixels, row-major [pixels]. float64."""
    width, height = camera.resolution
    y, x = torch.meshgrid(
        torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64), indexing="ij"
    )
    return torch.stack([x, y], -1).reshape(-1, 2) + 0.5
