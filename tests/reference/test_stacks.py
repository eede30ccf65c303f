"""stacks.json against what made it, and against adding-doubling, which shares nothing with it."""

import numpy as np
import pytest

from reference import adding
from reference.montecarlo import Estimate
from reference.stacks import STACKS, S, measure, read_stacks

NORMAL, DIFFUSE = read_stacks("normal"), read_stacks("diffuse")
SUMMABLE = [
    name for name, layers in STACKS.items() if len({layer.eta for layer in layers}) == 1
]  # adding-doubling knows one eta


def test_the_table_covers_what_it_must():
    layers = [layer for stack in STACKS.values() for layer in stack]
    assert list(NORMAL) == list(DIFFUSE) == list(STACKS)
    assert len(STACKS) >= 30
    assert {len(stack) for stack in STACKS.values()} == {1, 2, 3, 4}
    assert {layer.eta for layer in layers} >= {1.0, 1.6}
    thicknesses = [layer.thickness for layer in layers if np.isfinite(layer.thickness)]
    assert (min(x for x in thicknesses if x), max(thicknesses)) == (0.05, 8.0)


@pytest.mark.parametrize("incidence", ["normal", "diffuse"])
@pytest.mark.parametrize(
    "name", ["half-space .9, eta 1.33", "bright .05 mm on dark, eta 1.4", "eta 1.3 over 1.5"]
)
def test_few_photons_find_the_same_again(name, incidence):
    """Other seeds, fewer photons, within 4 of their error bars."""
    known = read_stacks(incidence)[name]
    again = measure(STACKS[name], incidence, photons=15_000, seed=1000)
    for key, pair in again["totals"].items():
        estimate, truth = Estimate(*np.array(pair)), known.totals[key]
        both = Estimate(estimate.mean, np.hypot(estimate.error, truth.error))
        assert both.agrees_with(truth.mean, slack=1e-4), (key, pair)
    if incidence == "normal":
        few = Estimate(*np.array(again["hankel"]["R"]))
        assert few.agrees_with(known.hankel["R"].mean, slack=1e-4)


@pytest.mark.parametrize("name", SUMMABLE)
def test_adding_doubling_finds_every_total(name):
    """Reflected and transmitted, ballistic light included, normal and diffuse: 4 error bars and 1e-4."""
    truth = adding.totals(STACKS[name])
    for known, suffix in ((NORMAL[name], ""), (DIFFUSE[name], "_diffuse")):
        for side in ("R", "T"):
            scattered, unscattered = known.totals[side], known.totals[side + "_ballistic"]
            whole = Estimate(scattered.mean + unscattered.mean, np.hypot(scattered.error, unscattered.error))
            assert whole.agrees_with(getattr(truth, side + suffix), slack=1e-4), (side, suffix)


def test_hankel_columns_begin_with_the_totals():
    for name, known in NORMAL.items():
        for key, column in known.hankel.items():
            assert column.mean.shape == S.shape
            # both are rounded
            np.testing.assert_allclose(column.mean[0], known.totals[key].mean, rtol=1e-3, err_msg=name)
