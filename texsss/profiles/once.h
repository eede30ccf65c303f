// Light that scattered exactly once, single.py, for one block of columns; names are the same.

#pragma once

#include "lights.h"

constexpr float DAMPING = 0.45f, TURN = 0.835164654f, SPREAD_FROM = 3;
constexpr float STEEP = 300;  // extinction times the depth above, beyond which differences lose their digits
constexpr int AZIMUTHS = 12;
constexpr double PI = 3.14159265358979323846;

// The way out at one cosine through one layer, from either side: numbers
struct Way {
  float cosine, slant, drift, part;
};
// One cosine of light that leaves by the near face
struct Exit {
  float weight, there, mirrored, again;  // weights at both faces; mirrored by the far one, and by both
  std::vector<Way> near, far;
};

static inline double refracted(double cosine, double here, double there) {
  double squared = 1 - (1 - cosine * cosine) * (here / there) * (here / there);
  return squared > 0 ? std::sqrt(squared) : 0;
}
static inline double spread(double near, double eta_near, double far, double eta_far) {
  return near * eta_near * eta_near / (far * eta_far * eta_far);
}
static std::vector<Way> way_through(double mu, const std::vector<double>& etas) {
  std::vector<Way> way;
  for (double eta : etas) {
    double cosine = refracted(mu, etas[0], eta), squared = 1 / (cosine * cosine) - 1;
    double drift = squared > 1e-12 ? std::sqrt(squared) : 1e-6;
    way.push_back({float(cosine), float(1 / cosine), float(drift), float(spread(mu, etas[0], cosine, eta))});
  }
  return way;
}
static Exit exit_at(double mu, double weight, double mirrored, double again, const std::vector<double>& etas) {
  const double first = etas.front(), last = etas.back(), there = refracted(mu, first, last);
  const std::vector<double> back(etas.rbegin(), etas.rend());
  return {float(weight / 2), float(weight / 2 * spread(mu, first, there, last)), float(mirrored), float(again),
          way_through(mu, etas), way_through(there, back)};
}

// e^(-DAMPING x) times sin and cos of TURN x, for x of 0 to FAR: series on ±π/2, turned by halves
static inline void oscillation(V x, V& sine, V& cosine) {
  I n = whole(x * (TURN / float(PI)) + 0.5f);
  V k = real(n), f = x * TURN - k * 3.140625f;
  f = f - k * 9.67653590e-4f;
  V q = f * f, damped = (V)((I)decay(x * DAMPING) ^ (n << 31));
  V s = 1 - q * (1 / 6.f - q * (1 / 120.f - q * (1 / 5040.f - q * (1 / 362880.f - q * (1 / 39916800.f)))));
  V c = 1 - q * (0.5f - q * (1 / 24.f - q * (1 / 720.f - q * (1 / 40320.f - q * (1 / 3628800.f)))));
  sine = damped * f * s, cosine = damped * c;
}

// 4π times Henyey and Greenstein's phase function between cones of directions of travel, over azimuth
static V deflection(float first, float second, V g) {
  float across = (1 - first * first) * (1 - second * second);
  across = across > 0 ? std::sqrt(across) : 0;
  V total = {};
  for (int i = 0; i < AZIMUTHS; i++) {
    V base = 1 + g * g - 2 * g * (first * second + across * std::cos(float((i + 0.5) * PI / AZIMUTHS)));
    V r = inverse_root(base);
    total += r * r * r;
  }
  return total * (1 - g * g) * float(1.0 / AZIMUTHS);
}

