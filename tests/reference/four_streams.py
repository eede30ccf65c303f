"""Layers by discrete ordinates, two cosines per hemisphere: the twin of `profiles.four_streams`.

Intensities I± along the cosines ±μ_j, of weights w_j, under collimated light of cosine μ' and strength b(z):

    ±μ_j dI±_j/dz = -σ I±_j + ½ σs Σ_i,± w_i P±(j, i) I±_i + ½ σs P±(j, μ') b(z)

    P±(j, i) = 1 ± g1 μ_j μ_i / M + g2 p_j p_i / Σ w p²,   p = P2(μ) - Σ w P2,   M = Σ w μ²

An outer face mirrors of I_j what Fresnel's law keeps of the cosines that it stands for. Between layers
I+ - I- and (I+ + I-) / eta² are continuous. Layers are cut into sheets, each crossed by one matrix
exponential, and the values at all cuts found at once; an endless layer ends where nothing is felt any more.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from reference.beam import beams, unscattered
from reference.boundary import Array, fresnel
from reference.layers import Layer

THICK = 2.0  # optical depth of a sheet: growing solutions lose no digits
CELLS = 100_000  # of the midpoint rule over the cosines of a stream
DEEP = 40.0  # decay lengths of an endless layer


class Streams(NamedTuple):
    cut: float  # between the cosines that the first and the second stream stand for
    mu: Array
    w: Array


def lacking(layers: Sequence[Layer], cosine: float) -> tuple[float, float]:
    """What leaves by the top and by the bottom with the moments g, g², g³ less what does by similarity.

    Under a beam at `cosine` inside the first layer; unscattered light is counted in both.
    """
    found = [_peaked(layer) for layer in layers]
    truth = _leaving([layer for layer, _ in found], [moments for _, moments in found], cosine)
    level = [replace(layer, sigma_s=layer.sigma_s_prime, g=0.0) for layer in layers]
    similar = _leaving(level, [(0.0, 0.0)] * len(layers), cosine)
    return truth[0] - similar[0], truth[1] - similar[1]


def _peaked(layer: Layer) -> tuple[Layer, tuple[float, float]]:
    """A share g³ of what is scattered goes straight on: the rest, isotropic in name, and its moments."""
    g, straight = layer.g, layer.g**3
    rest = replace(layer, sigma_s=layer.sigma_s * (1 - straight), g=0.0)
    return rest, ((g - straight) / (1 - straight), (g**2 - straight) / (1 - straight))


def _streams(eta: float) -> Streams:
    """Halves of the hemisphere by what can leave, cosines whose mean is ½ and whose spread was fitted."""
    cut = float(np.clip(np.sqrt(1 - 1 / eta**2), min(0.5, eta - 0.6), 0.75))
    w = np.array([cut, 1 - cut])
    width = np.sqrt(1 / 12 - 0.03 * min((eta - 1) / 0.33, 1.0))
    return Streams(cut, 0.5 + width * np.array([-np.sqrt(w[1] / w[0]), np.sqrt(w[0] / w[1])]), w)


def _mirrored(streams: Streams, eta: float) -> Array:
    """What a face of index `eta` sends back of either stream."""
    middles = (np.arange(CELLS) + 0.5) / CELLS
    kept = []
    for low, high, mu, w in zip((0, streams.cut), (streams.cut, 1), streams.mu, streams.w):
        x = low + (high - low) * middles
        passed = (high - low) * np.mean(x * (1 - fresnel(x, 1 / eta)))
        kept.append(1 - min(passed / (w * mu), 1.0))
    return np.array(kept)


def _leaving(
    layers: Sequence[Layer], moments: Sequence[tuple[float, float]], cosine: float
) -> tuple[float, float]:
    """R and T, unscattered light included, of layers whose coefficients are the true ones here."""
    streams = _streams(max(layer.eta for layer in layers))
    mu, w = streams.mu, streams.w
    M, legendre = w @ mu**2, (3 * mu**2 - 1) / 2
    p = legendre - w @ legendre
    sign = np.array([1, 1, -1, -1])
    here, spread = sign * np.tile(mu, 2), np.tile(p, 2)
    across, made, etas = [], [], []
    for layer, (g1, g2), lit in zip(layers, moments, beams(layers, cosine)):
        beam = np.array([lit.cosine, -lit.cosine])
        beam_spread = (3 * beam**2 - 1) / 2 - w @ legendre
        kernel, entry = (
            layer.sigma_s / 2 * (1 + g1 / M * np.outer(here, c) + g2 / (w @ p**2) * np.outer(spread, x))
            for c, x in ((here, spread), (beam, beam_spread))
        )
        whole = np.zeros((6, 6))  # the streams, and light straight down and up
        whole[:4, :4] = (kernel * np.tile(w, 2) - layer.sigma_t * np.eye(4)) / here[:, None]
        whole[:4, 4:] = entry / here[:, None]
        whole[4:, 4:] = np.diag([-lit.rate, lit.rate])
        depth = layer.thickness
        if np.isinf(depth):
            depth = DEEP / np.abs(np.linalg.eigvals(whole[:4, :4]).real).min()
        count = int(np.ceil(depth * layer.sigma_t / (THICK * mu.min())))
        sheet = expm(whole * depth / count)
        for z in np.arange(count) * depth / count:
            across.append(sheet[:4, :4])
            made.append(sheet[:4, 4:] @ [lit.down(z), lit.up(z)])
            etas.append(layer.eta)
    upper, lower = (_mirrored(streams, eta) for eta in (etas[0], etas[-1]))
    first, last = _ends(across, made, etas, upper, lower)
    R, T = unscattered(layers, cosine)
    return R + (w * mu * (1 - upper)) @ first[2:], T + (w * mu * (1 - lower)) @ last[:2]


def _ends(
    across: Sequence[Array], made: Sequence[Array], etas: Sequence[float], upper: Array, lower: Array
) -> tuple[Array, Array]:
    """Intensities (4,) within the top and within the bottom of a pile of sheets, down before up."""
    count = len(across)
    system, right = np.zeros((4 * count + 4, 4 * count + 4)), np.zeros(4 * count + 4)
    system[:2, :4] = np.hstack([np.eye(2), -np.diag(upper)])
    for k in range(count):
        here, below = slice(4 * k, 4 * k + 4), slice(4 * k + 4, 4 * k + 8)
        rows = slice(4 * k + 2, 4 * k + 6)
        step = _step(etas[min(k + 1, count - 1)], etas[k])
        system[rows, here], system[rows, below], right[rows] = across[k], -step, -made[k]
    system[-2:, -4:] = np.hstack([-np.diag(lower), np.eye(2)])
    found = np.linalg.solve(system, right)
    return found[:4], found[-4:]


def _step(below: float, above: float) -> Array:
    """Intensities above an interface by those below it."""
    even, odd = (above / below) ** 2, 1.0
    return np.kron(np.array([[even + odd, even - odd], [even - odd, even + odd]]) / 2, np.eye(2))
