// Light scattered more than once in thin slabs, even.py, for one block of columns; names are the same.

#pragma once

#include "once.h"

constexpr float REACH = 0.45f, UNLIKE = 40, LEFT = 1e-6f;

// arctan x / x for x > 0: a quarter of the angle, twice halved, by its series
static inline V angle_per_tangent(V x) {
  V first = inverse(1 + root(1 + x * x)), y = x * first, second = inverse(1 + root(1 + y * y)), z = y * second, q = z * z;
  V series = 1 - q * (1 / 3.f - q * (1 / 5.f - q * (1 / 7.f - q * (1 / 9.f - q * (1 / 11.f - q * (1 / 13.f))))));
  return 4 * first * second * series;
}

struct Even {
  const std::vector<Exit>* exits;
  V rest, strength, albedo, sigma, depth;
  bool thin;  // some column: in others there is none of it

  // Whether there is any such light: two faces that mirror totally, and one index
  static bool holds(bool endless, const std::vector<double>& etas) {
    bool alike = etas[0] > 1;
    for (double eta : etas) alike = alike && eta == etas[0];
    return alike && !endless;
  }

  void prepare(const Layers& layers, const std::vector<Direction>& finer, const std::vector<Exit>& out) {
    const double eta = layers[0].index.eta, mirrored = std::sqrt(1 - 1 / (eta * eta));
    exits = &out;
    V d = {}, scattered = {};
    depth = V{};
    for (const Layer& layer : layers) {
      V own = layer.d + 1e-15f;
      d += own, depth += layer.sigma * own, scattered += layer.sigma_s * own;
    }
    albedo = scattered * inverse(depth), sigma = depth * inverse(d);
    V x = depth * float((1 - mirrored) / (REACH * mirrored)), apart = {};
    for (const Layer& layer : layers) {
      V step = layer.sigma_s * inverse(layer.sigma) - albedo;
      apart += step * step * layer.sigma * (layer.d + 1e-15f);
    }
    Decayed fade = decayed(lesser(x * root(x) * (1 + UNLIKE * apart * inverse(depth)), all(FAR)));
    rest = fade.gone, strength = extinguished(layers, false, finer) * albedo * albedo * fade.left;
    thin = some(fade.left > 1e-9f);
  }

  V at(float s) const {
    s = s > 1e-12f ? s : 1e-12f;
    V x = s * inverse(sigma), again = angle_per_tangent(x), out = {};
    for (const Exit& exit : *exits) {
      const Way& way = exit.near[0];
      V squared = 1 + x * x * (1 - way.cosine * way.cosine), per = inverse_root(squared), m = squared * per * depth * way.slant;
      V less = decayed(lesser(m, all(FAR))).gone;
      V leaves = less * (2 * exit.weight) * inverse(m * (1 - exit.mirrored + exit.mirrored * less));
      again -= leaves * per, out += leaves;
    }
    return strength * again * (out * 0.5f) * inverse(greater(1 - albedo * again, all(LEFT)));
  }
};
