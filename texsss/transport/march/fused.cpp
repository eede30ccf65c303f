// The march of march/kernel.py, samples.py and segments.py as one loop per point: nothing but the result
// leaves the registers. Formulas and their sources stand there; names are the same. Macros that the
// build sets: BOUNDARIES, ENDLESS (an infinite layer below them), SCHLICK, G_CHANNELS (1 or 3),
// MAPPED (coefficients are maps), WIDE (three boundaries have 16 bits each, not 10).

#include <algorithm>
#include <vector>

#include "lanes.h"

constexpr int B = BOUNDARIES, L = BOUNDARIES + ENDLESS, C = 3, G = G_CHANNELS;
constexpr int PER_WORD = B == 1 ? 1 : B == 3 && !WIDE ? 3 : 2, BITS = PER_WORD == 1 ? 24 : PER_WORD == 2 ? 16 : 10;
constexpr int RAY = 11, LIGHT = 11;  // rows of the tables of rays and lights
constexpr float LEAST_LIGHT_COS = 0.03f, SERIES = 0.25f, LEAST_REST = 1e-7f, PI4 = 12.566370614359172f;

// ln x for normal x > 0: the exponent, and a series in (m - 1) / (m + 1) of the mantissa
static inline V logarithm(V x) {
  I bits = (I)x, e = ((bits - 0x3f3504f3) >> 23);
  V m = (V)(bits - (e << 23)), s = (m - 1) * inverse(m + 1), q = s * s;
  V series = 1 + q * (1 / 3.f + q * (0.2f + q * (1 / 7.f + q * (1 / 9.f))));
  return 2 * s * series + real(e) * 0.69314718f;
}

static inline V mean_transmission(V start, V end, V at_start, V at_end) {
  V x = end - start;
  I small = (x < SERIES) & (x > -SERIES);
  V series = at_start * (1 - x * (1 / 2.f) * (1 - x * (1 / 3.f) * (1 - x * (1 / 4.f) * (1 - x * (1 / 5.f) *
             (1 - x * (1 / 6.f))))));
  return small ? series : (at_start - at_end) * inverse(small ? all(1) : x);
}

// Thicknesses of layers in a tiled texture, as whole numbers packed into words; one texel is repeated beyond
// the right and lower edge, so that no neighbour needs wrapping.
struct Texture {
  const int32_t* words;  // (height + 1, width + 2, 2) per word, one word after the other: a texel, that below it
  const float* coded;    // least thickness, then that of one unit, per boundary [mm]
  const float* maps;     // (height + 2, width + 2, KEPT): coefficients of every texel
  int height, width;
  float down, across;  // 1 / height, 1 / width
};

struct Corner {
  I at;
  V fx, fy;
};

static inline Corner corner(const Texture& t, V x, V y) {
  V left = floored(x), top = floored(y);
  V x0 = left - floored(left * t.across) * float(t.width), y0 = top - floored(top * t.down) * float(t.height);
  // never beyond the frame, whatever x and y are: a comparison with NaN is false
  x0 = lesser(greater(x0, V{}), all(float(t.width))), y0 = lesser(greater(y0, V{}), all(float(t.height)));
  return {whole(y0) * (t.width + 2) + whole(x0), x - left, y - top};
}

static inline V blend(const Corner& k, V a, V b, V c, V d) {
  V above = a + k.fx * (b - a), below = c + k.fx * (d - c);
  return above + k.fy * (below - above);
}

static inline void look_up(const Texture& t, V x, V y, V depth[B]) {
  Corner k = corner(t, x, y);
  const int mask = (1 << BITS) - 1;
  const size_t plane = size_t(t.width + 2) * (t.height + 1) * 2;
  V sum = {};
  I a = {}, b = {}, c = {}, d = {};
#pragma GCC unroll 16
  for (int i = 0; i < B; i++) {
    const int shift = BITS * (i % PER_WORD);
    if (shift == 0) fours<2>(t.words + plane * (i / PER_WORD), k.at, a, c, b, d);
    V unit = blend(k, real((a >> shift) & mask), real((b >> shift) & mask), real((c >> shift) & mask),
                   real((d >> shift) & mask));
    sum += t.coded[i] + t.coded[B + i] * unit;
    depth[i] = sum;
  }
}

