"""Diffusion through N layers in closed form, per row and Hankel frequency: `layered-diffusion`.

The diffusion equation is solved for the whole stack at once, with u = φ / eta² and the flux
eta² D u' continuous across interfaces. The light enters as an exponential source σs' e^-τ(z) through
all layers. A layer is a two-port: seen from one side it has an admittance Y = flux / u, and the
solution ψ that satisfies the conditions on the far side is written with cosh and sinh, scaled by
e^-κd, so that every term is positive, nothing overflows, and σa = 0, s = 0 and d = 0 are ordinary.
Source: the boundary-value problem of Donner & Jensen 2005, solved without poles; D of d'Eon & Irving 2011.
"""

from dataclasses import dataclass

import torch

from texsss.media import fresnel
from texsss.media.stack import LayerTable
from texsss.numerics.exponentials import relexp
from texsss.types import Float, Tensor

_CLEAR = 1e-6  # a layer extinguishes at least this [1/mm], so that a clear one has a finite D
_TINY = 1e-24  # keeps the derivative of √ finite where nothing is absorbed and s = 0


@dataclass(frozen=True, eq=False)
class _Slab:
    """A layer, ready for all frequencies: rows (N,) and frequencies by rows (S, N)."""

    sigma: Tensor  # extinction along the refracted beam, per depth
    source: Tensor  # reduced scattering along the beam, per depth
    d: Tensor
    beam: Tensor  # e^(-sigma d)
    flux: Tensor  # eta² D
    kappa: Tensor  # (S, N)
    decay: Tensor  # e^(-κ d), (S, N)
    cosh: Tensor  # e^(-κ d) cosh(κ d)
    sinh: Tensor  # e^(-κ d) sinh(κ d) / κ

    def behind(self, far: Tensor) -> tuple[Tensor, Tensor]:
        """Admittance of the layer backed by the admittance `far`, and the scaled ψ at its near side."""
        near = self.cosh + far / self.flux * self.sinh
        return (far * self.cosh + self.flux * self.kappa**2 * self.sinh) / near, near

    def beam_integrals(self) -> tuple[Tensor, Tensor]:
        """∫ e^(-σz - κz) and ∫ e^(-σz) e^(-κ(d - z)) over the layer."""
        together = (
            -torch.expm1(-self.sigma * self.d) * self.decay
            + self.kappa * self.d * relexp(self.kappa * self.d)
        ) / (self.sigma + self.kappa)
        against = (
            torch.maximum(self.beam, self.decay) * self.d * relexp((self.sigma - self.kappa).abs() * self.d)
        )
        return together, against


def reflectance(table: LayerTable, s: Float[Tensor, " S"], cosine: float) -> Float[Tensor, "S N"]:
    """R̂(s) of light that entered at `cosine` inside, per row and channel, flattened to N.

    `s` [1/mm]. Differentiable in `table` and `s`.
    """
    coefficients = _flat(table)
    sweep = [_slab(*c, s, cosine) for c in coefficients[: len(coefficients) - table.bottomless]]
    top = table.eta[0] ** 2 / (2 * fresnel.A(table.eta[0]))
    if table.bottomless:
        sigma, source, flux, kappa = _half_space(*coefficients[-1], s, cosine)
        far = flux * kappa
        response = source / (sigma + kappa)
    else:
        far = s.new_tensor(table.eta[-1] ** 2 / (2 * fresnel.A(table.eta[-1])))
        response = s.new_zeros(())
    # upwards: what the surface of each layer receives of all light below, ψ being 1 there
    for slab in reversed(sweep):
        admittance, near = slab.behind(far)
        together, against = slab.beam_integrals()
        cosh = (together + slab.decay * against) / 2
        sinh = (slab.sinh - cosh) / slab.sigma  # by parts; ∫ sinh(κ(d - z))/κ e^(-σz)
        own = slab.source * (cosh + far / slab.flux * sinh)
        response = (own + slab.decay * slab.beam * response) / near
        far = admittance
    return top / (top + far) * response


def transmittance(table: LayerTable, s: Float[Tensor, " S"], cosine: float) -> Float[Tensor, "S N"]:
    """T̂(s) of scattered light below the stack, like `reflectance`; 0 without a bottom."""
    coefficients = _flat(table)
    if table.bottomless:
        return s.new_zeros(s.shape[0], coefficients[-1][0].shape[0])
    bottom = table.eta[-1] ** 2 / (2 * fresnel.A(table.eta[-1]))
    near_side = s.new_tensor(table.eta[0] ** 2 / (2 * fresnel.A(table.eta[0])))
    response = s.new_zeros(())
    beam = s.new_ones(())
    # downwards: what the lower face of each layer receives of all light above
    for c in coefficients:
        slab = _slab(*c, s, cosine)
        admittance, near = slab.behind(near_side)
        together, against = slab.beam_integrals()
        cosh = (slab.decay * together + against) / 2
        sinh = (cosh - slab.beam * slab.sinh) / slab.sigma  # ∫ sinh(κz)/κ e^(-σz)
        own = slab.source * (cosh + near_side / slab.flux * sinh)
        response = (beam * own + slab.decay * response) / near
        beam = beam * slab.beam
        near_side = admittance
    return bottom / (bottom + near_side) * response


def _flat(table: LayerTable) -> list[tuple[Tensor, Tensor, Tensor, float]]:
    """σa, σs', thickness (N,) and eta of each layer."""
    reduced = table.sigma_s * (1 - table.g)
    return [
        (
            table.sigma_a[..., k, :].reshape(-1),
            reduced[..., k, :].reshape(-1),
            table.thickness[..., k, :].reshape(-1),
            eta,
        )
        for k, eta in enumerate(table.eta)
    ]


def _half_space(sigma_a, sigma_s_prime, _, eta, s, cosine) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    sigma = (sigma_a + sigma_s_prime).clamp_min(_CLEAR)
    D = (2 - sigma_s_prime / sigma) / (3 * sigma)
    kappa = torch.sqrt(sigma_a / D + s[:, None] ** 2 + _TINY)
    return sigma / cosine, sigma_s_prime / cosine, D * eta**2, kappa


def _slab(sigma_a, sigma_s_prime, d, eta, s, cosine) -> _Slab:
    sigma, source, flux, kappa = _half_space(sigma_a, sigma_s_prime, d, eta, s, cosine)
    decay = torch.exp(-kappa * d)
    return _Slab(
        sigma=sigma,
        source=source,
        d=d,
        beam=torch.exp(-sigma * d),
        flux=flux,
        kappa=kappa,
        decay=decay,
        cosh=(1 + decay**2) / 2,
        sinh=d * relexp(kappa * d) * (1 + decay) / 2,
    )
