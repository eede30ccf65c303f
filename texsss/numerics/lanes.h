// Vectors of floats, one item of work per lane, for loops that native.py builds.

#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <exception>

#if defined(__AVX512F__)  // by instructions: the header of intrinsics takes longer to read than all else
constexpr int WIDTH = 16;
#elif defined(__AVX__)
constexpr int WIDTH = 8;
#else
constexpr int WIDTH = 4;
#endif

typedef float V __attribute__((vector_size(4 * WIDTH)));
typedef int32_t I __attribute__((vector_size(4 * WIDTH)));

static inline V all(float x) { return x - V{}; }
// the second of both where one is NaN
#if defined(__AVX512F__)
static inline V lesser(V a, V b) {
  asm("vminps %1, %0, %0" : "+v"(a) : "v"(b));
  return a;
}
static inline V greater(V a, V b) {
  asm("vmaxps %1, %0, %0" : "+v"(a) : "v"(b));
  return a;
}
#else
static inline V lesser(V a, V b) { return a < b ? a : b; }
static inline V greater(V a, V b) { return a > b ? a : b; }
#endif
// whether a comparison holds in some lane
static inline bool some(I held) {
#if defined(__AVX512F__)
  int16_t lanes;
  asm("vptestmd %1, %1, %0" : "=Yk"(lanes) : "v"(held));
  return lanes;
#else
  for (int i = 0; i < WIDTH; i++)
    if (held[i]) return true;
  return false;
#endif
}
static inline V positive(V a) { return greater(a, V{}); }
static inline V real(I a) { return __builtin_convertvector(a, V); }
static inline I whole(V a) { return __builtin_convertvector(a, I); }
static inline V floored(V a) {
#if defined(__AVX512F__)
  V r;
  asm("vrndscaleps $1, %1, %0" : "=v"(r) : "v"(a));
  return r;
#elif defined(__AVX__)
  typedef float Half __attribute__((vector_size(32)));
  Half half[sizeof(V) / sizeof(Half)];
  V r;
  std::memcpy(half, &a, sizeof a);
  for (Half& h : half) h = __builtin_ia32_roundps256(h, 1);
  std::memcpy(&r, half, sizeof r);
  return r;
#else
  V cut = real(whole(a)), size = a < 0 ? -a : a;
  cut = cut > a ? cut - 1 : cut;
  return size < 8388608.0f ? cut : a;  // beyond, floats are whole, and soon more than integers can say
#endif
}
// estimates of 14 bits and one step of Newton's, where there are such; ∞ of 0, and 0 of ∞
#if defined(__AVX512F__)
static inline V ends_mended(V r, V a) {
  const I table = I{} + 0x870600;  // by what `a` is: 0, -∞, ∞; all else stays
  asm("vfixupimmps $0, %2, %1, %0" : "+v"(r) : "v"(a), "v"(table));
  return r;
}
#endif
static inline V inverse(V a) {
#if defined(__AVX512F__)
  V r;
  asm("vrcp14ps %1, %0" : "=v"(r) : "v"(a));
  return ends_mended(r * (2 - a * r), a);
#else
  return 1 / a;
#endif
}
static inline V inverse_root(V a) {
#if defined(__AVX512F__)
  V r;
  asm("vrsqrt14ps %1, %0" : "=v"(r) : "v"(a));
  return ends_mended(r * (1.5f - 0.5f * a * r * r), a);
#else
  V r = {};
  for (int i = 0; i < WIDTH; i++) r[i] = 1 / __builtin_sqrtf(a[i]);
  return r;
#endif
}
static inline I gathered(const int32_t* from, I at) {
#if defined(__AVX512F__)
  I r;
  int16_t left = -1;  // the lanes still to be read
  asm("vpgatherdd (%2,%3,4), %0%{%1%}" : "=&v"(r), "+Yk"(left) : "r"(from), "v"(at) : "memory");
  return r;
#else
  I r = {};
  for (int i = 0; i < WIDTH; i++) r[i] = from[at[i]];
  return r;
#endif
}
// four words in a row from every place, STEP words apart: four gathers of one word each take longer
template <int STEP>
static inline void fours(const int32_t* from, I at, I& a, I& b, I& c, I& d) {
#if defined(__AVX512F__)
  alignas(64) int32_t place[WIDTH];
  std::memcpy(place, &at, sizeof place);
  asm("" : "+m"(place));  // lanes are read from memory: to extract them one by one takes longer
  struct Four {
    int32_t words[4];
  };
  I part[4];  // a b c d of lanes k, 4 + k, 8 + k, 12 + k
  for (int k = 0; k < 4; k++) {
    auto words = [&](int lane) -> const Four& { return *(const Four*)(from + int64_t(place[lane]) * STEP); };
    I x;
    asm("vmovdqu32 %1, %x0" : "=v"(x) : "m"(words(k)));
    asm("vinserti32x4 $1, %1, %0, %0" : "+v"(x) : "m"(words(4 + k)));
    asm("vinserti32x4 $2, %1, %0, %0" : "+v"(x) : "m"(words(8 + k)));
    asm("vinserti32x4 $3, %1, %0, %0" : "+v"(x) : "m"(words(12 + k)));
    part[k] = x;
  }
  I ab[2], cd[2];
  for (int k = 0; k < 2; k++) {
    asm("vpunpckldq %2, %1, %0" : "=v"(ab[k]) : "v"(part[2 * k]), "v"(part[2 * k + 1]));
    asm("vpunpckhdq %2, %1, %0" : "=v"(cd[k]) : "v"(part[2 * k]), "v"(part[2 * k + 1]));
  }
  asm("vpunpcklqdq %2, %1, %0" : "=v"(a) : "v"(ab[0]), "v"(ab[1]));
  asm("vpunpckhqdq %2, %1, %0" : "=v"(b) : "v"(ab[0]), "v"(ab[1]));
  asm("vpunpcklqdq %2, %1, %0" : "=v"(c) : "v"(cd[0]), "v"(cd[1]));
  asm("vpunpckhqdq %2, %1, %0" : "=v"(d) : "v"(cd[0]), "v"(cd[1]));
#else
  a = b = c = d = I{};
  for (int i = 0; i < WIDTH; i++) {
    const int32_t* p = from + int64_t(at[i]) * STEP;
    a[i] = p[0], b[i] = p[1], c[i] = p[2], d[i] = p[3];
  }
#endif
}
static inline V load(const float* p) {
  V r = {};
  std::memcpy(&r, p, sizeof r);
  return r;
}

// e^-x for x ≥ 0, to 2e-7 of it, and 1 - e^-x, which keeps its digits near 0: 2^n times a series on ±½ ln 2
struct Decayed {
  V left, gone;
};
static inline Decayed decayed(V x) {
  x = lesser(x, all(87.0f));
  I n = whole(x * 1.44269504f + 0.5f);
  V f = x - real(n) * 0.693359375f + real(n) * 2.12194440e-4f;
  V lost = f * (1 - f * (0.5f - f * (1 / 6.f - f * (1 / 24.f - f * (1 / 120.f - f * (1 / 720.f))))));
  V scale = (V)((127 - n) << 23);
  return {scale - scale * lost, 1 - scale + scale * lost};
}
static inline V decay(V x) { return decayed(x).left; }

// Whether there was memory for all of `work`: nothing is thrown at those who know no C++
template <class Work>
static bool enough(Work work) {
  try {
    work();
  } catch (const std::exception&) {
    return false;
  }
  return true;
}
