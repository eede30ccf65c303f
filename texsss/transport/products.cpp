// Products of the surface's operators with a few columns of values, stored row by row. Each is a plain loop
// over rows; transposes gather too, or add up in a room of each thread's own, so that the same number of
// threads gives the same bytes. What the arrays hold is said in kernels.py, runs.py, ways.py and gutter.py.

#include <sys/mman.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <thread>
#include <vector>

#if defined(__AVX512F__) && defined(__AVX512VL__)
#include <immintrin.h>
#define MASKED 1
#else
#define MASKED 0
#endif

template <class Work>
static void parallel(int64_t count, int64_t threads, Work work) {
  threads = std::max<int64_t>(1, std::min(threads, count));
  std::vector<std::thread> others;
  for (int64_t t = 1; t < threads; t++)
    others.emplace_back([=] { work(count * t / threads, count * (t + 1) / threads, t); });
  work(0, count / threads, int64_t(0));
  for (auto& other : others) other.join();
}

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

extern "C" {

// Asks for large pages, where the system has some: new memory is dear page by page.
void roomy(float* from, int64_t bytes) {
  const uintptr_t page = 1 << 21;
  const uintptr_t first = (uintptr_t(from) + page - 1) & ~(page - 1), last = (uintptr_t(from) + bytes) & ~(page - 1);
  if (first < last) madvise((void*)first, last - first, MADV_HUGEPAGE);
}

// y = after · W (before · x), W of whole numbers: near entries by their distance in rows, others by their column
void kernel_times(int64_t rows, const int32_t* near, const int16_t* distance, const int16_t* weight,
                  const int32_t* far, const int32_t* column, const int16_t* far_weight, const float* before,
                  const float* after, const float* x, int64_t count, float* scaled, float* y, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last, int64_t) {
    for (int64_t i = first; i < last; i++)
      for (int64_t c = 0; c < count; c++) scaled[i * count + c] = before[i] * x[i * count + c];
  });
  parallel(rows, threads, [=](int64_t first, int64_t last, int64_t) {
    blocks(count, [=](auto columns, int64_t c) {
      typedef typename decltype(columns)::T T;
      const float* in = scaled + c;
      for (int64_t i = first; i < last; i++) {
        T even{}, odd{};
        int64_t p = near[i];
        const int64_t end = near[i + 1];
        const float* here = in + i * count;
        for (; p + 1 < end; p += 2) {
          even += float(weight[p]) * columns.load(here + distance[p] * count);
          odd += float(weight[p + 1]) * columns.load(here + distance[p + 1] * count);
        }
        if (p < end) even += float(weight[p]) * columns.load(here + distance[p] * count);
        for (int64_t q = far[i]; q < far[i + 1]; q++)
          odd += float(far_weight[q]) * columns.load(in + int64_t(column[q]) * count);
        columns.store(y + i * count + c, after[i] * (even + odd));
      }
    });
  });
}

// Row i: taps[b] for every bit b of mask[i], of consecutive rows of x from first[i] on
void runs_times(int64_t rows, const int32_t* first_of, const int32_t* mask, const float* taps, const float* x,
                int64_t pitch, int64_t count, float* y, int64_t y_pitch, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last, int64_t) {
    blocks(count, [=](auto columns, int64_t c) {
      typedef typename decltype(columns)::T T;
      for (int64_t i = first; i < last; i++) {
        T sum{};
        const float* in = x + int64_t(first_of[i]) * pitch + c;
        for (uint32_t left = uint32_t(mask[i]); left; left &= left - 1, in += pitch)
          sum += taps[__builtin_ctz(left)] * columns.load(in);
        columns.store(y + i * y_pitch + c, sum);
      }
    });
  });
}

