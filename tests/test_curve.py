"""`texsss profile`: curves drawn and listed."""

import json

import numpy as np
from PIL import Image


def test_profile_draws_and_lists(texsss, tmp_path):
    done = texsss("profile", "marble", "--plot", "curve.png", "--against", "multipole", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert all(0 < total < 1 for total in found["total"])
    with Image.open(tmp_path / "curve.png") as plot:
        assert np.asarray(plot).std() > 10


def test_profiles_are_drawn_with_their_lengths(texsss, tmp_path):
    """As comments of an SVG, which has texts as outlines."""
    found = json.loads(texsss("profile", "spectralon", "--plot", "curve.svg", "--json").stdout)
    drawn = (tmp_path / "curve.svg").read_text()
    assert "<!-- distance along the surface r [mm] -->" in drawn and "R(r) [1/mm²]" in drawn
    for total, within, free in zip(found["total"], found["radius_mm"]["0.99"], found["mean_free_path_mm"]):
        assert f"total {total:.3f}, 99 % within {within:.3g} mm," in drawn
        assert f"<!-- mean free path {free:.3g} mm, diffusion length without end -->" in drawn


def test_another_model_is_shown_and_named(texsss, tmp_path):
    """Far beyond its radius ketchup's blue is rounding, which is not drawn: the axis ends above."""
    done = texsss("profile", "ketchup", "--model", "dipole", "--plot", "curve.svg")
    assert done.returncode == 0, done.stderr
    assert "radius_of_99%_mm" in done.stdout
    drawn = (tmp_path / "curve.svg").read_text()
    assert "<!-- ketchup, dipole -->" in drawn
    assert "10^{-6}" in drawn and "10^{-10}" not in drawn
    done = texsss("profile", "ketchup", "--model", "dipol")
    assert done.returncode == 2 and "'better-dipole'" in done.stderr
