// Points between the nodes of a lattice and the weights of those around them, for products.cpp. See stencil.py.

#pragma once

#include <algorithm>
#include <cstdint>

#include "columns.h"

namespace stencil {

constexpr int NODES = 13, AROUND = 19;
constexpr int SOME = 8;    // points whose weights are made at once
constexpr int AHEAD = 16;  // points for which memory is asked beforehand

static inline Eight larger(Eight a, Eight b) { return a > b ? a : b; }
static inline Eight smaller(Eight a, Eight b) { return a > b ? b : a; }

// Points, each in a `cell`, `beyond` the node in its middle (x of all `count`, then y, then z), with weights of a
// `kind`; `table`: to which of those `near` the cell these belong, in rows of AROUND
struct Points {
  int64_t count;
  const int32_t* cell;
  const float* beyond;
  const uint8_t *kind, *table;
  const int32_t* near;

  const int32_t* around(int64_t i) const { return near + AROUND * int64_t(cell[i]); }
  const uint8_t* places(int64_t i) const { return table + NODES * kind[i]; }

  Eight away(int64_t i, int axis) const {
    const float* from = beyond + axis * count + i;
    if (i + SOME <= count) return larger(loaded<Eight>(from), -loaded<Eight>(from));
    float held[SOME] = {};
    std::copy(from, from + (count - i), held);
    return larger(loaded<Eight>(held), -loaded<Eight>(held));
  }

  // Of some points from `i` on
  void weights(int64_t i, float made[NODES][SOME]) const {
    Eight to[NODES];
    const Eight x = away(i, 0), y = away(i, 1), z = away(i, 2), low = smaller(x, y), high = larger(x, y);
    const Eight u = larger(high, z), v = larger(low, smaller(high, z)), w = smaller(low, z);
    const Eight a = 0.5f * (0.5f - u) * (0.5f - u), b = 0.5f * (0.5f - v) * (0.5f - v),
                c = 0.5f * (0.5f - w) * (0.5f - w);
    const Eight au = a * (1 - v), bv = b * (1 - u), cw = c * (1 - u), av = a * v, bu = b * u, cu = c * u;
    to[1] = u * (1 - v - w) + au - 2 * (bu + cu), to[2] = au;
    to[3] = v * (1 - u - w) + bv - 2 * av, to[4] = bv;
    to[5] = w * (1 - u - v) + cw, to[6] = cw;
    to[7] = u * v + av + bu, to[8] = av, to[9] = bu;
    to[10] = u * w + cu, to[11] = cu, to[12] = v * w;
    to[0] = 1 - (((to[1] + to[2]) + (to[3] + to[4])) + ((to[5] + to[6]) + (to[7] + to[8])) +
                 ((to[9] + to[10]) + (to[11] + to[12])));
    for (int k = 0; k < NODES; k++) stored(made[k], to[k]);
  }

  // Asks for the nodes around a point, unless the one before has asked
  void ask(int64_t i, const float* x, int64_t pitch) const {
    if (cell[i] == cell[i - 1] && kind[i] == kind[i - 1]) return;
    const int32_t* at = around(i);
    const uint8_t* place = places(i);
    for (int k = 0; k < NODES; k++) __builtin_prefetch(x + at[place[k]] * pitch);
  }
};

}  // namespace stencil
