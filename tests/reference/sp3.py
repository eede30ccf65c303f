"""The two-mode model's collided part R_c, T_c by collocation: the twin of `layered-sp3` without its R1.

Two even-parity components ψ_j along the cosines μ_j, whose weights w_j sum to 1 and make Σ w_j μ_j² = 1/3:

    -(μ_j²/σ) ψ_j'' + (σ + s² μ_j²/σ) ψ_j = a σ Σ_i w_i ψ_i + σs' t(z)           σ = σt', a = albedo'

That is -D_j ψ_j'' + D_j K_j ψ_j - D_j (σ² a/μ_j²) Σ w_i ψ_i = q with D_j = μ_j²/σ, K_j = σ²/μ_j² + s²; and
since c_j = w_j a σ²/μ_j², the matrix D⁻¹M has the eigenvalues λ± of the closed form. Boundary conditions,
fitted per eta, and what leaves by a face:

    top      D_j ψ_j' = B_j ψ_j,   B_j = D_j b_j sqrt(σ²/μ_j² + γ_j s²)          (bottom alike, sign reversed)
    out      R_c = Σ_j w_j e_j ψ_j(0),   e_j = D_j b_j sqrt(σ²/μ_j² + δ_j s²)

The closed form is the adjoint: it solves the homogeneous system for χ with (diag B + Y) χ = e at the face
and integrates σs' t Σ w_j χ_j over the depth. Both agree by Green's identity, because w_j times equation j
is self-adjoint: Σ_j w_j D_j [χ_j ψ_j' - ψ_j χ_j'] = Σ_j w_j (χ_j B_j ψ_j - ψ_j (B_j χ_j - e_j)) = Σ_j w_j
e_j ψ_j at 0.

Along a layer that hardly scatters light spreads no farther than it flies: s² there is times σ and the mean
path since the last scattering (`spread_aside`), and less where it sees a face.

At eta = 1 the cosines are Gauss nodes and b = γ = δ = 1. Where indices differ, ψ / eta² is continuous, and
the medium has the cosines of the index through which light enters. A face of another index, with w', μ', b
and γ of its own, lets the same out, B_j = (w_j' / w_j) (μ_j'² / σ) b_j sqrt(σ²/μ_j'² + γ_j s²), and inner
layers beneath a thin outermost one decide with it how much that is (`let_out`).

Light that scattered twice and more is R_c - R_u, led out as R_u is wrong of light that scattered once, by how
much more than at s = 0.
"""

from collections.abc import Sequence

import numpy as np

from reference.beam import Light, beams
from reference.boundary import Array, impedance
from reference.collocation import Region, solve
from reference.layers import Layer, check_stack

# eta: μ1 μ2, b1 b2, γ1 γ2, δ1 δ2, fitted to half-spaces
MODES = {
    1.0: ((0.2113249, 0.7886751), (1, 1), (1, 1), (1, 1)),
    1.1: ((0.16907, 0.77852), (0.067696, 0.89174), (148.41, 3.6767), (20.279, 2.4125)),
    1.2: ((0.21354, 0.86588), (0.044862, 0.80475), (148.41, 4.1015), (38.542, 2.2842)),
    1.3: ((0.28336, 0.94983), (0.044072, 0.79374), (148.41, 3.7649), (106.60, 1.6315)),
    1.33: ((0.28462, 0.96756), (0.042150, 0.75428), (148.41, 3.7518), (95.369, 1.6215)),
    1.4: ((0.26827, 0.99459), (0.036438, 0.63064), (148.41, 4.0085), (55.378, 1.8326)),
    1.5: ((0.25610, 0.99459), (0.027079, 0.48842), (148.41, 5.0925), (27.917, 2.2529)),
    1.6: ((0.26713, 0.99459), (0.019483, 0.40854), (148.41, 6.4265), (21.723, 2.6469)),
}


# of the ratio of light that scattered once to what modes make of it: R and T; and what it fades out by
MOST, SMOOTH, FADED = (3, 1.5), 0.1, 0.01
SLANT = 2  # path over thickness of light that crosses a layer
ROUND = 0.03  # of the corner of that share at 1
OWN = 4  # a layer makes 1 - e^-(4 σ d) of a face its own, and e^-(4 τ) of what lies at τ sees the face