// AZIMUTHS: cos φ between the ways in and out of a direction of light from all around, and an exit
static float azimuth(int beam, int exit) {
  static const float cosines[] = {0.923879533f, 0.382683432f, -0.382683432f, -0.923879533f};
  static const int two[2][4] = {{1, 2, 0, 3}, {2, 1, 3, 0}}, three[3][4] = {{2, 3, 1, 0}, {1, 2, 0, 3}, {0, 1, 3, 2}};
  return cosines[BEAMS == 2 ? two[beam][exit] : three[beam][exit]];
}
static float displaced(float out, float into, float turn) {
  float squared = 1 / (out * out) - 1, there = 1 / (into * into) - 1;
  squared += there + 2 * turn * std::sqrt(std::max(squared * there, 0.f));
  return std::sqrt(std::max(squared, 1e-12f));
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
  int L;
  bool slab, endless, steep;  // whether a bottom mirrors, whether there is none, and whether some layer is STEEP
  bool around;                // whether the lights are one from all around: each goes ways of its own
  const std::vector<Exit>* exits;
  std::vector<Leg> legs;  // (exits, lights if they come from all around, 2, L): by the near face, and by the far one
  Layers back;
  Lights behind;

  // `deflected`: by Henyey and Greenstein, with true coefficients; else isotropic
  void prepare(const Layers& layers, const Lights& lights, bool no_end, const std::vector<Exit>& given, bool deflected,
               bool from_around, bool mirrored = true) {
    L = int(layers.size()), endless = no_end, slab = mirrored && !endless, steep = false, exits = &given;
    around = BEAMS > 1 && from_around;
    legs.resize(given.size() * (around ? BEAMS : 1) * 2 * L);
    if (slab) turned(layers, lights, back, behind);
    Leg* out = legs.data();
    for (size_t i = 0; i < given.size(); i++)
      for (int beam = 0; beam < (around ? BEAMS : 1); beam++, out += 2 * L) {
        const Exit& exit = given[i];
        const float turn = around ? azimuth(beam, int(i)) : 0;
        leads_out(layers, lights, exit.near.data(), exit.weight, deflected, beam, turn, out);
        if (slab) leads_out(back, behind, exit.far.data(), exit.there, deflected, beam, turn, out + L);
      }
  }

  // of all lights, or of the one that is the `first`
  void leads_out(const Layers& layers, const Lights& lights, const Way* way, float weight, bool deflected, int first,
                 float turn, Leg* out) {
    const int count = around ? 1 : BEAMS;
    V above[BEAMS], aside = {};
    for (int j = 0; j < count; j++) above[j] = lights[first + j].down * weight;
    for (int k = 0; k < L; k++, way++) {
      const Layer& layer = layers[k];
      Leg& leg = out[k];
      leg.drift = around ? displaced(way->cosine, lights[k * BEAMS + first].cosine, turn) : way->drift;
      const float per_drift = 1 / leg.drift;
      leg.endless = endless && k == L - 1;
      leg.d = layer.d, leg.escape = layer.sigma * way->slant;
      steep = steep || some(layer.sigma * aside > STEEP * leg.drift);
      if (!leg.endless) aside += layer.d * leg.drift;
      leg.aside = aside, leg.over = V{};
      V starts = {};
      for (int j = 0; j < count; j++) {
        const Light& light = lights[k * BEAMS + first + j];
        Shaft& shaft = leg.shafts[j];
        V a = light.sigma + leg.escape, source = light.source * way->part;
        shaft.squared = a * a, shaft.slant = a * per_drift;
        V turned_back = deflected ? source * deflection(light.cosine, -way->cosine, layer.g) : source;
        shaft.start = turned_back * above[j];
        starts += shaft.start;
        if (leg.endless) continue;
        above[j] *= faded(a * layer.d);
        shaft.end = turned_back * above[j];
        leg.over += shaft.end * per_drift;
        if (!slab) continue;
        V onwards = deflected ? source * deflection(light.cosine, way->cosine, layer.g) : source;
        leg.bounced[j] = {light.tau, light.beam, onwards * weight * layer.d * light.up};
      }
      if (k > 0) out[k - 1].over -= starts * per_drift;
    }
  }

  V at(float s) const {
    s = s > 1e-12f ? s : 1e-12f;
    return around ? all_ways<1>(s) : all_ways<BEAMS>(s);
  }

  template <int COUNT>
  V all_ways(float s) const {
    V total = {};
    const Leg* near = legs.data();
    for (const Exit& exit : *exits)
      for (int group = 0; group < BEAMS / COUNT; group++, near += 2 * L) {
        if (slab) {
          total += steep ? joined(exit, leaving<true, true, COUNT>(near, s), leaving<true, true, COUNT>(near + L, s))
                         : joined(exit, leaving<true, false, COUNT>(near, s), leaving<true, false, COUNT>(near + L, s));
        } else {
          total += (steep ? leaving<false, true, COUNT>(near, s) : leaving<false, false, COUNT>(near, s)).light;
        }
      }
    return total;
  }

  struct Left {
    V light, through;
  };

  static V joined(const Exit& exit, const Left& here, const Left& far) {
    V light = here.light + exit.mirrored * here.through * far.light;
    return light * inverse(1 - exit.again * here.through * here.through);
  }

  // CAREFUL: (a / √(a² + b²) - 1) / drift without the difference, where it counts
  template <bool SLAB, bool CAREFUL, int COUNT>
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
      if (SLAB || !leg.endless) {
        V sine, cosine;
        oscillation(lesser(s * leg.aside, all(FAR)), sine, cosine);
        area = sine * per_turn;
        wave = cosine + (s * DAMPING) * area;
        if (!CAREFUL) total += leg.over * area;
      }
      for (int j = 0; j < COUNT; j++) {
        const Shaft& shaft = leg.shafts[j];
        if (CAREFUL) {
          V root = inverse_root(shaft.squared + b2), straight = k ? shaft.start * first : shaft.start;
          V turned = k ? shaft.start * before : V{};
          if (SLAB || !leg.endless) straight -= shaft.end * wave, turned -= shaft.end * area;
          turned *= s * s * leg.drift * root * inverse(1 + leg.drift * shaft.slant * root);
          total += root * (straight - turned);
          continue;
        }
        V here = k ? shaft.start * (first + shaft.slant * before) : shaft.start;
        if (SLAB || !leg.endless) here -= shaft.end * (wave + shaft.slant * area);
        total += here * inverse_root(shaft.squared + b2);
      }
      if (!SLAB) continue;
      V wide = root(leg.escape * leg.escape + b2);
      V m = (leg.escape + shift * (wide - leg.escape)) * leg.d, passed = faded(m);
      for (int j = 0; j < COUNT; j++) {
        const Bounced& ray = leg.bounced[j];
        total += ray.strength * through * overlap(passed, ray.beam, ray.tau - m);
      }
      through *= passed;
    }
    return {total, through};
  }
};

