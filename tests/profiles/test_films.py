"""Films above other layers: absent ones, and clear ones."""

import numpy as np
import pytest
import torch
from profile_stacks import stack_of
from reference.stacks import S as MC_S
from reference.stacks import read_stacks

from texsss.media.medium import Medium
from texsss.media.stack import Layer, Stack
from texsss.profiles.hankel import hankel_profiles

S = torch.tensor([0.0, 0.05, 0.3, 1.0, 4.0, 20.0], dtype=torch.float64)


@pytest.mark.parametrize("film", [1.2, 1.4, 1.6])
@pytest.mark.parametrize("base", [1.2, 1.4, 1.6])
def test_absent_layers_of_another_index_leave_light_to_what_lies_beneath(film, base):
    """Nothing jumps at thickness 0, and but for the beam's refraction R is that of an endless base alone.

    Measured .050 (1.6 on 1.2); over slabs of .2 mm up to .24 (1.5 on 1). The Monte Carlo, in
    which such a film keeps its two faces, is within .04 of the model for all of these.
    """
    below = Layer(Medium(0.1, 1.0, 0.0, base))
    bare, absent, thin = (
        hankel_profiles(Stack(layers), S)[0]
        for layers in (
            [below],
            [Layer(Medium(0.3, 1.0, 0.0, film), 0.0), below],
            [Layer(Medium(0.3, 1.0, 0.0, film), 1e-6), below],
        )
    )
    torch.testing.assert_close(absent, thin, rtol=1e-5, atol=0)
    assert abs(float(absent[0] / bare[0]) - 1) < 0.055


def test_clear_films_keep_light_where_it_is():
    """A film of .05 mm over skin that neither scatters nor absorbs, against the Monte Carlo at s to .3/mm.

    Measured .7 % of R̂(0); 80 % where its diffusion coefficient had no limit.
    """
    known = read_stacks("normal")["clear .05 mm on skin1 red"]
    near = MC_S < 0.3
    R, _ = hankel_profiles(stack_of(known.layers), torch.as_tensor(MC_S[near]), incidence="normal")
    truth = known.hankel["R"].mean
    np.testing.assert_allclose(R[:, 0], truth[near], rtol=0, atol=0.012 * truth[0])
