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

#if MASKED
template <class T>
static inline __m512 widened(T v) {
  if constexpr (sizeof v == 16) return _mm512_castps128_ps512((__m128)v);
  if constexpr (sizeof v == 32) return _mm512_castps256_ps512((__m256)v);
  if constexpr (sizeof v == 64) return (__m512)v;
}
template <class T>
static inline T narrowed(__m512 v) {
  if constexpr (sizeof(T) == 16) return (T)_mm512_castps512_ps128(v);
  if constexpr (sizeof(T) == 32) return (T)_mm512_castps512_ps256(v);
  if constexpr (sizeof(T) == 64) return (T)v;
}
#endif

// Rows of several arrays side by side: group g holds `each` columns at address[g], `pitch` floats from row to
// row; `scale` (groups × rows) or null is a factor of each.
struct Groups {
  const int64_t* address;
  int64_t count, each, pitch, rows;
  const float* scale;
};

// A block of columns, of which some lie in each of several groups
struct Parts {
  struct Part {
    float* row;  // the first one's place of the block's first column
    const float* scale;
    int first, n;
    unsigned mask() const { return ((1u << n) - 1) << first; }
  };
  Part parts[16];
  int count = 0;
  int64_t pitch;
  const Part* begin() const { return parts; }
  const Part* end() const { return parts + count; }
  Parts(const Groups& groups, int64_t from, int64_t columns) : pitch(groups.pitch) {
    const int64_t to = from + columns, each = groups.each;
    for (int64_t g = from / each; g < groups.count && g * each < to; g++) {
      const int64_t first = std::max(from, g * each), last = std::min(to, (g + 1) * each);
      float* row = (float*)groups.address[g] + (from - g * each);
      const float* scale = groups.scale ? groups.scale + g * groups.rows : nullptr;
      parts[count++] = {row, scale, int(first - from), int(last - first)};
    }
  }
  template <class Some>
  void store(int64_t i, typename Some::T v, const Some&) const {
#if MASKED
    if constexpr (sizeof v > 4) {
      const __m512 held = widened(v);
      for (const Part& part : *this) {
        const __m512 own = part.scale ? _mm512_mul_ps(held, _mm512_set1_ps(part.scale[i])) : held;
        _mm512_mask_storeu_ps(part.row + i * pitch, __mmask16(part.mask()), own);
      }
      return;
    }
#endif
    float held[sizeof v / 4];
    std::memcpy(held, &v, sizeof v);
    for (const Part& part : *this) {
      float* to = part.row + i * pitch;
      const float own = part.scale ? part.scale[i] : 1.0f;
      for (int k = part.first; k < part.first + part.n; k++) to[k] = own * held[k];
    }
  }
  template <class Some>
  typename Some::T load(int64_t i, const Some&) const {
    typedef typename Some::T T;
#if MASKED
    if constexpr (sizeof(T) > 4) {
      __m512 held = _mm512_setzero_ps();
      for (const Part& part : *this) {
        const __mmask16 mask = __mmask16(part.mask());
        held = _mm512_mask_loadu_ps(held, mask, part.row + i * pitch);
        if (part.scale) held = _mm512_mask_mul_ps(held, mask, held, _mm512_set1_ps(part.scale[i]));
      }
      return narrowed<T>(held);
    }
#endif
    float held[sizeof(T) / 4] = {};
    for (const Part& part : *this) {
      const float* from = part.row + i * pitch;
      const float own = part.scale ? part.scale[i] : 1.0f;
      for (int k = part.first; k < part.first + part.n; k++) held[k] = own * from[k];
    }
    T v;
    std::memcpy(&v, held, sizeof v);
    return v;
  }
};

#if MASKED
// The same for at most five groups of three columns, as colours are, without counting
template <int GROUPS>
struct Colours {
  float* row[GROUPS];
  const float* scale[GROUPS];
  int64_t pitch;
  explicit Colours(const Groups& groups) : pitch(groups.pitch) {
    for (int g = 0; g < GROUPS; g++) {
      row[g] = (float*)groups.address[g];
      scale[g] = groups.scale ? groups.scale + g * groups.rows : nullptr;
    }
  }
  // three in fours, and back
  static __m512i apart() { return _mm512_setr_epi32(0, 1, 2, 15, 3, 4, 5, 15, 6, 7, 8, 15, 9, 10, 11, 15); }
  static __m512i together() { return _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 19); }
  static __m512i fifth() { return _mm512_setr_epi32(12, 13, 14, 15, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0); }
  void put(int64_t i, int g, __m128 v) const {
    if (scale[g]) v = _mm_mul_ps(v, _mm_set1_ps(scale[g][i]));
    _mm_mask_storeu_ps(row[g] + i * pitch, 7, v);
  }
  __m128 got(int64_t i, int g) const {
    const __m128 v = _mm_maskz_loadu_ps(7, row[g] + i * pitch);
    return scale[g] ? _mm_mul_ps(v, _mm_set1_ps(scale[g][i])) : v;
  }
  template <class Some>
  void store(int64_t i, typename Some::T some, const Some&) const {
    const __m512 v = widened(some), w = _mm512_permutexvar_ps(apart(), v);
    put(i, 0, _mm512_castps512_ps128(w));
    if constexpr (GROUPS > 1) put(i, 1, _mm512_extractf32x4_ps(w, 1));
    if constexpr (GROUPS > 2) put(i, 2, _mm512_extractf32x4_ps(w, 2));
    if constexpr (GROUPS > 3) put(i, 3, _mm512_extractf32x4_ps(w, 3));
    if constexpr (GROUPS > 4) put(i, 4, _mm512_castps512_ps128(_mm512_permutexvar_ps(fifth(), v)));
  }
  template <class Some>
  typename Some::T load(int64_t i, const Some&) const {
    __m512 w = _mm512_castps128_ps512(got(i, 0)), last = _mm512_setzero_ps();
    w = _mm512_maskz_mov_ps(0x000f, w);
    if constexpr (GROUPS > 1) w = _mm512_insertf32x4(w, got(i, 1), 1);
    if constexpr (GROUPS > 2) w = _mm512_insertf32x4(w, got(i, 2), 2);
    if constexpr (GROUPS > 3) w = _mm512_insertf32x4(w, got(i, 3), 3);
    if constexpr (GROUPS > 4) last = _mm512_castps128_ps512(got(i, 4));
    return narrowed<typename Some::T>(_mm512_permutex2var_ps(w, together(), last));
  }
};
#endif

// `work(columns, first, parts)` for blocks of at most 16 columns of all groups
template <class Work>
static void laid(const Groups& groups, Work work) {
#if MASKED
  if (groups.each == 3) {
    if (groups.count == 1) return work(Columns<4>(3), int64_t(0), Colours<1>(groups));
    if (groups.count == 2) return work(Columns<8>(6), int64_t(0), Colours<2>(groups));
    if (groups.count == 3) return work(Columns<16>(9), int64_t(0), Colours<3>(groups));
    if (groups.count == 4) return work(Columns<16>(12), int64_t(0), Colours<4>(groups));
    if (groups.count == 5) return work(Columns<16>(15), int64_t(0), Colours<5>(groups));
  }
#endif
  blocks(groups.count * groups.each, [&](auto some, int64_t c) { work(some, c, Parts(groups, c, some.n)); });
}
