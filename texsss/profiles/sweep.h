// Light that scattered twice or more, two_mode_sweep.py, for one block of columns; names are the same.

#pragma once

#include "films.h"

struct Modes {
  double mu[2], b[2], gamma[2], delta[2], w[2];
};
struct Parameters {
  double weight;
  Modes inner, near, far;
};

struct Face {
  float base[2], gamma[2], delta[2];
  V loss[2], out[2], free, per_sigma;
  bool straight;
  Fadings fadings;
  Scattered origin;
  Ways ways;

  void prepare(const Layers& layers, bool turned, bool slab, const Modes& modes, const Fadings& given) {
    const int L = int(layers.size());
    const Layer& first = layers[turned ? L - 1 : 0];
    V thick = !slab && L == 1 ? first.sigma : first.sigma * (first.d + 1e-15f);
    origin.find(layers, turned, slab);
    for (int m = 0; m < 2; m++) {
      base[m] = float(1 / (modes.mu[m] * modes.mu[m])), gamma[m] = float(modes.gamma[m]), delta[m] = float(modes.delta[m]);
      loss[m] = thick * origin.let_out * float(modes.b[m]), out[m] = loss[m] * float(modes.w[m]);
    }
    free = thick * origin.squared, per_sigma = inverse(origin.sigma);
    straight = L > 1, fadings = given;
    if (straight) ways.find(layers, turned, slab);
  }

  // What it loses and lets out of either mode
  void at(float s, V lost[2], V leaves[2]) const {
    V u = s * per_sigma, x = u * u;
    for (int m = 0; m < 2; m++) {
      lost[m] = root(base[m] + gamma[m] * x) * loss[m];
      leaves[m] = root(base[m] + delta[m] * x) * out[m];
    }
    if (!straight) return;
    V passed = ways.one_way(fadings.leaving, s), gone = (1 - ways.one_way(fadings.returning, 2 * s)) / 2;
    for (int m = 0; m < 2; m++) {
      V none = root(base[m] + x) * free, step = (none - lost[m]) * gone, share = none * inverse(none - step);
      lost[m] = (lost[m] + step) * share, leaves[m] *= passed * share;
    }
  }
};

struct Sweep {
  struct Carried {
    V rate, down[BEAMS], up[BEAMS];
  };
  struct Level {
    bool endless;
    V d2, aside, hidden, tau[BEAMS], beam[BEAMS], k1, k2, into[4], back[4], ratio;
    Carried coupled[2], alone[2];
  };
  std::vector<Level> levels;
  Face near, far;
  bool slab;
  float weight;

  // `fadings`: of the near and of the far face
  void prepare(const Layers& layers, const Lights& lights, bool endless, const Parameters& set, const Fadings& nearby,
               const Fadings& beyond) {
    const int L = int(layers.size());
    levels.resize(L), slab = !endless, weight = float(set.weight);
    spread_aside(layers, endless);
    for (int k = L - 1; k >= 0; k--) {
      const Layer& layer = layers[k];
      Level& here = levels[k];
      here.endless = endless && k == L - 1;
      V rates[2];
      eigen(layer, set.inner, rates, here.k1, here.k2);
      V d = layer.d + 1e-15f;
      here.d2 = d * d, here.aside *= here.d2;
      for (int j = 0; j < BEAMS; j++) {
        const Light& light = lights[k * BEAMS + j];
        V strength = here.endless ? light.source : light.source * layer.d;
        here.tau[j] = here.endless ? light.sigma : light.tau, here.beam[j] = light.beam;
        V down = strength * light.down, up = strength * light.up;
        for (int m = 0; m < 2; m++) {
          V y = m == 0 ? 1 - here.k2 : 1 + here.k1;
          here.alone[m].down[j] = down, here.alone[m].up[j] = up;
          here.coupled[m].down[j] = down * y, here.coupled[m].up[j] = up * y;
        }
      }
      for (int m = 0; m < 2; m++) {
        V u = layer.sigma * float(1 / set.inner.mu[m]), own = u * u;
        here.coupled[m].rate = here.endless ? rates[m] : rates[m] * here.d2 + 1e-30f;
        here.alone[m].rate = here.endless ? own : own * here.d2 + 1e-30f;
      }
      if (k == L - 1) continue;
      const Layer& under = layers[k + 1];
      const Level& below = levels[k + 1];
      const double step = under.index.eta / layer.index.eta;
      here.ratio = layer.sigma * inverse(under.sigma) * float(step * step) * d;
      if (!below.endless) here.ratio /= under.d + 1e-15f;
      // k2 / k1 is the same in all layers, so that both of the diagonal are one
      V own = inverse(1 + below.k1 * below.k2), scale = here.ratio * inverse(1 + here.k1 * here.k2);
      V a = 1 + here.k1 * below.k2, b = below.k1 - here.k1, c = here.k2 - below.k2;
      here.into[0] = a * scale, here.into[1] = b * scale, here.into[2] = c * scale, here.into[3] = a * scale;
      here.back[0] = a * own, here.back[1] = -b * own, here.back[2] = -c * own, here.back[3] = a * own;
    }
    near.prepare(layers, false, slab, set.near, nearby);
    if (slab) far.prepare(layers, true, slab, set.far, beyond);
  }

