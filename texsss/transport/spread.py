"""Symmetric kernels between the texels of one row or column, each texel with its own width."""

import math
from typing import Any

import torch

from texsss.types import Float, Tensor, chunks

REACH = 3.7  # kernels end at this many standard deviations; their variance is right all the same
BLOCK = 1 << 16  # texels worked on at once: what stays in a core's cache
FADED = 30.0  # exp(-FADED)² is nothing beside 1 and still far above float32's denormal numbers


def spread(
    image: Float[Tensor, "C h w"], beta: Float[Tensor, "h w"], reach: int, axis: int
) -> Float[Tensor, "C h w"]:
    """Σ_y exp(-(x - y)² (β_x + β_y)/2) image_y over the texels y of the row or column (`axis`) of x.

    Sums end `reach` texels away, or sooner where every width is small. The kernel is symmetric, so this
    function is its own adjoint. Differentiable in `image`.
    """
    return _Spread.apply(image, beta, reach, axis)  # pyright: ignore[reportReturnType]


class _Spread(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, beta: Tensor, reach: int, axis: int) -> Tensor:
        ctx.save_for_backward(beta)
        ctx.reach, ctx.axis = reach, axis
        return _summed(image, beta, reach, axis)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None, None]:
        (beta,) = ctx.saved_tensors
        return spread(grads[0], beta, ctx.reach, ctx.axis), None, None, None


def _summed(image: Tensor, beta: Tensor, reach: int, axis: int) -> Tensor:
    length, across = beta.shape[axis], beta.shape[1 - axis]
    result = torch.empty_like(image, memory_format=torch.contiguous_format)
    for block in chunks(across, max(1, BLOCK // length)):
        source = image.narrow(2 - axis, block.start, block.stop - block.start).contiguous()
        half = beta.narrow(1 - axis, block.start, block.stop - block.start).contiguous() / 2
        total = source.clone()
        widest = float(half.amin().rsqrt()) / 2  # standard deviation in this block [texels]
        for offset in range(1, min(reach, math.ceil(REACH * widest), length - 1) + 1):
            # exp(-i² (β_x + β_y)/2) is a factor of the source times a factor of the target
            factor = (half * -(offset**2)).clamp_(min=-FADED).exp_()
            sent = source * factor
            near, far = (slice(None, length - offset), slice(offset, None))
            if axis == 1:
                total[:, :, near].addcmul_(sent[:, :, far], factor[:, near])
                total[:, :, far].addcmul_(sent[:, :, near], factor[:, far])
            else:
                total[:, near].addcmul_(sent[:, far], factor[near])
                total[:, far].addcmul_(sent[:, near], factor[far])
        result.narrow(2 - axis, block.start, block.stop - block.start).copy_(total)
    return result


def sharpness(variance: Float[Tensor, "h w"], reach: int) -> Float[Tensor, "h w"]:
    """β such that exp(-β i²) over the integers |i| ≤ `reach`, scaled to sum 1, has `variance` [texels²].

    The truncated, sampled kernel has the variance asked for, be it a fraction of a texel² or close to
    that of a box, so that variances add exactly.
    """
    steps = torch.arange(1, reach + 1, dtype=torch.float64) ** 2
    beta = torch.logspace(1.8, -5, 4096, dtype=torch.float64)  # falling, so that variances rise
    weight = torch.exp(-beta[:, None] * steps)
    reached = 2 * (weight * steps).sum(1) / (1 + 2 * weight.sum(1))
    # tabulated over the standard deviation, in even steps fine enough to take the nearest
    deviation = variance.sqrt()
    entries = 1 << 14
    top = min(float(deviation.max()), float(reached[-1].sqrt()))
    wanted = torch.linspace(0, top, entries, dtype=torch.float64) ** 2
    above = torch.searchsorted(reached, wanted).clamp(1, len(reached) - 1)
    low, high = reached[above - 1], reached[above]
    fraction = ((wanted - low) / (high - low)).clamp(0, 1)
    table = torch.lerp(beta[above - 1].log(), beta[above].log(), fraction).exp().to(variance)
    place = (deviation * ((entries - 1) / top)).round_().clamp_(max=entries - 1).to(torch.int32)
    return table.index_select(0, place.reshape(-1)).reshape(variance.shape)
