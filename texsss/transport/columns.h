// Vectors of columns, and columns of several arrays side by side, for products.cpp.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "threads.h"

#if defined(__AVX512F__) && defined(__AVX512VL__)
#include <immintrin.h>
#define MASKED 1
#else
#define MASKED 0
#endif

// Some columns of one row: W floats of which `n` are there.
template <int W>
struct Lane {
  typedef float T __attribute__((vector_size(4 * W)));
};
template <>
struct Lane<1> {
  typedef float T;
};

template <int W>
struct Columns {
  typedef typename Lane<W>::T T;
  int n;
  explicit Columns(int n) : n(n) {}
  unsigned mask() const { return (1u << n) - 1; }
  T load(const float* p) const {
    if constexpr (W == 1) return *p;
#if MASKED
    if constexpr (W == 4) return (T)_mm_maskz_loadu_ps(__mmask8(mask()), p);
    if constexpr (W == 8) return (T)_mm256_maskz_loadu_ps(__mmask8(mask()), p);
    if constexpr (W == 16) return (T)_mm512_maskz_loadu_ps(__mmask16(mask()), p);
#endif
    T r{};
    std::memcpy(&r, p, sizeof(float) * n);
    return r;
  }
  void store(float* p, T v) const {
    if constexpr (W == 1) {
      *p = v;
      return;
    }
#if MASKED
    if constexpr (W == 4) return _mm_mask_storeu_ps(p, __mmask8(mask()), (__m128)v);
    if constexpr (W == 8) return _mm256_mask_storeu_ps(p, __mmask8(mask()), (__m256)v);
    if constexpr (W == 16) return _mm512_mask_storeu_ps(p, __mmask16(mask()), (__m512)v);
#endif
    std::memcpy(p, &v, sizeof(float) * n);
  }
};

// `work(columns, first)` for blocks of at most 16 columns
template <class Work>
static void blocks(int64_t count, Work work) {
  for (int64_t c = 0; c < count; c += 16) {
    const int n = int(std::min<int64_t>(16, count - c));
    if (n == 1)
      work(Columns<1>(n), c);
    else if (n <= 4)
      work(Columns<4>(n), c);
    else if (n <= 8)
      work(Columns<8>(n), c);
    else
      work(Columns<16>(n), c);
  }
}

// Rows of several arrays side by side: group g holds `each` columns at address[g], `pitch` floats from row to
// row; `scale` (groups × rows) or null is a factor of each.
struct Groups {
  const int64_t* address;
  int64_t count, each, pitch, rows;
  const float* scale;
  float* row(int64_t g, int64_t i) const { return (float*)address[g] + i * pitch; }
  float factor(int64_t g, int64_t i) const { return scale ? scale[g * rows + i] : 1.0f; }
};

// A block of columns, of which some lie in each of several groups
struct Parts {
  struct Part {
    int64_t group, to;  // the group's first column of these, in floats from the block's first
    int first, n;
  };
  const Groups& groups;
  Part parts[16];
  int count = 0;
  const Part* begin() const { return parts; }
  const Part* end() const { return parts + count; }
  Parts(const Groups& groups, int64_t from, int64_t columns) : groups(groups) {
    const int64_t to = from + columns;
    for (int64_t g = from / groups.each; g < groups.count && g * groups.each < to; g++) {
      const int64_t first = std::max(from, g * groups.each), last = std::min(to, (g + 1) * groups.each);
      parts[count++] = {g, from - g * groups.each, int(first - from), int(last - first)};
    }
  }
  void prefetch(int64_t i) const {
    for (const Part& part : *this) __builtin_prefetch(groups.row(part.group, i) + part.to + part.first, 1);
  }
  template <class Some>
  void store(int64_t i, typename Some::T v, const Some& some) const {
#if MASKED
    if constexpr (sizeof v > 4) {
      const __m512 held = widened(v);
      for (const Part& part : *this) {
        const __m512 own = groups.scale ? _mm512_mul_ps(held, _mm512_set1_ps(groups.factor(part.group, i))) : held;
        _mm512_mask_storeu_ps(groups.row(part.group, i) + part.to, mask(part), own);
      }
      return;
    }
#endif
    float held[sizeof v / 4];
    std::memcpy(held, &v, sizeof v);
    for (const Part& part : *this) {
      float* to = groups.row(part.group, i) + part.to;
      const float own = groups.factor(part.group, i);
      for (int k = part.first; k < part.first + part.n; k++) to[k] = own * held[k];
    }
  }
  template <class Some>
  typename Some::T load(int64_t i, const Some& some) const {
    typedef typename Some::T T;
#if MASKED
    if constexpr (sizeof(T) > 4) {
      __m512 held = _mm512_setzero_ps();
      for (const Part& part : *this) {
        held = _mm512_mask_loadu_ps(held, mask(part), groups.row(part.group, i) + part.to);
        if (groups.scale)
          held = _mm512_mask_mul_ps(held, mask(part), held, _mm512_set1_ps(groups.factor(part.group, i)));
      }
      if constexpr (sizeof(T) == 16) return (T)_mm512_castps512_ps128(held);
      if constexpr (sizeof(T) == 32) return (T)_mm512_castps512_ps256(held);
      if constexpr (sizeof(T) == 64) return (T)held;
    }
#endif
    float held[sizeof(T) / 4] = {};
    for (const Part& part : *this) {
      const float* from = groups.row(part.group, i) + part.to;
      const float own = groups.factor(part.group, i);
      for (int k = part.first; k < part.first + part.n; k++) held[k] = own * from[k];
    }
    T v;
    std::memcpy(&v, held, sizeof v);
    return v;
  }
#if MASKED
  static __mmask16 mask(const Part& part) { return __mmask16(((1u << part.n) - 1) << part.first); }
  template <class T>
  static __m512 widened(T v) {
    if constexpr (sizeof v == 16) return _mm512_castps128_ps512((__m128)v);
    if constexpr (sizeof v == 32) return _mm512_castps256_ps512((__m256)v);
    if constexpr (sizeof v == 64) return (__m512)v;
  }
#endif
};
