// What similarity lacks where light scatters forwards, four_streams.py, for one block of columns; names are the same.

#pragma once

#include "lights.h"

struct Streams {
  double M, a, r, n, p2, mean, near[4], far[4];
};

struct FourStreams {
  Layers media, seen;
  Lights lights, falling;

  // Of all light that leaves by one side at s = 0: in truth less when reduced, as `layers` are
  V lacking(const Layers& layers, bool endless, bool below, const Direction* directions, const std::vector<Direction>& finer,
            const Streams& k) {
    V total = {};
    for (int reduced = 0; reduced < 2; reduced++) {
      media = layers;
      for (Layer& layer : media) {
        V more = layer.sigma_s * layer.g * (1 + layer.g);
        if (reduced)
          layer.g = V{};
        else
          layer.sigma_s += more, layer.sigma += more;
      }
      light_in(media, endless, directions, lights, finer);
      if (below) turned(media, lights, seen, falling);
      V light = below ? scattered(seen, falling, endless, k) : scattered(media, lights, endless, k);
      total += reduced ? -light : light;
    }
    return endless ? total : total + unscattered(layers, below, finer);
  }

  // What leaves by this side unscattered in the one less what does in the other, as a product
  V unscattered(const Layers& layers, bool below, const std::vector<Direction>& finer) const {
    V total = {};
    for (const Direction& from : finer) {
      const float q = from.top * from.bottom;
      V tau = {}, more = {};
      for (size_t i = 0; i < layers.size(); i++) {
        const Layer& layer = layers[i];
        V d = layer.d * (1 / from.cosines[i]);
        tau += layer.sigma * d, more += layer.sigma_s * layer.g * (1 + layer.g) * d;
      }
      // more is below 0 where light is scattered backwards
      V apart = greater(greater(more, -more), all(1e-6f)), here = faded(tau), there = faded(tau + more);
      V less = -more * faded(lesser(tau, tau + more)) * decayed(lesser(apart, all(FAR))).gone * inverse(apart);
      V both = (1 - q * here * here) * (1 - q * there * there);
      V out = below ? (1 - from.bottom) * (1 + q * here * there) : from.bottom * (1 - from.top) * (here + there);
      total += from.share * out * less * inverse(both);
    }
    return total;
  }

  // m coth m - m / sinh m
  static V turned_back(const Crossing& mode) { return mode.squared * mode.half * mode.half * inverse(mode.part); }