static inline void corner_weights(const float* beyond, float w[8]) {
  const float x = beyond[0], y = beyond[1], z = beyond[2];
  const float xy[4] = {(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y};
  for (int i = 0; i < 4; i++) w[2 * i] = xy[i] * (1 - z), w[2 * i + 1] = xy[i] * z;
}

// From nodes to points; columns of x are those of all groups
void ways_up(int64_t points, const int32_t* member, const float* beyond, const int32_t* corner, const float* x,
             const int64_t* address, int64_t groups, int64_t each, int64_t pitch, const float* scale,
             int64_t threads) {
  const Groups out{address, groups, each, pitch, points, scale};
  const int64_t count = groups * each;
  parallel(points, threads, [=](int64_t first, int64_t last, int64_t) {
    std::vector<float> row(count + 16);
    for (int64_t i = first; i < last; i++) {
      float w[8];
      corner_weights(beyond + 3 * i, w);
      const int32_t* node = corner + 8 * int64_t(member[i]);
      blocks(count, [&](auto columns, int64_t c) {
        typename decltype(columns)::T sum{};
        for (int k = 0; k < 8; k++) sum += w[k] * columns.load(x + int64_t(node[k]) * count + c);
        columns.store(row.data() + c, sum);
      });
      for (int64_t g = 0; g < groups; g++) {
        const float factor = out.factor(g, i);
        float* to = out.row(g, i);
        for (int64_t c = 0; c < each; c++) to[c] = factor * row[g * each + c];
      }
    }
  });
}

// The transpose: cells in turn, each with its points; `spare` (threads - 1, nodes × columns). Both start at 0.
void ways_down(int64_t points, int64_t cells, const int32_t* start, const int32_t* order, const float* beyond,
               const int32_t* corner, const int64_t* address, int64_t groups, int64_t each, int64_t pitch,
               const float* scale, int64_t nodes, float* y, float* spare, int64_t threads) {
  const Groups in{address, groups, each, pitch, points, scale};
  const int64_t count = groups * each, size = nodes * count;
  parallel(cells, threads, [=](int64_t first, int64_t last, int64_t t) {
    float* to = t ? spare + (t - 1) * size : y;
    std::vector<float> row(count + 16), sums(8 * (count + 16));
    for (int64_t cell = first; cell < last; cell++) {
      std::fill(sums.begin(), sums.end(), 0.0f);
      for (int64_t p = start[cell]; p < start[cell + 1]; p++) {
        const int64_t i = order[p];
        float w[8];
        corner_weights(beyond + 3 * i, w);
        for (int64_t g = 0; g < groups; g++) {
          const float factor = in.factor(g, i);
          const float* from = in.row(g, i);
          for (int64_t c = 0; c < each; c++) row[g * each + c] = factor * from[c];
        }
        blocks(count, [&](auto columns, int64_t c) {
          const auto held = columns.load(row.data() + c);
          for (int k = 0; k < 8; k++) {
            float* sum = sums.data() + k * (count + 16) + c;
            columns.store(sum, columns.load(sum) + w[k] * held);
          }
        });
      }
      const int32_t* node = corner + 8 * cell;
      blocks(count, [&](auto columns, int64_t c) {
        for (int k = 0; k < 8; k++) {
          float* at = to + int64_t(node[k]) * count + c;
          columns.store(at, columns.load(at) + columns.load(sums.data() + k * (count + 16) + c));
        }
      });
    }
  });
  if (threads > 1)
    parallel(size, threads, [=](int64_t first, int64_t last, int64_t) {
      for (int64_t t = 0; t + 1 < threads; t++)
        for (int64_t i = first; i < last; i++) y[i] += spare[t * size + i];
    });
}

// Means of covered rows, `each` columns, put behind them in every group
void gutter_times(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                  const int64_t* address, int64_t groups, int64_t each, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last, int64_t) {
    for (int64_t g = 0; g < groups; g++) {
      float* copy = (float*)address[g];
      blocks(each, [=](auto columns, int64_t c) {
        for (int64_t i = first; i < last; i++) {
          typename decltype(columns)::T sum{};
          for (int64_t p = start[i]; p < start[i + 1]; p++)
            sum += value[p] * columns.load(copy + int64_t(column[p]) * each + c);
          columns.store(copy + (covered + i) * each + c, sum);
        }
      });
    }
  });
}

// The transpose, added to `covered` rows in each group of `to`: a group is one thread's
void gutter_back(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                 const int64_t* from, const int64_t* to, int64_t groups, int64_t each, int64_t threads) {
  parallel(groups, threads, [=](int64_t first, int64_t last, int64_t) {
    for (int64_t g = first; g < last; g++) {
      const float* grad = (const float*)from[g];
      float* sum = (float*)to[g];
      std::memcpy(sum, grad, sizeof(float) * covered * each);
      blocks(each, [=](auto columns, int64_t c) {
        for (int64_t i = 0; i < rows; i++) {
          const auto held = columns.load(grad + (covered + i) * each + c);
          for (int64_t p = start[i]; p < start[i + 1]; p++) {
            float* at = sum + int64_t(column[p]) * each + c;
            columns.store(at, columns.load(at) + value[p] * held);
          }
        }
      });
    }
  });
}
}