// σs, σt and g: numbers, or looked up under M
#if MAPPED
typedef V K;
#else
typedef float K;
#endif
constexpr int COUNT = L * (2 * C + G), KEPT = (COUNT + 3) / 4 * 4;
struct Coefficients {
  K sigma_s[L][C], sigma_t[L][C], g[L][G];
};

static inline void coefficients(const Texture& t, const float* numbers, V x, V y, Coefficients& m) {
#if MAPPED
  Corner k = corner(t, x, y);
  const size_t row = size_t(t.width + 2) * KEPT;
  K* out = &m.sigma_s[0][0];
  for (int i = 0; i < KEPT; i += 4) {
    const int32_t* p = (const int32_t*)t.maps + i;
    I a[4], b[4], c[4], d[4];
    fours<KEPT>(p, k.at, a[0], a[1], a[2], a[3]);
    fours<KEPT>(p + KEPT, k.at, b[0], b[1], b[2], b[3]);
    fours<KEPT>(p + row, k.at, c[0], c[1], c[2], c[3]);
    fours<KEPT>(p + row + KEPT, k.at, d[0], d[1], d[2], d[3]);
    for (int j = 0; j < 4 && i + j < COUNT; j++) out[i + j] = blend(k, (V)a[j], (V)b[j], (V)c[j], (V)d[j]);
  }
#else
  (void)t, (void)x, (void)y;
  std::memcpy(&m, numbers, sizeof m);
#endif
}

struct Ray {
  V x, y, dx, dy, length, view_n, view_s, offset, n_s, nearer, goes_on;
};
struct Lamp {
  V light_n, light_s, aside_x, aside_y, light_view, nearness, first, second, power[C];
};

// What M(t) and its plane are like, whatever the light
struct Place {
  V t, fraction, rest, shrink, height, x, y, depth[B];
};

static inline Place place(const Texture& tex, const Ray& r, V fraction) {
  Place m;
  V t = fraction * r.length;
  m.t = t, m.fraction = fraction, m.rest = 1 - m.fraction;
  m.shrink = inverse_root(m.rest * m.rest + m.fraction * m.fraction + 2 * m.rest * m.fraction * r.n_s);
  V along = t * (m.rest * r.view_n + m.fraction * r.view_s) + m.fraction * r.offset * (m.rest + m.fraction * r.n_s);
  m.height = (along < 0 ? -along : along) * m.shrink;
  m.x = r.x + t * r.dx, m.y = r.y + t * r.dy;
  look_up(tex, m.x, m.y, m.depth);
  return m;
}

// The way of one light to M
struct Entry {
  V way, boundary[B], arrives, straight, cosine;
  V near, stretch;
  bool lit;  // in some lane
};

static inline Entry entry(const Ray& r, const Lamp& l, const Place& m) {
  Entry e;
  V near = l.nearness * m.t;
  V stretch = inverse_root(greater(1 + near * (2 * l.light_view + near), all(1e-4f)));
  V facing = (m.rest * (l.light_n + near * r.view_n) + m.fraction * (l.light_s + near * r.view_s)) * stretch * m.shrink;
  e.cosine = greater(facing, all(LEAST_LIGHT_COS));
  V slant = inverse(e.cosine);
  e.way = m.height * slant, e.near = near, e.stretch = stretch;
  V seen = l.first + (l.second - l.first) * lesser(m.fraction * r.nearer, all(1));
  e.arrives = facing > 0 ? seen * stretch * stretch : V{};
  e.straight = (l.light_view + near) * stretch;
  e.lit = some(e.arrives > 0);
  return e;
}

