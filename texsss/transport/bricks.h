// Convolutions along the axes of a lattice in bricks of 4 × 4 × 4 nodes, for products.cpp. See bricks.py.

#pragma once

#include <algorithm>
#include <cstdint>

#include "columns.h"

namespace bricks {

constexpr int SIDE = 4, LAYER = SIDE * SIDE, NODES = SIDE * LAYER, HALF = LAYER / 2;

// Axes p, q, s of a brick become q, s, p: of half the layers of p, to half the brick
static inline void rotated(const Eight in[SIDE], float* out) {
  const Eight a = in[0], b = in[1], c = in[2], d = in[3];
  const Eight ab = {a[0], b[0], a[1], b[1], a[4], b[4], a[5], b[5]};
  const Eight cd = {c[0], d[0], c[1], d[1], c[4], d[4], c[5], d[5]};
  const Eight ab_on = {a[2], b[2], a[3], b[3], a[6], b[6], a[7], b[7]};
  const Eight cd_on = {c[2], d[2], c[3], d[3], c[6], d[6], c[7], d[7]};
  // rows 0 and 4, 1 and 5, 2 and 6, 3 and 7
  const Eight zero = {ab[0], ab[1], cd[0], cd[1], ab[4], ab[5], cd[4], cd[5]};
  const Eight one = {ab[2], ab[3], cd[2], cd[3], ab[6], ab[7], cd[6], cd[7]};
  const Eight two = {ab_on[0], ab_on[1], cd_on[0], cd_on[1], ab_on[4], ab_on[5], cd_on[4], cd_on[5]};
  const Eight three = {ab_on[2], ab_on[3], cd_on[2], cd_on[3], ab_on[6], ab_on[7], cd_on[6], cd_on[7]};
  stored(out, together(low(zero), low(one)));
  stored(out + 8, together(low(two), low(three)));
  stored(out + 16, together(high(zero), high(one)));
  stored(out + 24, together(high(two), high(three)));
}

// Weights at distances of -`reach` to `reach`, with SIDE zeros on either side: layers that are too far take part in
// the same sums
struct Taps {
  const float* padded;
  int reach, bricks;
  Taps(const float* padded, int64_t reach)
      : padded(padded), reach(int(reach)), bricks(int((reach + SIDE - 1) / SIDE)) {}
};

// One brick of C columns from those `near` it in `from`, its axes rotated
template <int C>
static inline void turned(const Taps& taps, const int32_t* near, const float* from, int64_t pitch, float* to) {
  for (int half = 0; half < LAYER; half += HALF) {
    Eight sum[C][SIDE] = {};
    for (int b = -taps.bricks; b <= taps.bricks; b++) {
      const int32_t brick = near[b + taps.bricks];
      if (brick < 0) continue;
      const float* held = from + brick * pitch + half;
      const int first = std::max(0, -taps.reach - SIDE * b), last = std::min(SIDE, SIDE + taps.reach - SIDE * b);
      for (int s = first; s < last; s++) {
        const float* tap = taps.padded + SIDE + taps.reach + SIDE * b + s;
        for (int c = 0; c < C; c++) {
          const Eight layer = loaded<Eight>(held + c * NODES + s * LAYER);
          for (int o = 0; o < SIDE; o++) sum[c][o] += tap[-o] * layer;
        }
      }
    }
    for (int c = 0; c < C; c++) rotated(sum[c], to + c * NODES + half * SIDE);
  }
}

// `columns` of one brick, some at once
static inline void turned(int64_t columns, const Taps& taps, const int32_t* near, const float* from, int64_t pitch,
                          float* to) {
  int64_t c = 0;
  for (; c + 3 <= columns; c += 3) turned<3>(taps, near, from + c * NODES, pitch, to + c * NODES);
  for (; c < columns; c++) turned<1>(taps, near, from + c * NODES, pitch, to + c * NODES);
}

}  // namespace bricks
