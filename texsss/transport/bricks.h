// Convolutions along the axes of a lattice in bricks of 4 × 4 × 4 nodes, for products.cpp. See bricks.py.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "columns.h"

namespace bricks {

constexpr int SIDE = 4, LAYER = SIDE * SIDE, NODES = SIDE * LAYER;
typedef float Layer __attribute__((vector_size(4 * LAYER)));

// Axes p, q, s of a brick in layers become q, s, p
static inline void rotated(const Layer in[SIDE], float* out) {
#if MASKED
  // pairs of p beside each other, for q below 2 and above; then all four
  const __m512i low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
  const __m512i high = _mm512_add_epi32(low, _mm512_set1_epi32(8));
  const __m512i even = _mm512_setr_epi32(0, 1, 16, 17, 2, 3, 18, 19, 4, 5, 20, 21, 6, 7, 22, 23);
  const __m512i odd = _mm512_add_epi32(even, _mm512_set1_epi32(8));
  for (int half = 0; half < 2; half++) {
    const __m512i pick = half ? high : low;
    const __m512 one = _mm512_permutex2var_ps((__m512)in[0], pick, (__m512)in[1]);
    const __m512 two = _mm512_permutex2var_ps((__m512)in[2], pick, (__m512)in[3]);
    _mm512_storeu_ps(out + 2 * half * LAYER, _mm512_permutex2var_ps(one, even, two));
    _mm512_storeu_ps(out + (2 * half + 1) * LAYER, _mm512_permutex2var_ps(one, odd, two));
  }
#else
  float held[NODES];
  std::memcpy(held, in, sizeof held);
  for (int p = 0; p < SIDE; p++)
    for (int rest = 0; rest < LAYER; rest++) out[rest * SIDE + p] = held[p * LAYER + rest];
#endif
}

struct Taps {
  std::vector<float> padded;  // zeros beside them: layers on either side take part in the same sums
  int reach, bricks;
  Taps(const float* taps, int64_t reach)
      : padded(2 * reach + 1 + 2 * SIDE, 0.0f), reach(int(reach)), bricks(int((reach + SIDE - 1) / SIDE)) {
    std::copy(taps, taps + 2 * reach + 1, padded.begin() + SIDE);
  }
};

// One brick of C columns from those `near` it in `from`, its axes rotated
template <int C>
static inline void turned(const Taps& taps, const int32_t* near, const float* from, int64_t pitch, float* to) {
  Layer sum[C][SIDE] = {};
  for (int b = -taps.bricks; b <= taps.bricks; b++) {
    const int32_t brick = near[b + taps.bricks];
    if (brick < 0) continue;
    const float* held = from + brick * pitch;
    const int first = std::max(0, -taps.reach - SIDE * b), last = std::min(SIDE, SIDE + taps.reach - SIDE * b);
    for (int s = first; s < last; s++) {
      const float* tap = taps.padded.data() + SIDE + taps.reach + SIDE * b + s;
      for (int c = 0; c < C; c++) {
        Layer layer;
        std::memcpy(&layer, held + c * NODES + s * LAYER, sizeof layer);
        for (int o = 0; o < SIDE; o++) sum[c][o] += tap[-o] * layer;
      }
    }
  }
  for (int c = 0; c < C; c++) rotated(sum[c], to + c * NODES);
}

// `columns` of one brick, some at once
static inline void turned(int64_t columns, const Taps& taps, const int32_t* near, const float* from, float* to) {
  const int64_t pitch = columns * NODES;
  int64_t c = 0;
  for (; c + 3 <= columns; c += 3) turned<3>(taps, near, from + c * NODES, pitch, to + c * NODES);
  for (; c < columns; c++) turned<1>(taps, near, from + c * NODES, pitch, to + c * NODES);
}

}  // namespace bricks
