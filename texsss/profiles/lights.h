// Layers of one block of columns, and the collimated light in them: slab.py as a loop; names are the same.

#pragma once

#include <vector>

#include "lanes.h"

constexpr int BEAMS = DIRECTIONS;  // of incident light: the one macro that the build sets
constexpr float FAR = 40, DEEP = 1e5f, CLEAR = 1e-6f, TINY = 1e-24f, THIN = 0.5f;  // below THIN there are series

// What is the same in all columns of a layer: its index, and the admittance of a face of that
struct Index {
  double eta, outlet;
};
struct Layer {
  V sigma_a, sigma_s, sigma, g, d;
  Index index;
};
typedef std::vector<Layer> Layers;
static inline Layer layer_of(V sigma_a, V sigma_s, V g, V d, Index index) {
  V sigma = greater(sigma_a + sigma_s, all(CLEAR));
  return {sigma_a, sigma_s, sigma, g, lesser(d, DEEP * inverse(sigma)), index};
}

struct Direction {
  float share, top, bottom;  // of the light that enters, and what the faces mirror of it
  std::vector<float> cosines;  // layer by layer
};

struct Light {
  V sigma, tau, source, beam, down, up, share;
  float cosine;
};
typedef std::vector<Light> Lights;  // layer by layer, direction by direction

static inline V root(V x) { return x * inverse_root(x); }
static inline V faded(V x) { return decay(lesser(x, all(FAR))); }

// Share of the light that does not leave unscattered by either face
static V lost(const Layers& layers, const Direction* directions, size_t count) {
  V total = {};
  for (size_t j = 0; j < count; j++) {
    const Direction& from = directions[j];
    V tau = {};
    for (size_t k = 0; k < layers.size(); k++) tau += layers[k].sigma * layers[k].d * (1 / from.cosines[k]);
    Decayed e = decayed(lesser(tau, all(FAR)));
    V gain = inverse(1 - from.top * from.bottom * e.left * e.left);
    total += from.share * gain * e.gone * (1 + from.bottom * e.left);
  }
  return total;
}
static V extinguished(const Layers& layers, bool endless, const std::vector<Direction>& finer) {
  return endless ? all(1) : lost(layers, finer.data(), finer.size());
}

// The collimated light in every layer; `finer` directions of the same tell how much slabs take of it
static void light_in(const Layers& layers, bool endless, const Direction* directions, Lights& lights,
                     const std::vector<Direction>& finer = {}) {
  const int L = int(layers.size()), last = L - 1;
  lights.resize(size_t(L) * BEAMS);
  V more = all(1);
  if (!endless && finer.size() > BEAMS) {
    V found = lost(layers, directions, BEAMS);
    more = (extinguished(layers, false, finer) + 1e-15f) * inverse(found + 1e-15f);
  }
  for (int j = 0; j < BEAMS; j++) {
    const Direction& from = directions[j];
    V above = {}, below = {};
    for (int k = 0; k < L; k++) {
      const Layer& layer = layers[k];
      Light& light = lights[k * BEAMS + j];
      light.cosine = from.cosines[k], light.share = from.share * more;
      const float slant = 1 / light.cosine;
      light.sigma = layer.sigma * slant;
      light.source = layer.sigma_s * light.share * slant;
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
  V squared, decay, m, c, k, half, part;  // 1 / (1 + e^-m), and m / (1 - e^-2m)
};
static inline Crossing crossing(V squared) {
  V m = root(squared);
  Decayed e = decayed(lesser(m, all(FAR)));
  V half = inverse(1 + e.left), part = m * half * inverse(e.gone);
  return {squared, e.left, m, part * (1 + e.left * e.left), 2 * part * e.left, half, part};
}

// (e^-λd - e^-σd) / apart, apart = (σ - λ) d; a series where that cancels
static inline V overlap(V decay, V beam, V apart) {
  V x = apart * apart * 0.25f;
  V series = 1 - x * (1 / 3.f - x * (2 / 15.f - x * (17 / 315.f - x * (62 / 2835.f))));
  return x < THIN * THIN / 4 ? (decay + beam) * (0.5f * series) : (decay - beam) * inverse(apart);
}

// ∫ P of a mode with e^-τ over a layer, of which ∫ e^-τ e^-(m - ..) is q. Where it is thin, the difference
// of hyperbolic functions of ½ (τ + m) and ½ (τ - m) is a series.
static inline V nearer(const Crossing& mode, V tau, V q) {
  V sum = mode.m + tau, a = sum * sum * 0.25f, b = (tau - mode.m) * (tau - mode.m) * 0.25f;
  V series = 1 / 6.f + a * (1 / 120.f + a * (1 / 5040.f)) - b * (7 / 360.f + a * (1 / 840.f) - b * (31 / 15120.f));
  V thick = (1 - mode.k * q) * inverse(sum);
  return sum < THIN ? q * (mode.half + tau * mode.part * series) : thick;
}

struct Lit {
  V near, far;
};
// ∫ P and ∫ Q of a mode over a layer, with `down` and `up` scattered light of every direction in it
static inline Lit lit(const Crossing& mode, const V* tau, const V* beam, const V* down, const V* up, bool mirrored) {
  V near = {}, far = {};
  for (int j = 0; j < BEAMS; j++) {
    V q = overlap(mode.decay, beam[j], tau[j] - mode.m);
    V p = nearer(mode, tau[j], q);
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
