// R̂ or T̂ of layered_diffusion.py for one block of columns; names are the same.

#pragma once

#include "lights.h"

struct Diffusion {
  struct Diffusive {
    bool endless;
    V rate, d2, into, tau[BEAMS], beam[BEAMS], down[BEAMS], up[BEAMS];
  };
  std::vector<Diffusive> layers;
  V out;
  bool mirrored;

  void prepare(const Layers& given, const Lights& lights, bool endless) {
    const int L = int(given.size());
    layers.resize(L), mirrored = !endless;
    V below = all(float(given[L - 1].index.outlet));
    for (int k = L - 1; k >= 0; k--) {
      const Layer& layer = given[k];
      Diffusive& here = layers[k];
      V per = inverse(layer.sigma), D = (2 - layer.sigma_s * per) * per * (1 / 3.f);
      V rate = layer.sigma_a * inverse(D) + TINY, flux = D * float(layer.index.eta * layer.index.eta);
      here.endless = endless && k == L - 1;
      for (int j = 0; j < BEAMS; j++) {
        const Light& light = lights[k * BEAMS + j];
        V strength = here.endless ? light.source : light.source * layer.d;
        here.tau[j] = here.endless ? light.sigma : light.tau, here.beam[j] = light.beam;
        here.down[j] = strength * light.down, here.up[j] = strength * light.up;
      }
      if (here.endless) {
        here.rate = rate, below = flux;
        continue;
      }
      V d = layer.d + 1e-15f;
      here.d2 = d * d, here.rate = rate * here.d2 + 1e-30f, here.into = below * d * inverse(flux);
      below = flux / d;
    }
    out = below / float(given[0].index.outlet);
  }

  // Of N frequencies, step by step side by side: what one waits for another computes
  template <int N>
  void at(const float* s, V* result) const {
    V response[N], admittance[N], whole[N];  // the first two over the third
    for (int i = 0; i < N; i++) response[i] = V{}, admittance[i] = whole[i] = all(1);
    for (int k = int(layers.size()) - 1; k >= 0; k--) {
      const Diffusive& here = layers[k];
      if (here.endless) {
        for (int i = 0; i < N; i++) admittance[i] = root(here.rate + s[i] * s[i]);
        for (int j = 0; j < BEAMS; j++)
          for (int i = 0; i < N; i++) response[i] += here.down[j] * inverse(here.tau[j] + admittance[i]);
        continue;
      }
      Crossing mode[N];
      Lit light[N];
      for (int i = 0; i < N; i++) mode[i] = crossing(here.rate + s[i] * s[i] * here.d2);
      for (int i = 0; i < N; i++) light[i] = lit(mode[i], here.tau, here.beam, here.down, here.up, mirrored);
      for (int i = 0; i < N; i++) {
        V part = inverse(whole[i]), Gd = here.into * admittance[i] * part;
        whole[i] = mode[i].c + Gd;
        response[i] = light[i].near * whole[i] + mode[i].k * (light[i].far + response[i] * part);
        admittance[i] = mode[i].squared + Gd * mode[i].c;
      }
    }
    for (int i = 0; i < N; i++) result[i] = response[i] * inverse(whole[i] + admittance[i] * out);
  }
};