// The boundaries along it
static inline void enter(const Texture& tex, const Ray& r, const Lamp& l, const Place& m, Entry& e) {
  V reach = e.way * e.stretch, half = 0.5f * inverse(e.cosine), depth[B];
  look_up(tex, m.x + reach * (l.aside_x - e.near * r.dx), m.y + reach * (l.aside_y - e.near * r.dy), depth);
  for (int i = 0; i < B; i++) e.boundary[i] = (m.depth[i] + depth[i]) * half;
}

static inline V scattered(V cosine, V g) {
  V size = g < 0 ? -g : g, aside = positive(size + g * cosine), rest = greater(1 - size, all(LEAST_REST));
#if SCHLICK
  V base = rest + aside;
  return (1 - g * g) * (1 / PI4) * inverse(base * base);
#else
  V base = rest * rest + 2 * aside;
  V r = inverse_root(base);
  return (1 - g * g) * (1 / PI4) * r * r * r;
#endif
}

// Optical depth over what lies above each boundary of a path
static inline V optical(const V within[L], const Coefficients& k, int c) {
  V sum = {};
  for (int i = 0; i < B; i++) sum += (i + 1 < L ? k.sigma_t[i][c] - k.sigma_t[i + 1 < L ? i + 1 : 0][c] : k.sigma_t[i][c]) * within[i];
  if (ENDLESS) sum += k.sigma_t[L - 1][c] * within[L - 1];
  return sum;
}

static inline void crossed(V way, const V boundary[B], V within[L]) {
  for (int i = 0; i < B; i++) within[i] = lesser(way, boundary[i]);
  if (ENDLESS) within[L - 1] = way;
}

struct State {
  V passed[C], total[C];
};

// What an infinite last layer adds beyond the end of the ray
static inline void tail(const Coefficients& k, const Ray& r, const Lamp& l, const Entry& e, State& s) {
  V within[L];
  crossed(e.way, e.boundary, within);
  for (int c = 0; c < C; c++) {
    V slope = k.sigma_t[L - 1][c] * (1 + r.view_s / e.cosine);
    V share = r.goes_on * e.arrives * scattered(e.straight, k.g[L - 1][std::min(c, G - 1)] - V{});
    V left = decay(s.passed[c] + optical(within, k, c));
    s.total[c] += l.power[c] * k.sigma_s[L - 1][c] * share * left / greater(slope, all(1e-30f));
  }
}

static inline V any(K x) { return x - V{}; }

static void uniform(const Texture& tex, const float* numbers, const Ray& r, const Lamp* lamps, int lights, V jitter,
                    int samples, State& s) {
  Coefficients k;
  const float share = 1 / float(samples);
  V step = r.length * share;
  for (int n = 0; n < samples; n++) {
    Place m = place(tex, r, positive((float(n) + jitter) * share));
    coefficients(tex, numbers, m.x, m.y, k);
    V below = m.t * r.view_s, here[C], gain[C], g[G];
    if (!ENDLESS && !some(below < m.depth[B - 1])) continue;  // all lanes have passed the last layer
    for (int c = 0; c < C; c++) here[c] = ENDLESS ? any(k.sigma_t[L - 1][c]) : V{}, gain[c] = ENDLESS ? any(k.sigma_s[L - 1][c]) : V{};
    for (int c = 0; c < G; c++) g[c] = any(k.g[L - 1][c]);
    for (int i = B - 1; i >= 0; i--) {
      I above = below < m.depth[i];
      for (int c = 0; c < C; c++) here[c] = above ? any(k.sigma_t[i][c]) : here[c], gain[c] = above ? any(k.sigma_s[i][c]) : gain[c];
      for (int c = 0; c < G; c++) g[c] = above ? any(k.g[i][c]) : g[c];
    }
    for (int j = 0; j < lights; j++) {
      const Lamp& l = lamps[j];
      Entry e = entry(r, l, m);
      if (!e.lit) continue;
      enter(tex, r, l, m, e);
      V within[L], phase[G];
      crossed(e.way, e.boundary, within);
      for (int c = 0; c < G; c++) phase[c] = e.arrives * step * scattered(e.straight, g[c]);
      for (int c = 0; c < C; c++)
        s.total[c] += l.power[c] * gain[c] * phase[std::min(c, G - 1)] * decay(s.passed[c] + optical(within, k, c));
    }
    for (int c = 0; c < C; c++) s.passed[c] += here[c] * step;
  }
  if (ENDLESS)
    for (int j = 0; j < lights; j++) {
      Place m = place(tex, r, all(1));
      coefficients(tex, numbers, m.x, m.y, k);
      Entry e = entry(r, lamps[j], m);
      if (!e.lit) continue;
      enter(tex, r, lamps[j], m, e);
      tail(k, r, lamps[j], e, s);
    }
}

