// Layers of one block of columns, and the collimated light in them: slab.py as a loop; names are the same.

#pragma once

#include <vector>

#include "lanes.h"

constexpr int BEAMS = 4;  // directions of incident light, at most
constexpr float FAR = 40, CLEAR = 1e-6f, TINY = 1e-24f;

struct Layer {
  V sigma_a, sigma_s, sigma, g, d;
  double eta;
};
typedef std::vector<Layer> Layers;  // a half-space has d = ∞

struct Direction {
  double cosine, share, top, bottom;  // what the faces mirror of it
};

struct Light {
  V sigma, tau, source, beam, down, up;
  double cosine, share;
};
typedef std::vector<Light> Lights;  // layer by layer, direction by direction

static inline double refracted(double cosine, double here, double there) {
  double squared = 1 - (1 - cosine * cosine) * (here / there) * (here / there);
  return squared > 0 ? std::sqrt(squared) : 0;
}
static inline V root(V x) { return x * inverse_root(x); }
static inline V faded(V x) { return decay(lesser(x, all(FAR))); }

// The collimated light in every layer
static void light_in(const Layers& layers, bool endless, const Direction* directions, int count, Lights& lights) {
  const int L = int(layers.size()), last = L - 1;
  lights.resize(size_t(L) * count);
  for (int j = 0; j < count; j++) {
    const Direction& from = directions[j];
    V above = {}, below = {};
    for (int k = 0; k < L; k++) {
      const Layer& layer = layers[k];
      Light& light = lights[k * count + j];
      light.cosine = refracted(from.cosine, layers[0].eta, layer.eta), light.share = from.share;
      light.sigma = layer.sigma * float(1 / light.cosine);
      light.source = layer.sigma_s * float(from.share / light.cosine);
      light.down = faded(above), light.up = V{};
      light.tau = light.beam = V{};
      if (endless && k == last) continue;
      light.tau = light.sigma * layer.d;
      light.beam = faded(light.tau);
      above += light.tau;
    }
    if (endless) continue;
    V through = faded(above), gain = 1 / (1 - float(from.top * from.bottom) * through * through);
    for (int k = last; k >= 0; k--) {
      Light& light = lights[k * count + j];
      light.up = gain * float(from.bottom) * through * faded(below);
      below += light.tau;
      light.down *= gain;
    }
  }
}

// Shares of the light that leave unscattered by both faces
static V ballistic(const Lights& lights, bool endless, const Direction* directions, int count) {
  V total = {};
  if (endless) return total;
  for (int j = 0; j < count; j++) {
    const Light &first = lights[j], &last = lights[lights.size() - count + j];
    total += float(directions[j].share * (1 - directions[j].top)) * first.up * first.beam;
    total += float(directions[j].share * (1 - directions[j].bottom)) * last.down * last.beam;
  }
  return total;
}

// The same stack seen from below
static void turned(const Layers& layers, const Lights& lights, int count, Layers& layers_out, Lights& lights_out) {
  layers_out.assign(layers.rbegin(), layers.rend());
  lights_out.resize(lights.size());
  const int L = int(layers.size());
  for (int k = 0; k < L; k++)
    for (int j = 0; j < count; j++) {
      Light light = lights[(L - 1 - k) * count + j];
      V down = light.down;
      light.down = light.up, light.up = down;
      lights_out[k * count + j] = light;
    }
}

// One mode in a layer, by its (λd)²: modes.py
struct Crossing {
  V squared, decay, m, c, k;
};
static inline Crossing crossing(V squared) {
  V m = root(squared);
  Decayed e = decayed(lesser(m, all(FAR)));
  V part = m * inverse(e.gone * (1 + e.left));
  return {squared, e.left, m, part * (1 + e.left * e.left), 2 * part * e.left};
}

// (e^-λd - e^-σd) / apart, apart = (σ - λ) d; a series where that cancels
static inline V overlap(V decay, V beam, V apart) {
  I small = (apart < 0.3f) & (apart > -0.3f);
  V series = beam * (1 + apart * (1 / 2.f + apart * (1 / 6.f + apart * (1 / 24.f + apart * (1 / 120.f)))));
  return small ? series : (decay - beam) * inverse(small ? all(1) : apart);
}

struct Lit {
  V near, far;
};
// ∫ P and ∫ Q of a mode over a layer, with `down` and `up` scattered light of every direction in it
static inline Lit lit(const Crossing& mode, const V* tau, const V* beam, const V* down, const V* up, int count,
                      bool mirrored) {
  V near = {}, far = {};
  for (int j = 0; j < count; j++) {
    V q = overlap(mode.decay, beam[j], tau[j] - mode.m);
    V p = (1 - mode.k * q) * inverse(mode.m + tau[j]);
    near += down[j] * p;
    if (mirrored) {
      q -= mode.decay * p;
      near += up[j] * q;
      far += down[j] * q + up[j] * p;
    } else {
      far += down[j] * q;
    }
  }
  return {near, mirrored ? far : far - mode.decay * near};
}
