"""Error of sums of Gaussians on the texture's ladder, by material and object, in the metric of d'Eon et al.

python -m benchmarks.bench_profiles [--terms 8] [--model layered-sp3]
"""

import argparse
import math

import torch

from texsss.media.medium import Medium
from texsss.media.presets import preset
from texsss.media.stack import Layer, Stack
from texsss.numerics.quadrature import graded
from texsss.profiles.gaussians import GaussianSum
from texsss.profiles.hankel import hankel_profiles
from texsss.profiles.project import frequencies, project, radial_error, variance_ladder
from texsss.profiles.radial import RadialProfile

PRESETS = "skin1", "marble", "apple", "wholemilk", "ketchup", "potato", "chicken1"
PAIRS = {
    "bright on dark": (Medium(0.01, 1.0, 0.0, 1.4), Medium(0.3, 1.5, 0.0, 1.4)),
    "skin1 on marble": (preset("skin1"), preset("marble")),
    "skin1 on potato": (preset("skin1"), preset("potato")),
    "wholemilk on skin2": (preset("wholemilk"), preset("skin2")),
}
TOPS = torch.logspace(math.log10(0.05), math.log10(8), 12, dtype=torch.float64)[None]  # mm
EXTENTS = 20, 50, 100, 240, 1000  # mm
TEXELS = 400, 800  # per extent: of maps of about 512² and 1024²
ZERO = torch.zeros(1, dtype=torch.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--terms", type=int, default=8)
    parser.add_argument("--model", default="layered-sp3")
    arguments = parser.parse_args()
    print(
        f"worst error of {arguments.terms} terms [%], {arguments.model}, texels of "
        f"{' / '.join(f'1/{count}' for count in TEXELS)} of the extent; tops of .05 to 8 mm\n"
    )
    print("| | 99 % within | " + " | ".join(f"{extent} mm" for extent in EXTENTS) + " |")
    print("|---|---|" + "---|" * len(EXTENTS))
    stacks = {name: Stack(preset(name)) for name in PRESETS}
    stacks |= {name: Stack([Layer(top, TOPS), Layer(base)]) for name, (top, base) in PAIRS.items()}
    for name, stack in stacks.items():
        far = "" if stack.varies else f"{float(RadialProfile(stack).radius().max()):.0f} mm"
        cells = [
            " / ".join(
                f"{error(stack, extent / count, extent, arguments.terms, arguments.model):.2f}"
                for count in TEXELS
            )
            for extent in EXTENTS
        ]
        print(f"| {name} | {far} | " + " | ".join(cells) + " |", flush=True)


def error(stack: Stack, texel_mm: float, extent_mm: float, terms: int, model: str) -> float:
    """√∫ r (R - fit)² dr / √∫ r R² dr [%] up to the texel's Nyquist frequency, of the worst row."""
    ladder = variance_ladder(texel_mm, extent_mm, terms)
    (s, _), (dense, ds) = frequencies(ladder), graded(300, math.pi / texel_mm, 6.0)
    R = hankel_profiles(stack, torch.cat([s, dense, ZERO]), model=model)[0]
    met, truth, total = R.split([len(s), len(dense), 1], -2)
    fitted = GaussianSum(ladder, project(met, total[..., 0, :], ladder))
    return float(radial_error(fitted, truth, dense, ds).max()) * 100


if __name__ == "__main__":
    main()
