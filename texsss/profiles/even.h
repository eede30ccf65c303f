// Light scattered more than once in thin slabs, even.py, for one block of columns; names are the same.

#pragma once

#include "once.h"

constexpr float REACH = 0.45f, LEFT = 1e-6f;

// arctan x / x for x > 0: a quarter of the angle, twice halved, by its series
static inline V angle_per_tangent(V x) {
  V first = inverse(1 + root(1 + x * x)), y = x * first, second = inverse(1 + root(1 + y * y)), z = y * second, q = z * z;
  V series = 1 - q * (1 / 3.f - q * (1 / 5.f - q * (1 / 7.f - q * (1 / 9.f - q * (1 / 11.f - q * (1 / 13.f))))));
  return 4 * first * second * series;
}

struct Even {
  const std::vector<Exit>* exits;
  V rest, strength, albedo, sigma, squared, d;

  // Whether there is any such light: two faces that mirror totally, and one index
  static bool holds(bool endless, const std::vector<double>& etas) {
    bool alike = etas[0] > 1;
    for (double eta : etas) alike = alike && eta == etas[0];
    return alike && !endless;
  }

  void prepare(const Layers& layers, const std::vector<Direction>& finer, const std::vector<Exit>& out) {
    const double eta = layers[0].index.eta, mirrored = std::sqrt(1 - 1 / (eta * eta));
    exits = &out;
    V tau = {}, scattered = {};
    d = V{};
    for (const Layer& layer : layers) {
      V depth = layer.d + 1e-15f;
      d += depth, tau += layer.sigma * depth, scattered += layer.sigma_s * depth;
    }
    albedo = scattered * inverse(tau), sigma = tau * inverse(d), squared = sigma * sigma;
    V x = tau * float((1 - mirrored) / (REACH * mirrored));
    Decayed fade = decayed(lesser(x * root(x), all(FAR)));
    rest = fade.gone, strength = extinguished(layers, false, finer) * albedo * albedo * fade.left;
  }

  V at(float s) const {
    s = s > 1e-12f ? s : 1e-12f;
    V again = angle_per_tangent(s * inverse(sigma)), out = {};
    for (const Exit& exit : *exits) {
      const Way& way = exit.near[0];
      V per = inverse_root(squared + s * s * (1 - way.cosine * way.cosine));
      V m = (squared + s * s * (1 - way.cosine * way.cosine)) * per * d * way.slant;
      V less = decayed(lesser(m, all(FAR))).gone;
      V leaves = less * (2 * exit.weight) * inverse(m * (1 - exit.mirrored + exit.mirrored * less));
      again -= leaves * sigma * per, out += leaves;
    }
    return strength * again * (out * 0.5f) * inverse(greater(1 - albedo * again, all(LEFT)));
  }
};
