"""The march of one ray, literal and slow: vectors, layer thicknesses and float64, sample by sample."""

import math
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Site:
    """A point: two normals, offset of the fitted plane [mm], tangent frame, uv per mm (2, 2)."""

    position: Array
    normal: Array
    plane_normal: Array
    offset: float
    tangent: Array
    bitangent: Array
    uv: Array
    per_mm: Array


@dataclass(frozen=True)
class Layered:
    """`depth` (H, W, L) of lower boundaries [mm]; σs, σt (L, C) [1/mm]; Schlick's k (L,)."""

    depth: Array
    sigma_s: Array
    sigma_t: Array
    k: Array


def tiled(image: Array, uv: Array) -> Array:
    """Bilinear look-up of a texture that repeats."""
    height, width, _ = image.shape
    x, y = uv[0] * width - 0.5, uv[1] * height - 0.5
    i, j = math.floor(y), math.floor(x)
    fy, fx = y - i, x - j
    total = 0.0
    for di, wy in ((0, 1 - fy), (1, fy)):
        for dj, wx in ((0, 1 - fx), (1, fx)):
            total = total + wy * wx * image[(i + di) % height, (j + dj) % width]
    return total


def thicknesses(depth: Array) -> Array:
    return np.diff(depth, prepend=0.0)


def march_one(site: Site, layered: Layered, eye: Array, light: Array, intensity: Array, n: int) -> Array:
    """Radiance towards the eye (direction) from a point light (position) [1/mm² units of intensity]."""
    count = len(layered.k)
    depth_max = layered.depth[..., -1].max()
    P, N, NS = site.position, site.normal, site.plane_normal
    PS = P + site.offset * N
    end = P - eye * depth_max / (NS @ eye)  # M_max
    whole = np.linalg.norm(end - P)
    step = (end - P) / n
    attenuation = np.ones(layered.sigma_t.shape[1])
    radiance = np.zeros(layered.sigma_t.shape[1])

    def uv_at(x: Array) -> Array:
        d = x - P
        return site.uv + site.per_mm @ np.array([d @ site.tangent, d @ site.bitangent])

    for i in range(n):
        M = P + i * step
        depths = tiled(layered.depth, uv_at(M))
        z = -(M - P) @ NS
        layer = next((j for j in range(count) if z < depths[j]), None)
        if layer is not None:
            f = np.linalg.norm(M - P) / whole
            NM = (1 - f) * N + f * NS
            NM = NM / np.linalg.norm(NM)
            PM = (1 - f) * P + f * PS
            omega = (light - M) / np.linalg.norm(light - M)
            if NM @ omega > 0:
                cosine = max(NM @ omega, 0.03)
                KM = abs((M - PM) @ NM) / cosine
                K = M + KM * omega
                D = 0.5 * (thicknesses(depths) + thicknesses(tiled(layered.depth, uv_at(K))))
                left, inner = KM, np.zeros(count)
                for j in range(count):
                    inner[j] = min(max(left, 0.0), D[j] / cosine)
                    left -= D[j] / cosine
                arrives = intensity / ((light - M) @ (light - M)) * np.exp(-(layered.sigma_t.T @ inner))
                k = layered.k[layer]
                phase = (1 - k * k) / (4 * math.pi * (1 + k * (omega @ eye)) ** 2)
                radiance = radiance + layered.sigma_s[layer] * phase * arrives * attenuation * np.linalg.norm(
                    step
                )
            attenuation = attenuation * np.exp(-layered.sigma_t[layer] * np.linalg.norm(step))
    return radiance
