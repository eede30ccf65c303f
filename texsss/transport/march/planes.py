"""Planes fitted around every vertex: what the surface looks like from some mean free paths away."""

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded where they are first used
import torch

from texsss.errors import DomainError, ShapeError
from texsss.surface.mesh import Mesh
from texsss.transport.neighbours import spread_around
from texsss.types import Float, Tensor, unit

EPSILON = 0.01  # light attenuated to this share comes from too far away to matter
MOST_PAIRS = 1_000_000  # beyond that, neighbours are taken in clusters
MOST_PAIRS_COMPILED = 30_000_000  # which the loop in C++ takes no longer for
FINENESS = 4  # radii that are told apart, per doubling
COLLINEAR = 0.02  # second variance as a share of the first, below which points follow a line and its bend
LEAST_SLANT = 0.1  # cosine between the normals below which an offset along the normal means nothing


@dataclass(frozen=True, eq=False)
class Planes:
    """A plane per vertex.

    `normal` (V, 3): unit, on the side of the vertex normal. `offset` (V,): how far along its vertex
    normal each vertex has to move to lie on its plane [mm], positive outwards.
    """

    normal: Float[Tensor, "V 3"]
    offset: Float[Tensor, " V"]

    def __post_init__(self):
        if self.normal.shape[0] != self.offset.shape[0]:
            raise ShapeError(
                f"Planes: expected as many offsets as normals, got {self.offset.shape[0]} and "
                f"{self.normal.shape[0]}; fit both to one mesh."
            )


def plane_radius(sigma_t: float, epsilon: float = EPSILON) -> float:
    """Distance over which light is attenuated to `epsilon`, -ln ε / σt [mm].

    `sigma_t` [1/mm]: of the first layer, the smallest channel. Raises DomainError: when it is not
    above 0 or ε not within 0..1. Source: François et al. 2006, eq. 8.
    """
    if not (sigma_t > 0 and math.isfinite(sigma_t)):
        raise DomainError(
            f"plane_radius: expected a finite sigma_t > 0 [1/mm], got {sigma_t:g}; nothing dims in a clear "
            "first layer, so pass the radius itself."
        )
    if not 0 < epsilon < 1:
        raise DomainError(f"plane_radius: expected 0 < epsilon < 1, got {epsilon:g}; .01 is usual.")
    return -math.log(epsilon) / sigma_t


def rounded_radius(radius_mm: float) -> float:
    """The nearest of radii a fixed ratio apart [mm]: materials alike have planes in common.

    At most 9 % away, where light is attenuated to between .6 and 1.5 % in place of 1.
    """
    return 2.0 ** (round(FINENESS * math.log2(radius_mm)) / FINENESS)


