"""What black and white stand for is said, kept in the file, and not set by a few specks."""

import re

import numpy as np
import pytest
import torch
from PIL import Image

from texsss.reading import UNITS, reading
from texsss.result import save_map
from texsss.specs import INTERMEDIATES


def test_a_few_specks_do_not_darken_all_others():
    values = torch.full((100, 100, 1), 0.5)
    values[0, :40] = 300.0  # .4 %
    found = reading("texel-mm", values)
    assert found.white == pytest.approx(0.5) and (found.least, found.greatest) == (0.5, 300.0)
    assert found.sentence == "black is 0 mm, white 0.5 mm; values from 0.5 to 300 mm"
    assert float(found.shown(values).amax()) == 1.0


def test_what_is_zero_nearly_everywhere_is_scaled_by_the_rest():
    values = torch.zeros(100, 100, 1)
    values[3, :50] = torch.linspace(0.01, 0.1, 50)[:, None]
    assert 0.09 < reading("seam-jump", values).white <= 0.1
    assert reading("seam-jump", 0 * values).white == 1.0


@pytest.mark.parametrize(
    ("name", "values", "ends"),
    [
        ("normal", [-0.3, 0.9], (-1, 1)),
        ("metric", [0.2, 0.6], (0, 1)),
        ("position", [-40.0, 70.0], (-40, 70)),
        ("weight-3", [-0.1, 0.4], (0, 0.4)),
    ],
)
def test_signs_and_shares_have_their_own_ends(name, values, ends):
    image = torch.tensor(values)[:, None, None].expand(-1, 1, 3)
    found = reading(name, image)
    assert (found.black, found.white) == pytest.approx(ends)
    assert bool(torch.isfinite(found.shown(image)).all())


def test_every_length_and_light_has_its_unit():
    kinds = set(re.findall(r"[a-z]+(?:-[a-z]+)*", INTERMEDIATES))
    assert kinds == set(UNITS) | {"coverage", "albedo", "metric", "normal", "weight"}
    for name in UNITS:
        asked = f"{name}-2" if name in ("gaussian", "thickness") else name
        assert re.fullmatch(INTERMEDIATES, asked) and reading(asked, torch.ones(1, 1, 1)).unit == UNITS[name]


def test_the_file_says_what_its_levels_are(tmp_path):
    values = torch.rand(20, 30, 1, generator=torch.Generator().manual_seed(5)) * 7
    said = save_map(tmp_path / "map.png", "through-mm", values)
    with Image.open(tmp_path / "map.png") as image:
        text, levels = image.text, np.asarray(image)[..., :1] / 255
    assert text["Description"] == said.sentence and text["unit"] == "mm"
    back = levels * (float(text["white"]) - float(text["black"])) + float(text["black"])
    assert np.abs(back - values.numpy().clip(max=said.white)).max() <= 0.5 / 255 * said.white + 1e-6