// All light that leaves by the first of `layers` at s = 0, once scattered, where nothing is absorbed
struct White {
  Layers back;
  Lights behind;

  V all_of(const Layers& layers, const Lights& lights, bool endless, const std::vector<Exit>& exits) {
    if (!endless) turned(layers, lights, back, behind);
    V total = {};
    for (const Exit& exit : exits) {
      Once::Left here = leaving(layers, lights, exit.near.data(), exit.weight, endless);
      if (endless)
        total += here.light;
      else
        total += Once::joined(exit, here, leaving(back, behind, exit.far.data(), exit.there, false));
    }
    return total;
  }

  static Once::Left leaving(const Layers& layers, const Lights& lights, const Way* way, float weight, bool endless) {
    const int L = int(layers.size());
    V total = {}, through = all(1), above[BEAMS];
    for (int j = 0; j < BEAMS; j++) above[j] = lights[j].down;
    for (int k = 0; k < L; k++, way++) {
      const Layer& layer = layers[k];
      V escape = layer.sigma * way->slant, m = escape * layer.d, passed = endless ? V{} : faded(m);
      for (int j = 0; j < BEAMS; j++) {
        const Light& light = lights[k * BEAMS + j];
        V source = layer.sigma * (light.share * (way->part / light.cosine));
        V a = light.sigma + escape;
        Decayed fade = {V{}, all(1)};
        if (!endless || k < L - 1) fade = decayed(lesser(a * layer.d, all(FAR)));
        total += source * above[j] * fade.gone * inverse(a);
        above[j] *= fade.left;
        if (!endless) total += source * layer.d * light.up * through * overlap(passed, light.beam, light.tau - m);
      }
      through *= passed;
    }
    return {total * weight, through};
  }
};
