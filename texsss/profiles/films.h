// Films that light crosses straight, films.py and straight.py, for one block of columns; names are the same.

#pragma once

#include "lights.h"

constexpr float SLANT = 2, OWN = 4, ROUND = 0.03f, DOUBT = 0.05f;

// The smaller of x and 1, its corner rounded
static inline V at_most_one(V x) {
  V step = positive(1 - x);
  return x * (step + ROUND) * inverse(step + ROUND * x);
}

// straight.py
struct Fading {
  double rise, bend, level;
  V at(V aside) const {
    aside = lesser(aside, all(100));
    V q = aside * aside;
    return decay(q * (float(rise) + float(bend) * q) * inverse(1 + float(level) * q));
  }
};
struct Fadings {
  Fading leaving, returning;
};

// From every layer to a face: films.py
struct Ways {
  std::vector<V> shares, away;

  // To the first layer, or the last if `turned`
  void find(const Layers& layers, bool turned, bool slab) {
    const int L = int(layers.size());
    shared(layers, turned, slab, SLANT, shares);
    away.resize(L);
    for (int k = 1; k < L; k++) {
      const V per = inverse(at(layers, turned, k).sigma);
      away[k] = V{};
      for (int i = 0; i < k; i++) {
        const Layer& above = at(layers, turned, i);
        away[k] += above.d * (1 - at_most_one(above.sigma * per));
      }
    }
  }
  static const Layer& at(const Layers& layers, bool turned, int k) { return layers[turned ? layers.size() - 1 - k : k]; }

  static void shared(const Layers& layers, bool turned, bool slab, float slant, std::vector<V>& shares) {
    const int L = int(layers.size());
    V left = all(1), whole = {};
    shares.resize(L);
    for (int k = 0; k < L; k++) {
      const Layer& here = at(layers, turned, k);
      shares[k] = left;
      if (k + 1 < L || slab) {
        Decayed fade = decayed(lesser(slant * here.sigma * here.d, all(FAR)));
        shares[k] = left * fade.gone, left *= fade.left;
      }
      if (k + 1 == L) shares[k] += TINY;
      whole += shares[k];
    }
    whole = inverse(whole);
    for (V& share : shares) share *= whole;
  }

  V one_way(const Fading& fading, float s) const {
    V once = shares[0];
    for (size_t k = 1; k < shares.size(); k++) once += shares[k] * fading.at(s * away[k]);
    return once;
  }
  V there_and_back(const Fading& fading, float s) const {
    V once = shares[0], twice = shares[0];
    for (size_t k = 1; k < shares.size(); k++) {
      V left = fading.at(s * away[k]), share = shares[k] * left;
      once += share, twice += share * left;
    }
    return twice * inverse(once + DOUBT * (1 - once));
  }
};

// Where light that reaches a face last scattered
struct Scattered {
  V sigma, squared, let_out;

  void find(const Layers& layers, bool turned, bool slab) {
    const int L = int(layers.size());
    const Layer& first = Ways::at(layers, turned, 0);
    sigma = first.sigma, squared = let_out = all(1);
    if (L == 1) return;
    Ways::shared(layers, turned, slab, OWN, shares);
    bool alike = true;
    sigma = V{};
    for (int k = 0; k < L; k++) {
      const Layer& here = Ways::at(layers, turned, k);
      sigma += shares[k] * here.sigma;
      alike = alike && here.index.eta == first.index.eta;
    }
    if (alike) return;
    squared = let_out = V{};
    for (int k = 0; k < L; k++) {
      const Index& index = Ways::at(layers, turned, k).index;
      const double step = index.eta / first.index.eta;
      squared += shares[k] * float(step * step), let_out += shares[k] * float(index.outlet / first.index.outlet);
    }
  }

 private:
  std::vector<V> shares;
};
