"""Error of sums of Gaussians on the texture's ladder, over thin and thick tops, in the metric of d'Eon et al.

python benchmarks/bench_profiles.py
"""

import math

import torch

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.numerics.quadrature import graded
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.project import frequencies, project, radial_error, variance_ladder

PAIRS = {
    "bright on dark, eta 1.4": (Medium(0.01, 1.0, 0.0, 1.4), Medium(0.3, 1.5, 0.0, 1.4)),
    "skin1 on white": (preset("skin1"), Medium(0.002, 2.0, 0.0, 1.3)),
    "milk on skin2": (preset("wholemilk"), preset("skin2")),
}


def main() -> None:
    thickness = torch.logspace(math.log10(0.05), math.log10(8), 40, dtype=torch.float64)[None]
    zero = torch.zeros(1, dtype=torch.float64)
    print("worst error over tops of .05 to 8 mm [%], 16 frequencies up to the texel's Nyquist")
    print(f"{'':26s}{'model':20s}{'texel / extent mm':20s}" + "".join(f"K = {k:<6d}" for k in (6, 8, 10)))
    for name, (top, bottom) in PAIRS.items():
        stack = Stack([Layer(top, thickness), Layer(bottom)])
        for model in ("layered-diffusion", "layered-sp3"):
            for texel, extent in ((0.1, 100.0), (0.2, 300.0), (0.6, 450.0)):
                dense, ds = graded(300, math.pi / texel, 6.0)
                truth, _ = hankel_profiles(stack, dense, model=model)
                errors = []
                for terms in (6, 8, 10):
                    ladder = variance_ladder(texel, extent, terms)
                    R, _ = hankel_profiles(stack, frequencies(ladder)[0], model=model)
                    total, _ = hankel_profiles(stack, zero, model=model)
                    fitted = GaussianSum(ladder, project(R, total[..., 0, :], ladder))
                    errors.append(float(radial_error(fitted, truth, dense, ds).max()) * 100)
                sizes = f"{texel:g} / {extent:g}"
                print(f"{name:26s}{model:20s}{sizes:20s}" + "".join(f"{e:<10.2f}" for e in errors))


if __name__ == "__main__":
    main()