  static V scattered(const Layers& layers, const Lights& lights, bool endless, const Streams& k) {
    const int last = int(layers.size()) - 1;
    const float M = float(k.M), a = float(k.a), r = float(k.r), n = float(k.n);
    V Y0 = all(float(k.far[0])), Y1 = all(float(k.far[1])), Y2 = all(float(k.far[2])), Y3 = all(float(k.far[3]));
    V f0 = {}, f1 = {};
    for (int i = last; i >= 0; i--) {
      const Layer& layer = layers[i];
      const bool open = endless && i == last;
      V per = inverse(layer.sigma), lost = layer.sigma_a * per, g = layer.g;
      V thin = inverse(1 + g + g * g), kept = layer.sigma_s * per;
      V back = (kept + positive(1 - lost - kept)) * thin;  // a clear layer's σ is as if it scattered
      V s1 = lost + back, s2 = lost + back * (1 + g), g1 = (g + g * g) * thin, g2 = g * g * thin;
      V D0 = M * per * inverse(s1), D1 = n * per, per0 = inverse(D0), per1 = inverse(D1);
      V sigma2 = layer.sigma * layer.sigma;
      V A11 = sigma2 * lost * s1 * (1 / M), A22 = sigma2 * (s2 + r * a * lost) * (1 / n);
      V A12 = -a * A11, A21 = (-r / n) * sigma2 * lost, delta = (A22 - A11) * 0.5f;
      V p = delta + root(delta * delta + A12 * A21), fast = A11 + p, under = inverse(p);
      V slow = sigma2 * lost * s1 * s2 * (1 / (M * n)) * (sigma2 * inverse(fast)) + TINY;
      V x = -A21 * under, y = A12 * under, det = inverse(1 - x * y);
      V tau[BEAMS], beam[BEAMS], down[2][BEAMS], up[2][BEAMS], made[2] = {};
      V jump = {}, change = {};  // what of the flux is not a slope: at the bottom, and how much less that is than at the top
      for (int j = 0; j < BEAMS; j++) {
        const Light& light = lights[i * BEAMS + j];
        const float legendre = (3 * light.cosine * light.cosine - 1) / 2 - float(k.mean);
        V q0 = 0.5f * (1 + g1 * inverse(s1)) * per0, q1 = 0.5f * (g2 * (legendre / float(k.p2)) - r) * per1;
        V by[2] = {(q0 - y * q1) * det, (q1 - x * q0) * det};
        V along = 0.5f * light.cosine * light.source * g1 * per * inverse(s1);
        if (open) {
          change -= along * light.down;
        } else {
          jump += along * (light.down * light.beam - light.up);
          change -= along * (light.down + light.up) * decayed(lesser(light.tau, all(FAR))).gone;
        }
        V strength = open ? light.source : light.source * layer.d;
        tau[j] = open ? light.sigma : light.tau, beam[j] = light.beam;
        for (int m = 0; m < 2; m++) down[m][j] = strength * light.down * by[m], up[m][j] = strength * light.up * by[m];
      }
      V c0, c1, c2, c3, over = all(1);  // γ
      if (open) {
        c0 = root(slow), c3 = root(fast), c1 = c2 = V{};
        for (int j = 0; j < BEAMS; j++) {
          made[0] += down[0][j] * inverse(tau[j] + c0);
          made[1] += down[1][j] * inverse(tau[j] + c3);
        }
      } else {
        const V d = layer.d + 1e-15f;
        over = inverse(d);
        if (i < last) {
          const double step = layers[i + 1].index.eta / layer.index.eta;
          const float ratio = float(step * step);
          Y0 *= ratio, Y1 *= ratio, Y2 *= ratio, Y3 *= ratio;
        }
        // V⁻¹ D⁻¹ Y V d
        V one = d * per0 * det, two = d * per1 * det;
        V a0 = (Y0 + Y1 * x) * one, a1 = (Y0 * y + Y1) * one, a2 = (Y2 + Y3 * x) * two, a3 = (Y2 * y + Y3) * two;
        V G0 = a0 - y * a2, G1 = a1 - y * a3, G2 = a2 - x * a0, G3 = a3 - x * a1;
        Crossing first = crossing(slow * d * d + 1e-30f), second = crossing(fast * d * d + 1e-30f);
        Lit l0 = lit(first, tau, beam, down[0], up[0], !endless), l1 = lit(second, tau, beam, down[1], up[1], !endless);
        V h0 = (f0 + jump) * per0, h1 = f1 * per1, z0 = (h0 - y * h1) * det, z1 = (h1 - x * h0) * det;
        V B1 = G0 + first.c, B2 = G3 + second.c, cross = G1 * G2, u0 = G0 * B2 - cross, u1 = G3 * B1 - cross;
        V part = inverse(u0 + first.c * B2), both = first.k * second.k * part;
        // what comes from below passes, less a little
        made[0] = l0.near + part * (first.k * (l0.far * B2 - (l1.far + z1) * G1) - z0 * (turned_back(first) * B2 + u0));
        made[1] = l1.near + part * (second.k * (l1.far * B1 - (l0.far + z0) * G2) - z1 * (turned_back(second) * B1 + u1));
        c0 = (first.squared * B2 + first.c * u0) * part, c3 = (second.squared * B1 + second.c * u1) * part;
        c1 = both * G1, c2 = both * G2;
      }
      // back to (u, v): D V γ V⁻¹ / d
      V a0 = c0 + y * c2, a1 = c1 + y * c3, a2 = x * c0 + c2, a3 = x * c1 + c3;
      V one = D0 * det * over, two = D1 * det * over;
      Y0 = (a0 - a1 * x) * one, Y1 = (a1 - a0 * y) * one, Y2 = (a2 - a3 * x) * two, Y3 = (a3 - a2 * y) * two;
      f0 += D0 * (made[0] + y * made[1]) + change, f1 += D1 * (x * made[0] + made[1]);
    }
    const float B0 = float(k.near[0]), B1 = float(k.near[1]);
    Y0 += B0, Y1 += B1, Y2 += float(k.near[2]), Y3 += float(k.near[3]);
    V u = Y3 * f0 - Y1 * f1, v = Y0 * f1 - Y2 * f0;
    return 2 * (B0 * u + B1 * v) * inverse(Y0 * Y3 - Y1 * Y2);
  }
};