  // Share of D by which light spreads along every layer: films.py
  void spread_aside(const Layers& layers, bool endless) {
    const int last = int(layers.size()) - 1, finite = endless ? last : last + 1;
    auto crossed = [&](int k) { return decayed(lesser(SLANT * layers[k].sigma * layers[k].d, all(FAR))); };
    V up = {}, down = {}, whole = {};
    if (endless) {
      up = inverse(layers[last].sigma);
    } else {  // down, up and down again without end
      for (int k = 0; k < finite; k++) {
        Decayed x = crossed(k);
        down = passed(layers[k], x, down), whole += SLANT * layers[k].sigma * layers[k].d;
      }
      for (int k = last; k >= 0; k--) up = passed(layers[k], crossed(k), up);
      Decayed x = decayed(lesser(whole, all(FAR)));
      up = (down + x.left * up) * inverse(x.gone * (1 + x.left) + TINY);
    }
    for (int k = finite - 1; k >= 0; k--) levels[k].aside = up = passed(layers[k], crossed(k), up);
    down = up;
    for (int k = 0; k < finite; k++) {
      down = passed(layers[k], crossed(k), down);
      levels[k].aside = at_most_one((levels[k].aside + down) * layers[k].sigma * 0.5f);
    }
    // what sees an outer face crosses straight, but for the share again that scatters on the way
    V above = {}, below = {};
    for (int k = 0; k < finite; k++) {
      levels[k].hidden = decayed(above).gone;
      above = lesser(above + OWN * layers[k].sigma * layers[k].d, all(FAR));
    }
    for (int k = finite - 1; k >= 0; k--) {
      V share = levels[k].aside;
      if (!endless) {
        levels[k].hidden *= decayed(below).gone;
        below = lesser(below + OWN * layers[k].sigma * layers[k].d, all(FAR));
      }
      levels[k].aside = share * (share + levels[k].hidden * (1 - share));
    }
  }
  static V passed(const Layer& layer, const Decayed& crossed, V path) {
    return crossed.gone * inverse(layer.sigma) + crossed.left * path;
  }

  static void eigen(const Layer& layer, const Modes& modes, V rates[2], V& k1, V& k2) {
    V sigma2 = layer.sigma * layer.sigma, per = inverse(layer.sigma);
    V a = layer.sigma_s * per, lost = layer.sigma_a * per;
    V K1 = sigma2 * float(1 / (modes.mu[0] * modes.mu[0])), K2 = sigma2 * float(1 / (modes.mu[1] * modes.mu[1]));
    V c1 = a * K1 * float(modes.w[0]), c2 = a * K2 * float(modes.w[1]), delta = (K1 - K2 - c1 + c2) / 2;
    V r = root(delta * delta + c1 * c2), p = inverse(delta + r);
    rates[0] = (K1 + K2 - c1 - c2) / 2 + r;
    rates[1] = K1 * K2 * lost * inverse(rates[0]) + TINY;
    k1 = c1 * p, k2 = c2 * p;
  }

  struct Orders {
    V once, twice;  // and more
  };

  Orders at(float s) const {
    const float s2 = s * s;
    V b[2], out[2], lowest[2] = {}, unseen[2];
    near.at(s, b, out);
    if (slab) far.at(s, lowest, unseen);
    V once = uncoupled(s2, 0, b[0], out[0], lowest[0]) + uncoupled(s2, 1, b[1], out[1], lowest[1]);
    return {weight * once, weight * (coupled(s2, b, out, lowest) - once)};
  }