// One light's share in a step that `pieces` has cut
static inline void gather(const Coefficients& k, const Lamp& l, const Entry& a, const Entry& b, const V share[L][G],
                          const V at[L + 1], const V so_far[L + 1][C], const V stretch[L], State& s) {
  V depth[C], left[C];
  for (int p = 0; p <= L; p++) {
    V way = a.way + at[p] * (b.way - a.way), inward[B], within[L];
    for (int i = 0; i < B; i++) inward[i] = a.boundary[i] + at[p] * (b.boundary[i] - a.boundary[i]);
    crossed(way, inward, within);
    for (int c = 0; c < C; c++) {
      V here = s.passed[c] + so_far[p][c] + optical(within, k, c), e = decay(here);
      if (p > 0)
        s.total[c] += l.power[c] * k.sigma_s[p - 1][c] * share[p - 1][std::min(c, G - 1)] * stretch[p - 1] *
                      mean_transmission(depth[c], here, left[c], e);
      depth[c] = here, left[c] = e;
    }
  }
}

struct Before {
  Entry entry;
  V share[L][G];
};

static void exact(const Texture& tex, const float* numbers, const Ray& r, const Lamp* lamps, int lights, float rate,
                  int samples, Before* before, State& s) {
  V beta = lesser(greater(r.length * rate, all(0.05f)), all(9.0f)), gone = 1 - decay(beta), crowded = inverse(beta);
  Place m0{};
  Coefficients k0{}, k1, k;
  V at[L + 1], so_far[L + 1][C], stretch[L];
  for (int n = 0; n <= samples; n++) {
    // dense where light is; the first logarithm is 0 but for rounding
    V knot = n == 0 ? V{} : n == samples ? all(1) : -logarithm(1 - float(n) / float(samples) * gone) * crowded;
    Place m1 = place(tex, r, knot);
    coefficients(tex, numbers, m1.x, m1.y, k1);
    if (n > 0) {
      for (int i = 0; i < int(sizeof k / sizeof(K)); i++)
        (&k.sigma_s[0][0])[i] = MAPPED ? 0.5f * ((&k0.sigma_s[0][0])[i] + (&k1.sigma_s[0][0])[i]) : (&k1.sigma_s[0][0])[i];
      V above[L + 1];
      above[0] = V{};
      I rising = {};
      for (int i = 0; i < B; i++) {
        V left0 = m0.depth[i] - m0.t * r.view_s, left1 = m1.depth[i] - m1.t * r.view_s;
        V most = positive(greater(left0, left1)), least = positive(-lesser(left0, left1));
        above[i + 1] = greater(most * inverse(greater(most + least, all(1e-30f))), above[i]);
        rising |= (left1 > 0) & (left0 <= 0);
      }
      if (ENDLESS) above[L] = all(1);
      for (int c = 0; c < C; c++) so_far[0][c] = V{};
      for (int i = 0; i < L; i++) {
        stretch[i] = (above[i + 1] - above[i]) * (m1.t - m0.t);
        for (int c = 0; c < C; c++) so_far[i + 1][c] = so_far[i][c] + k.sigma_t[i][c] * stretch[i];
      }
      V whole_step[C];
      for (int c = 0; c < C; c++) whole_step[c] = so_far[L][c];
      for (int p = 0; p <= L; p++) {
        at[p] = rising ? 1 - above[p] : above[p];
        for (int c = 0; c < C; c++) so_far[p][c] = rising ? whole_step[c] - so_far[p][c] : so_far[p][c];
      }
      for (int j = 0; j < lights; j++) {
        Before& b = before[j];
        const Lamp& l = lamps[j];
        Entry e = entry(r, l, m1);
        if (!e.lit && !b.entry.lit) {
          b.entry = e;
          continue;
        }
        if (!b.entry.lit) enter(tex, r, l, m0, b.entry);  // left out before
        enter(tex, r, l, m1, e);
        V share[L][G];
        for (int i = 0; i < L; i++)
          for (int c = 0; c < G; c++) {
            V next = e.arrives * scattered(e.straight, any(k1.g[i][c]));
            share[i][c] = 0.5f * (b.share[i][c] + next);
            b.share[i][c] = next;
          }
        gather(k, l, b.entry, e, share, at, so_far, stretch, s);
        b.entry = e;
      }
      for (int c = 0; c < C; c++) s.passed[c] += whole_step[c];
    } else {
      for (int j = 0; j < lights; j++) {
        Entry e = entry(r, lamps[j], m1);
        if (e.lit) enter(tex, r, lamps[j], m1, e);
        before[j].entry = e;
        for (int i = 0; i < L; i++)
          for (int c = 0; c < G; c++) before[j].share[i][c] = e.arrives * scattered(e.straight, any(k1.g[i][c]));
      }
    }
    m0 = m1, k0 = k1;
  }
  if (ENDLESS)
    for (int j = 0; j < lights; j++)
      if (before[j].entry.lit) tail(k1, r, lamps[j], before[j].entry, s);
}

