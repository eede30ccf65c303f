// R̂ or T̂ of layered_diffusion.py for one block of columns; names are the same.

#pragma once

#include "lights.h"

struct Diffusion {
  struct Diffusive {
    bool endless;
    V rate, d2, into, tau, beam, down, up;
  };
  std::vector<Diffusive> layers;
  V out;
  bool mirrored;

  // `ends`: admittances of the near and the far face
  void prepare(const Layers& given, const Lights& lights, bool endless, const double* ends) {
    const int L = int(given.size());
    layers.resize(L), mirrored = !endless;
    V below = all(float(ends[1]));
    for (int k = L - 1; k >= 0; k--) {
      const Layer& layer = given[k];
      const Light& light = lights[k];
      Diffusive& here = layers[k];
      V D = (2 - layer.sigma_s / layer.sigma) / (3 * layer.sigma);
      V rate = layer.sigma_a / D + TINY, flux = D * float(layer.eta * layer.eta);
      here.endless = endless && k == L - 1;
      if (here.endless) {
        here.rate = rate, here.tau = light.sigma, here.down = light.source * light.down;
        below = flux;
        continue;
      }
      V d = layer.d + 1e-15f;
      here.d2 = d * d, here.rate = rate * here.d2 + 1e-30f, here.into = below * d / flux;
      here.tau = light.tau, here.beam = light.beam;
      here.down = light.source * layer.d * light.down, here.up = light.source * layer.d * light.up;
      below = flux / d;
    }
    out = below / float(ends[0]);
  }

  V at(float s) const {
    const float s2 = s * s;
    V response = {}, admittance = all(1), whole = all(1);  // the first two over the third
    for (int k = int(layers.size()) - 1; k >= 0; k--) {
      const Diffusive& here = layers[k];
      if (here.endless) {
        admittance = root(here.rate + s2);
        response = here.down * inverse(here.tau + admittance);
        continue;
      }
      V part = inverse(whole), Gd = here.into * admittance * part;
      Crossing mode = crossing(here.rate + s2 * here.d2);
      Lit light = lit(mode, &here.tau, &here.beam, &here.down, &here.up, 1, mirrored);
      whole = mode.c + Gd;
      response = light.near * whole + mode.k * (light.far + response * part);
      admittance = mode.squared + Gd * mode.c;
    }
    return response * inverse(whole + admittance * out);
  }
};