  V received(const Level& level, const Carried& carried, V decay) const {
    V total = {};
    for (int j = 0; j < BEAMS; j++) total += carried.down[j] * inverse(level.tau[j] + decay);
    return total;
  }
  Lit shone(const Level& level, const Carried& carried, const Crossing& mode) const {
    return lit(mode, level.tau, level.beam, carried.down, carried.up, slab);
  }

  V coupled(float s2, const V b[2], const V out[2], const V lowest[2]) const {
    const int last = int(levels.size()) - 1;
    V r0 = {}, r1 = {}, g0 = {}, g1 = {}, g2 = {}, g3 = {};
    for (int k = last; k >= 0; k--) {
      const Level& level = levels[k];
      const Carried &one = level.coupled[0], &two = level.coupled[1];
      if (level.endless) {
        g0 = root(one.rate + s2), g3 = root(two.rate + s2);
        r0 = received(level, one, g0), r1 = received(level, two, g3);
        continue;
      }
      V G0, G1, G2, G3;
      if (k == last) {  // V⁻¹ diag(lowest) V
        V det = inverse(1 + level.k1 * level.k2), step = lowest[0] - lowest[1], mixed = level.k1 * level.k2 * det;
        G0 = lowest[0] - mixed * step, G1 = level.k1 * det * step, G2 = level.k2 * det * step, G3 = lowest[1] + mixed * step;
      } else {
        const V *i = level.into, *o = level.back;
        V a0 = i[0] * g0 + i[1] * g2, a1 = i[0] * g1 + i[1] * g3, a2 = i[2] * g0 + i[3] * g2, a3 = i[2] * g1 + i[3] * g3;
        G0 = a0 * o[0] + a1 * o[2], G1 = a0 * o[1] + a1 * o[3], G2 = a2 * o[0] + a3 * o[2], G3 = a2 * o[1] + a3 * o[3];
        V left = r0 * o[0] + r1 * o[2];
        r1 = r0 * o[1] + r1 * o[3], r0 = left;
      }
      Crossing first = crossing(one.rate + s2 * level.aside), second = crossing(two.rate + s2 * level.aside);
      Lit l1 = shone(level, one, first), l2 = shone(level, two, second);
      V f1 = l1.far + r0, f2 = l2.far + r1;
      V B1 = G0 + first.c, B2 = G3 + second.c, cross = G1 * G2, q1 = G0 * B2 - cross, q2 = G3 * B1 - cross;
      V part = inverse(q1 + first.c * B2), e1 = first.k * part, e2 = second.k * part, both = first.k * e2;
      r0 = l1.near + e1 * (f1 * B2 - f2 * G2), r1 = l2.near + e2 * (f2 * B1 - f1 * G1);
      g0 = (first.squared * B2 + first.c * q1) * part, g3 = (second.squared * B1 + second.c * q2) * part;
      g1 = both * G1, g2 = both * G2;
    }
    // (V Γ + diag(b) V) c = out
    V k1 = levels[0].k1, k2 = levels[0].k2;
    V M0 = g0 + b[0] + k1 * g2, M1 = g1 + k1 * (g3 + b[0]), M2 = g2 - k2 * (g0 + b[1]), M3 = g3 + b[1] - k2 * g1;
    // if the first layer is absent all of both is so small that products vanish
    V per = inverse(M3), p0 = out[0] * per, p1 = out[1] * per;
    M0 *= per, M1 *= per, M2 *= per, M3 *= per;
    V reached = r0 * (M3 * p0 - M1 * p1) + r1 * (M0 * p1 - M2 * p0);
    return reached * inverse(M0 * M3 - M1 * M2);
  }

  V uncoupled(float s2, int m, V b, V out, V lowest) const {
    V response = {}, admittance = lowest, whole = all(1);  // the first two over the third
    for (int k = int(levels.size()) - 1; k >= 0; k--) {
      const Level& level = levels[k];
      const Carried& carried = level.alone[m];
      if (level.endless) {
        admittance = root(carried.rate + s2);
        response = received(level, carried, admittance);
        continue;
      }
      V part = inverse(whole), Gd = admittance * part;
      if (k + 1 < int(levels.size())) Gd *= level.ratio;
      Crossing mode = crossing(carried.rate + s2 * level.aside);
      Lit light = shone(level, carried, mode);
      whole = mode.c + Gd;
      response = light.near * whole + mode.k * (light.far + response * part);
      admittance = mode.squared + Gd * mode.c;
    }
    return out * response * inverse(admittance + b * whole);
  }
};