// Points first … last of `points`; `rays` (11, points), `lights` (count, 11, points), `jitter` (points) or null;
// `samples` above 0 are exact steps spaced by `rate`, below 0 uniform samples. Fills `result` (3, points).
static void walk(const int32_t* words, const float* coded, const float* maps, int height, int width,
                 const float* numbers, const float* rays, const float* lights, int count,
                 const float* jitter, int samples, float rate, int64_t first, int64_t last, int64_t points,
                 float* result) {
  const Texture tex{words, coded, maps, height, width, 1 / float(height), 1 / float(width)};
  std::vector<Lamp> lamps(count);
  std::vector<Before> before(count);
  for (int64_t p = first; p < last; p += WIDTH) {
    const int lanes = int(std::min<int64_t>(WIDTH, last - p));
    auto row = [&](const float* from) {
      if (lanes == WIDTH) return load(from + p);
      V r = {};
      for (int i = 0; i < WIDTH; i++) r[i] = from[p + std::min(i, lanes - 1)];
      return r;
    };
    V rows[LIGHT];
    Ray r;
    for (int i = 0; i < RAY; i++) rows[i] = row(rays + i * points);
    std::memcpy(&r, rows, sizeof r);
    for (int j = 0; j < count; j++) {
      for (int i = 0; i < LIGHT; i++) rows[i] = row(lights + (int64_t(j) * LIGHT + i) * points);
      std::memcpy(&lamps[j], rows, sizeof(Lamp));
    }
    State s{};
    if (samples > 0)
      exact(tex, numbers, r, lamps.data(), count, rate, samples, before.data(), s);
    else
      uniform(tex, numbers, r, lamps.data(), count, jitter ? row(jitter) : V{}, -samples, s);
    for (int c = 0; c < C; c++)
      for (int i = 0; i < lanes; i++) result[c * points + p + i] = s.total[c][i];
  }
}

// Whether there was memory for what it holds
extern "C" bool march(const int32_t* words, const float* coded, const float* maps, int height, int width,
                      const float* numbers, const float* rays, const float* lights, int count,
                      const float* jitter, int samples, float rate, int64_t first, int64_t last, int64_t points,
                      float* result) {
  return enough([&] {
    walk(words, coded, maps, height, width, numbers, rays, lights, count, jitter, samples, rate, first, last, points,
         result);
  });
}