def spread_aside(layers: Sequence[Layer], k: int) -> float:
    """σ times the mean path since the last scattering of light that leaves layer k, both ways; 1 at most.

    Traced backwards segment by segment; the outer faces mirror. Times itself for light that sees a face.
    """
    paths = []
    for step in (1, -1):  # into the layer, downwards: what leaves by its top; upwards: by its bottom
        at, step, left, path = k, step, 1.0, 0.0
        while left > 1e-12:
            sigma, crossing = layers[at].sigma_t_prime, SLANT * layers[at].thickness
            path += left * (1 - np.exp(-sigma * crossing)) / sigma
            left *= np.exp(-sigma * crossing)
            if 0 <= at + step < len(layers):
                at += step
            else:
                step = -step
        paths.append(path)
    share = layers[k].sigma_t_prime * float(np.mean(paths))
    share = share * (1 - share + ROUND) / (1 - share + ROUND * share) if share < 1 else 1.0
    depths = [OWN * layer.sigma_t_prime * layer.thickness for layer in layers]
    hidden = (1 - np.exp(-sum(depths[:k]))) * (1 - np.exp(-sum(depths[k + 1 :])))
    return share * (share + hidden * (1 - share))


def weights(mu: Array) -> Array:
    """w of two cosines: Σ w = 1 and Σ w μ² = 1/3."""
    return np.linalg.solve([[1, 1], mu**2], [1, 1 / 3])


def let_out(layers: Sequence[Layer]) -> float:
    """What the first of `layers` lets out, over what it would if it were thick."""
    depths = np.cumsum([0.0, *(layer.sigma_t_prime * layer.thickness for layer in layers)])
    shares = -np.diff(np.exp(-OWN * depths))
    outlets = [layer.eta**2 / impedance(layer.eta) for layer in layers]
    return float(shares @ outlets / (shares.sum() * outlets[0]))


def collided(
    layers: Sequence[Layer], s: Array, scattering: bool = True, cosine: float = 1.0
) -> tuple[Array, Array]:
    """R_c(s), T_c(s), (S,) each; without scattering (a = 0, source kept) R_u and T_u.

    eta of the outer layers: of MODES. cosine: of the entering beam inside.
    """
    check_stack(layers)
    mu = np.array(MODES[layers[0].eta][0])
    w = weights(mu)
    infinite = np.isinf(layers[-1].thickness)

    def faces(stack: Sequence[Layer], frequency: float) -> tuple[Array, Array]:
        """What the face of the first layer of `stack` takes of the modes, and what of it comes out."""
        own, b, gamma, delta = (np.array(pair, dtype=float) for pair in MODES[stack[0].eta])
        sigma = stack[0].sigma_t_prime
        taken = weights(own) / w * own**2 / sigma * b * let_out(stack)
        lost, out = (np.sqrt(sigma**2 / own**2 + growth * frequency**2) for growth in (gamma, delta))
        return taken * lost, taken * out

    R, T = [], []
    for frequency in np.atleast_1d(s):
        regions = []
        for k, (layer, light) in enumerate(zip(layers, beams(layers, cosine))):
            sigma = layer.sigma_t_prime
            D = mu**2 / sigma
            M = np.diag(sigma + frequency**2 * spread_aside(layers, k) * D)
            if scattering:
                M = M - layer.sigma_s_prime * np.outer(np.ones(2), w)

            def source(z: float, layer: Layer = layer, light: Light = light) -> Array:
                return layer.sigma_s_prime * light.both(z) * np.ones(2)

            regions.append(Region(D, M, source, light.rate, layer.thickness, layer.eta**2))
        (top, above), (bottom, below) = faces(layers, frequency), faces(layers[::-1], frequency)
        upper, lower = solve(regions, top, None if infinite else bottom)
        R.append(w @ (above * upper))
        T.append(w @ (below * lower))
    return np.array(R), np.array(T)


def scattered_more(layers: Sequence[Layer], s: Array, once: Sequence[Array]) -> list[Array]:
    """R and T of two or more scatterings (S,), up to one factor; thin slabs and films aside.

    once: R1 and T1 (S,) by whatever means; s: 0 first.
    """
    coupled, alone = collided(layers, s), collided(layers, s, scattering=False)
    found = []
    for with_, without, exact, most in zip(coupled, alone, once, MOST):
        more = with_ - without
        if without.any():  # something comes out below
            whole = 1 + np.sqrt(1 + SMOOTH**2)
            ratio = exact / exact[0] / (without / without[0])
            ratio = (ratio + np.sqrt(ratio**2 + SMOOTH**2)) / whole
            rest = FADED / whole * more / without
            more = more * (1 + most * ratio + rest) / (most + ratio + rest)
        found.append(more)
    return found
