// Light that scattered exactly once, single.py, for one block of columns; names are the same.

#pragma once

#include "lights.h"

constexpr float DAMPING = 0.35f, TURN = 0.72f, SPREAD_FROM = 3;
constexpr int AZIMUTHS = 12;
constexpr double PI = 3.14159265358979323846;

struct Exit {
  double mu, weight, mirrored, again;  // mirrored by the far face, and by both
};

// sin x and cos x for x of -1 to some hundred: series on ±π/4, turned by quarters
static inline void turn(V x, V& sine, V& cosine) {
  I n = whole(x * 0.63661977f + 0.5f);
  V f = x - real(n) * 1.5703125f;
  f = f - real(n) * 4.8382679e-4f;
  V q = f * f;
  V s = f + f * q * (-1 / 6.f + q * (1 / 120.f - q * (1 / 5040.f)));
  V c = 1 - q * (0.5f - q * (1 / 24.f - q * (1 / 720.f - q * (1 / 40320.f))));
  I odd = (n & 1) != 0;
  V a = odd ? c : s, b = odd ? s : c;
  sine = (V)((I)a ^ ((n & 2) << 30)), cosine = (V)((I)b ^ (((n + 1) & 2) << 30));
}

// 4π times Henyey and Greenstein's phase function between cones of directions of travel, over azimuth
static V deflection(double first, double second, V g) {
  double across = (1 - first * first) * (1 - second * second);
  across = across > 0 ? std::sqrt(across) : 0;
  V total = {};
  for (int i = 0; i < AZIMUTHS; i++) {
    V base = 1 + g * g - 2 * g * float(first * second + across * std::cos((i + 0.5) * PI / AZIMUTHS));
    V r = inverse_root(base);
    total += r * r * r;
  }
  return total * (1 - g * g) * float(1.0 / AZIMUTHS);
}

static inline double spread(double near, double eta_near, double far, double eta_far) {
  return near * eta_near * eta_near / (far * eta_far * eta_far);
}

struct Shaft {
  V squared, slant, start, end;
};
struct Bounced {
  V tau, beam, strength;
};
struct Leg {
  float drift;
  bool endless;
  V aside, d, escape, over;
  Shaft shafts[BEAMS];
  Bounced bounced[BEAMS];
};

struct Once {
  int count, L;
  bool slab;
  std::vector<Exit> exits;
  std::vector<Leg> legs;  // (exits, 2, L): by the near face, and by the far one
  Layers back;
  Lights behind;

  // `deflected`: by Henyey and Greenstein, with true coefficients; else isotropic
  void prepare(const Layers& layers, const Lights& lights, int directions, bool endless, const Exit* given, int nodes,
               bool deflected) {
    count = directions, L = int(layers.size()), slab = !endless;
    exits.assign(given, given + nodes);
    legs.resize(size_t(nodes) * 2 * L);
    if (slab) turned(layers, lights, count, back, behind);
    const double near = layers[0].eta, far = layers[L - 1].eta;
    for (int n = 0; n < nodes; n++) {
      const double mu = exits[n].mu, there = refracted(mu, near, far);
      way_out(layers, lights, mu, exits[n].weight / 2, deflected, &legs[size_t(n) * 2 * L]);
      if (slab) {
        double weight = exits[n].weight / 2 * spread(there, far, mu, near);
        way_out(back, behind, there, weight, deflected, &legs[(size_t(n) * 2 + 1) * L]);
      }
    }
  }

  void way_out(const Layers& layers, const Lights& lights, double mu, double weight, bool deflected, Leg* out) {
    V above[BEAMS], aside = {};
    for (int j = 0; j < count; j++) above[j] = lights[j].down * float(weight);
    for (int k = 0; k < L; k++) {
      const Layer& layer = layers[k];
      const double cosine = refracted(mu, layers[0].eta, layer.eta), part = spread(mu, layers[0].eta, cosine, layer.eta);
      const double squared = 1 / (cosine * cosine) - 1, drift = squared > 1e-12 ? std::sqrt(squared) : 1e-6;
      Leg& leg = out[k];
      leg.drift = float(drift), leg.endless = !slab && k == L - 1;
      leg.d = layer.d, leg.escape = layer.sigma * float(1 / cosine);
      if (!leg.endless) aside += layer.d * leg.drift;
      leg.aside = aside, leg.over = V{};
      V starts = {};
      for (int j = 0; j < count; j++) {
        const Light& light = lights[k * count + j];
        Shaft& shaft = leg.shafts[j];
        V a = light.sigma + leg.escape, source = light.source * float(part);
        shaft.squared = a * a, shaft.slant = a * float(1 / drift);
        V turned_back = deflected ? source * deflection(light.cosine, -cosine, layer.g) : source;
        shaft.start = turned_back * above[j];
        starts += shaft.start;
        if (leg.endless) continue;
        above[j] *= faded(a * layer.d);
        shaft.end = turned_back * above[j];
        leg.over += shaft.end * float(1 / drift);
        if (!slab) continue;
        V onwards = deflected ? source * deflection(light.cosine, cosine, layer.g) : source;
        leg.bounced[j] = {light.tau, light.beam, onwards * float(weight) * layer.d * light.up};
      }
      if (k > 0) out[k - 1].over -= starts * float(1 / drift);
    }
  }

  V at(float s) const {
    s = s > 1e-12f ? s : 1e-12f;
    V total = {};
    for (size_t n = 0; n < exits.size(); n++) {
      const Leg* near = &legs[n * 2 * L];
      if (!slab) {
        total += leaving<false>(near, s).light;
        continue;
      }
      Left here = leaving<true>(near, s), far = leaving<true>(near + L, s);
      V light = here.light + float(exits[n].mirrored) * here.through * far.light;
      total += light * inverse(1 - float(exits[n].again) * here.through * here.through);
    }
    return total;
  }

  struct Left {
    V light, through;
  };

  template <bool SLAB>
  Left leaving(const Leg* legs, float s) const {
    V total = {}, wave = {}, area = {}, through = all(1), shift = {};
    const float per_turn = 1 / (TURN * s);
    if (SLAB) {
      shift = s * legs[L - 1].aside;
      shift *= inverse(shift + SPREAD_FROM);
    }
    for (int k = 0; k < L; k++) {
      const Leg& leg = legs[k];
      const float b2 = s * leg.drift * s * leg.drift;
      const V first = wave, before = area;
      if (!leg.endless) {
        V x = lesser(s * leg.aside, all(FAR)), damped = decay(x * DAMPING), sine, cosine;
        turn(x * TURN, sine, cosine);
        area = damped * sine * per_turn;
        wave = damped * cosine + (s * DAMPING) * area;
      }
      for (int j = 0; j < count; j++) {
        const Shaft& shaft = leg.shafts[j];
        V here = k ? shaft.start * (first + shaft.slant * before) : shaft.start;
        if (!leg.endless) here -= shaft.end * (wave + shaft.slant * area);
        total += here * inverse_root(shaft.squared + b2);
      }
      if (!leg.endless) total += leg.over * area;
      if (!SLAB) continue;
      V wide = root(leg.escape * leg.escape + b2);
      V m = (leg.escape + shift * (wide - leg.escape)) * leg.d, passed = faded(m);
      for (int j = 0; j < count; j++) {
        const Bounced& ray = leg.bounced[j];
        total += ray.strength * through * overlap(passed, ray.beam, ray.tau - m);
      }
      through *= passed;
    }
    return {total, through};
  }
};
