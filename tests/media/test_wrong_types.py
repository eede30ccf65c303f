"""What is no medium, layer, map or range is answered in one sentence, not by whatever fails first.

In a process of its own, where the annotations are not watched.
"""

import subprocess
import sys

CODE = """
import math
import torch
import texsss as tx
from texsss.profiles.radial import RadialProfile
from texsss.profiles.weights import weights_for

M, ladder = tx.preset("skin1"), torch.tensor([1.0, 4.0])
burley = tx.fit_burley(M)
image, unit = torch.full((2, 2, 4), 0.5), (0, 1)
wrong = [
    lambda: tx.Stack(None),
    lambda: tx.Stack([None]),
    lambda: tx.Stack("skin1"),
    lambda: tx.Stack(3),
    lambda: tx.Stack([M, M]),
    lambda: tx.Layer("skin1", 1.0),
    lambda: tx.Layer(None),
    lambda: tx.Layer(M, M),
    lambda: tx.Layer(M, torch.tensor(1j)),
    lambda: tx.Medium(1.0, 1.0, 0.0, "1.3"),
    lambda: tx.Medium(1.0, 1.0, 0.0, [1.3, 1.4]),
    lambda: tx.Medium([True, False, True], 1.0),
    lambda: tx.Medium(0.1, [[0.5, True]]),
    lambda: tx.Layer(M, [True]),
    lambda: RadialProfile(M, model="dipole").evaluate([1.0]),
    lambda: tx.preset(3),
    lambda: tx.mix("skin1", M, 0.5),
    lambda: tx.from_colour(0.5, 1.0, g=torch.tensor([0.1, 0.2])),
    lambda: tx.to_colour("red"),
    lambda: tx.stack_from_depths(image, [M], unit),
    lambda: tx.stack_from_depths([None], [M], unit),
    lambda: tx.stack_from_depths([image.numpy()], [M], unit),
    lambda: tx.stack_from_depths([image[..., 0]], [M], unit),
    lambda: tx.stack_from_depths([image[:0]], [M], unit),
    lambda: tx.stack_from_depths([image], M, unit),
    lambda: tx.stack_from_depths([image], ["skin1"], unit),
    lambda: tx.stack_from_depths([image], [M], None),
    lambda: tx.stack_from_depths([image], [M], (0, 1, 2)),
    lambda: tx.stack_from_depths([image], [M], unit, infinite=True),
    lambda: tx.depths_of("skin1", unit),
    lambda: tx.depths_of(tx.Stack([tx.Layer(M, 1.0)]), (0, math.inf)),
    lambda: weights_for("skin1", ladder),
    lambda: weights_for(M, [1.0, 4.0]),
    lambda: weights_for(M, ladder[None]),
    lambda: tx.hankel_profiles(None, torch.zeros(1)),
    lambda: tx.fit_burley("skin1"),
    lambda: tx.Medium(1.0, 1.0, 0.0, 10**400),
    lambda: tx.Medium(1.0, 1.0, 0.0, torch.tensor(1.3 + 0j)),
    lambda: tx.stack_from_depths([image + 0j], [M], unit),
    lambda: tx.stack_from_depths([1 - image.cumsum(-1) / 4], [M] * 4, unit),
    lambda: tx.save_depths("depths.png", "skin1"),
    lambda: tx.save_depths("depths.png", M),
    lambda: tx.save_depths("depths.png", image.numpy()),
    lambda: tx.save_depths("depths.png", image + 0j),
    lambda: tx.save_depths("depths.png", -image, unit),
    lambda: tx.save_depths("depths.png", image * math.nan, unit),
    lambda: tx.save_depths("depths.png", 1 - image.cumsum(-1) / 4),
    lambda: tx.hankel_profiles(M, torch.zeros(2, 2)),
    lambda: tx.hankel_profiles(M, torch.zeros(0)),
    lambda: tx.hankel_profiles(M, "x"),
    lambda: tx.hankel_profiles(M, torch.zeros(1) + 0j),
    lambda: tx.hankel_profiles(M, torch.zeros(1), incidence=None),
    lambda: tx.hankel_profiles(M, torch.zeros(1), incidence=[0.1]),
    lambda: tx.fit_gaussians(M, [1.0, 2.0]),
    lambda: tx.fit_gaussians(M, torch.tensor(1.0), terms=3),
    lambda: tx.fit_gaussians(M, ladder + 0j),
    lambda: tx.fit_gaussians(M, terms="8"),
    lambda: tx.fit_gaussians(M, terms=2.5),
    lambda: tx.fit_gaussians(M, drop_below_mfp="thin"),
    lambda: tx.fit_gaussians(M, fit="grid", drop_below_mfp=-1),
    lambda: tx.Medium(1.0, 1.0, 0.0, True),
    lambda: burley.evaluate([1.0]),
    lambda: burley.evaluate(torch.ones(1, 1)),
    lambda: burley.evaluate(torch.ones(1) + 0j),
    lambda: burley.hankel(1.0),
    lambda: burley.hankel("x"),
    lambda: burley.hankel(torch.zeros(1) + 0j),
    lambda: tx.human_skin().evaluate("x"),
    lambda: tx.human_skin().evaluate(torch.tensor([-1.0])),
]
for number, call in enumerate(wrong):
    try:
        print(number, "was taken:", call())
    except tx.TexsssError as error:
        said = str(error)
        if not ("expected" in said and "got" in said and said.endswith(".") and "\\n" not in said):
            print(number, said)
"""


def test_wrong_types_are_told_in_one_sentence():
    found = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert (found.stdout, found.stderr, found.returncode) == ("", "", 0)