def fit_planes(mesh: Mesh, radius_mm: float) -> Planes:
    """Least-squares plane around every vertex, through the vertices within `radius_mm` [mm].

    One batched operation, fast enough to be repeated for every frame of a deforming mesh. Vertices
    whose normals face away are left out: they belong to the other side of a thin part. Where fewer
    than three neighbours are left, or they lie on a line, the plane is the tangent plane. Meshes so
    dense that neighbours would number tens of millions (without a compiler, or in float64: millions) are
    fitted through clusters a fifth of the radius wide.
    Without gradients. Raises DomainError: when the radius is not above 0.
    Source: François et al. 2006, section 2.2; the offset is kept apart from the normal's length
    (their eq. 14 hides it there) and signed.
    """
    if not radius_mm > 0:
        raise DomainError(
            f"fit_planes: expected a radius above 0 [mm], got {radius_mm:g}; see plane_radius for one."
        )
    home = mesh.vertices
    vertices, faced = home.detach().cpu().double().numpy(), _vertex_normals(mesh)
    outward = faced.cpu().double().numpy()
    radius = min(radius_mm, 2 * mesh.diagonal_mm)
    probe = vertices[:: max(1, len(vertices) // 256)]
    typical = scipy.spatial.KDTree(vertices).query_ball_point(probe, radius, return_length=True).mean()
    pairs = typical * len(vertices) / 2
    around = spread_around(home.detach(), faced, radius) if pairs <= MOST_PAIRS_COMPILED else None
    if around is not None:
        centroid, normal, sound = _fit(vertices, around.double().numpy())
    elif pairs <= MOST_PAIRS:
        centroid, normal, sound = _fit(vertices, _around(vertices, outward, _moments(vertices), radius))
    else:
        centroid, normal, sound = _through_clusters(vertices, outward, radius)
    facing = (normal * outward).sum(1)
    normal = np.where(facing[:, None] < 0, -normal, normal)
    sound = sound & (np.abs(facing) >= LEAST_SLANT)
    normal = np.where(sound[:, None], normal, outward)
    slant = np.where(sound, np.abs(facing), 1.0)
    offset = np.where(sound, ((centroid - vertices) * normal).sum(1) / slant, 0.0).clip(-radius, radius)
    return Planes(torch.from_numpy(normal).to(home), torch.from_numpy(offset).to(home))


def tangent_planes(mesh: Mesh) -> Planes:
    """The tangent plane at every vertex: what the fitted ones are on a flat surface."""
    normal = _vertex_normals(mesh)
    return Planes(normal, normal.new_zeros(len(normal)))


def _vertex_normals(mesh: Mesh) -> Float[Tensor, "V 3"]:
    """Angle-weighted unit normals per vertex; +z where a vertex has no face."""
    corner = mesh.corner_normals.detach().reshape(-1, 3)
    total = torch.zeros_like(mesh.vertices).index_add_(0, mesh.faces.reshape(-1).long(), corner)
    lost = torch.linalg.vector_norm(total, dim=1, keepdim=True) < 1e-6
    return unit(torch.where(lost, total.new_tensor([0.0, 0.0, 1.0]), total))


def _moments(points: np.ndarray) -> np.ndarray:
    """1, x and the six distinct x xᵀ of every point, (n, 10)."""
    x, y, z = points.T
    return np.stack([np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z], 1)


def _around(sites: np.ndarray, outward: np.ndarray, moments: np.ndarray, radius: float) -> np.ndarray:
    """Moments (n, 10) of what lies around every site and faces as it does, seen from there."""
    count = len(sites)
    pairs = scipy.spatial.KDTree(sites).query_pairs(radius, output_type="ndarray")
    alike = np.einsum("pd,pd->p", outward[pairs[:, 0]], outward[pairs[:, 1]]) > 0
    a, b = pairs[alike].T
    own = np.arange(count)
    near = scipy.sparse.csr_matrix(
        (np.ones(2 * len(a) + count), (np.concatenate([a, b, own]), np.concatenate([b, a, own]))),
        shape=(count, count),
    )
    total = near @ moments
    return _moved(total, -sites)


def _moved(moments: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Moments (n, 10) of points that move by a step each, (n, 3)."""
    number, first, second = moments[:, :1], moments[:, 1:4], moments[:, 4:]
    (a, b), own = np.triu_indices(3), by * number
    crossed = first[:, a] * by[:, b] + by[:, a] * first[:, b] + own[:, a] * by[:, b]
    return np.concatenate([number, first + own, second + crossed], 1)


def _fit(sites: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centroid (n, 3), normal (n, 3) of the plane around every site, and whether there is one (n,).

    `moments` (n, 10): of what lies around it, seen from there.
    """
    mean = moments[:, 1:] / moments[:, :1]
    apart = mean[:, :3]
    square = mean[:, [3, 4, 5, 4, 6, 7, 5, 7, 8]].reshape(-1, 3, 3)
    variance, axes = torch.linalg.eigh(torch.from_numpy(square - apart[:, :, None] * apart[:, None, :]))
    spans = variance[:, 1] > COLLINEAR * variance[:, 2]
    sound = (moments[:, 0] >= 3) & spans.numpy() & (variance[:, 2] > 0).numpy()
    return sites + apart, axes[:, :, 0].numpy(), sound


def _through_clusters(
    vertices: np.ndarray, outward: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`_fit` on clusters of vertices that lie and face alike, handed down to their members."""
    cell = np.floor((vertices - vertices.min(0)) / (radius / 5)).astype(np.int64)
    size = cell.max(0) + 1
    axis = np.argmax(np.abs(outward), 1)
    backwards = np.take_along_axis(outward, axis[:, None], 1)[:, 0] < 0
    key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 6 + 2 * axis + backwards
    _, member = np.unique(key, return_inverse=True)
    count = int(member.max()) + 1
    gather = scipy.sparse.csr_matrix(
        (np.ones(len(member)), (member, np.arange(len(member)))), shape=(count, len(member))
    )
    moments = gather @ _moments(vertices)
    sites = moments[:, 1:4] / moments[:, :1]
    normals = gather @ outward
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    centroid, normal, sound = _fit(sites, _around(sites, normals, moments, radius))
    return centroid[member], normal[member], sound[member]
