"""A profile drawn: R(r) per channel on a logarithmic axis, with the lengths that matter."""

from collections.abc import Sequence
from itertools import cycle
from math import pi
from pathlib import Path

CHANNELS = (("R", "#d1495b"), ("G", "#3a9d5d"), ("B", "#2f6fb0"))


STYLES = ("--", ":", "-.")
LEAST = 1e-4  # of a channel's light, spread evenly within the radius of its 99 %


def plot_curve(found: dict, path: Path, *, title: str, against: Sequence[dict] = ()) -> None:
    """Draws the result of `texsss.curve` into a PNG or SVG file.

    The title is followed by the model. Radii in mm, R(r) in 1/mm²; a tick below the curves marks where 99 %
    of the light has come back. Beside it the legend has mean free path and diffusion length of the outermost
    layer. Dots are what photons say, where they were asked; other models (`against`) are thin broken lines,
    and pale ones the sum of Gaussians.
    """
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(7.2, 4.5), dpi=144, layout="constrained")
    axes = figure.add_subplot()
    channels = list(zip(*found["reflectance_per_mm2"]))
    for k, values in enumerate(channels):
        name, colour = CHANNELS[k] if len(channels) == 3 else ("grey", "#444444")
        radius = found["radius_mm"]["0.99"][k]
        positive = [value if value > 0 else float("nan") for value in values]
        label = f"{name}: total {found['total'][k]:.3f}, 99 % within {radius:.3g} mm,\n{_lengths(found, k)}"
        axes.semilogy(found["r_mm"], positive, color=colour, linewidth=2, label=label)
        axes.axvline(radius, ymax=0.04, color=colour, linewidth=2)
        sums = [row[k] if row[k] > 0 else float("nan") for row in found["gaussians"]["reflectance_per_mm2"]]
        axes.semilogy(found["r_mm"], sums, color=colour, linewidth=1, alpha=0.5)
        rings = found["monte_carlo"][k] if k < len(found["monte_carlo"]) else None
        if rings is not None:
            axes.plot(rings["r_mm"], rings["reflectance_per_mm2"], "o", color=colour, markersize=3)
        for other, style in zip(against, cycle(STYLES)):
            values = [row[k] if row[k] > 0 else float("nan") for row in other["reflectance_per_mm2"]]
            axes.plot(other["r_mm"], values, style, color=colour, linewidth=1)
    terms = len(found["gaussians"]["variances_mm2"])
    axes.plot([], [], color="#444444", linewidth=1, alpha=0.5, label=f"sum of {terms} Gaussians")
    for other, style in zip(against, cycle(STYLES)):
        axes.plot([], [], style, color="#444444", linewidth=1, label=other["methods"]["profile"])
    if any(rings is not None for rings in found["monte_carlo"]):
        axes.plot([], [], "o", color="#444444", markersize=3, label="Monte Carlo")
    axes.set_title(f"{title}, {found['methods']['profile']}", parse_math=False)
    axes.set(xlabel="distance along the surface r [mm]", ylabel="R(r) [1/mm²]")
    axes.set_xlim(0, 1.01 * max(found["r_mm"]))  # the last tick is whole
    last = [values[-1] for values in channels if values[-1] > 0]
    # Gaussians fall below all that matters, and far beyond its radius a channel is rounding
    even = [x / (pi * r**2) for x, r in zip(found["total"], found["radius_mm"]["0.99"]) if x > 0]
    axes.set_ylim(bottom=max(0.3 * min(last), LEAST * min(even)) if last else None)
    axes.grid(True, which="major", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(edgecolor="none", framealpha=0.85, fontsize="small")
    figure.savefig(path)


def _lengths(found: dict, channel: int) -> str:
    """Mean free path and diffusion length of a channel, in words."""
    said = []
    for name in ("mean_free_path", "diffusion_length"):
        values = found[f"{name}_mm"]
        value = values[channel if len(values) > 1 else 0]
        said.append(f"{name.replace('_', ' ')} {'without end' if value is None else f'{value:.3g} mm'}")
    return ", ".join(said)
