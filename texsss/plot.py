"""A profile drawn: R(r) per channel on a logarithmic axis, with the lengths that matter."""

from pathlib import Path

CHANNELS = (("R", "#d1495b"), ("G", "#3a9d5d"), ("B", "#2f6fb0"))


def plot_curve(found: dict, path: Path, *, title: str) -> None:
    """Draws the result of `texsss.curve` into a PNG or SVG file.

    Radii in mm, R(r) in 1/mm²; a tick below the curves marks where 99 % of the light has come back.
    """
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(7.2, 4.5), dpi=144, layout="constrained")
    axes = figure.add_subplot()
    channels = list(zip(*found["reflectance_per_mm2"]))
    for k, values in enumerate(channels):
        name, colour = CHANNELS[k] if len(channels) == 3 else ("grey", "#444444")
        radius = found["radius_mm"]["0.99"][k]
        positive = [value if value > 0 else float("nan") for value in values]
        label = f"{name}: total {found['total'][k]:.3f}, 99 % within {radius:.3g} mm"
        axes.semilogy(found["r_mm"], positive, color=colour, linewidth=2, label=label)
        axes.axvline(radius, ymax=0.04, color=colour, linewidth=2)
    axes.set_title(title, parse_math=False)
    axes.set(xlabel="distance along the surface r [mm]", ylabel="R(r) [1/mm²]")
    axes.set_xlim(0, max(found["r_mm"]))
    axes.set_ylim(bottom=1e-6 * max(max(values) for values in channels))  # Gaussians say nothing below
    axes.grid(True, which="major", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path)
