// Layers of one block of columns, and the collimated light in them: slab.py as a loop; names are the same.

#pragma once

#include <vector>

#include "lanes.h"

constexpr int BEAMS = DIRECTIONS;  // of incident light: the one macro that the build sets
constexpr float FAR = 40, CLEAR = 1e-6f, TINY = 1e-24f, FLAT = 2.422e-5f;

struct Layer {
  V sigma_a, sigma_s, sigma, g, d;
  double eta;
};
typedef std::vector<Layer> Layers;  // a half-space has d = ∞

struct Direction {
  float share, top, bottom;  // of the light that enters, and what the faces mirror of it
  std::vector<float> cosines;  // layer by layer
};

struct Light {
  V sigma, tau, source, beam, down, up;
  float cosine, share;
};
typedef std::vector<Light> Lights;  // layer by layer, direction by direction

static inline V root(V x) { return x * inverse_root(x); }
static inline V faded(V x) { return decay(lesser(x, all(FAR))); }

// The collimated light in every layer
static void light_in(const Layers& layers, bool endless, const Direction* directions, Lights& lights) {
  const int L = int(layers.size()), last = L - 1;
  lights.resize(size_t(L) * BEAMS);
  for (int j = 0; j < BEAMS; j++) {
    const Direction& from = directions[j];
    V above = {}, below = {};
    for (int k = 0; k < L; k++) {
      const Layer& layer = layers[k];
      Light& light = lights[k * BEAMS + j];
      light.cosine = from.cosines[k], light.share = from.share;
      const float slant = 1 / light.cosine;
      light.sigma = layer.sigma * slant;
      light.source = layer.sigma_s * (from.share * slant);
      light.down = faded(above), light.up = V{};
      light.tau = light.beam = V{};
      if (endless && k == last) continue;
      light.tau = light.sigma * layer.d;
      light.beam = faded(light.tau);
      above += light.tau;
    }
    if (endless) continue;
    V through = faded(above), gain = inverse(1 - from.top * from.bottom * through * through);
    for (int k = last; k >= 0; k--) {
      Light& light = lights[k * BEAMS + j];
      light.up = gain * from.bottom * through * faded(below);
      below += light.tau;
      light.down *= gain;
    }
  }
}

// Shares of the light that leave unscattered by both faces
static V ballistic(const Lights& lights, bool endless, const Direction* directions) {
  V total = {};
  if (endless) return total;
  for (int j = 0; j < BEAMS; j++) {
    const Light &first = lights[j], &last = lights[lights.size() - BEAMS + j];
    total += directions[j].share * (1 - directions[j].top) * first.up * first.beam;
    total += directions[j].share * (1 - directions[j].bottom) * last.down * last.beam;
  }
  return total;
}

// The same stack seen from below
static void turned(const Layers& layers, const Lights& lights, Layers& layers_out, Lights& lights_out) {
  layers_out.assign(layers.rbegin(), layers.rend());
  lights_out.resize(lights.size());
  const int L = int(layers.size());
  for (int k = 0; k < L; k++)
    for (int j = 0; j < BEAMS; j++) {
      Light light = lights[(L - 1 - k) * BEAMS + j];
      V down = light.down;
      light.down = light.up, light.up = down;
      lights_out[k * BEAMS + j] = light;
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

// (e^-λd - e^-σd) / apart, apart = (σ - λ) d, blended into its limit where that cancels
static inline V overlap(V decay, V beam, V apart) {
  return (apart * (decay - beam) + FLAT * beam * (1 + 0.5f * apart)) * inverse(FLAT + apart * apart);
}

struct Lit {
  V near, far;
};
// ∫ P and ∫ Q of a mode over a layer, with `down` and `up` scattered light of every direction in it
static inline Lit lit(const Crossing& mode, const V* tau, const V* beam, const V* down, const V* up, bool mirrored) {
  V near = {}, far = {};
  for (int j = 0; j < BEAMS; j++) {
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
