// Products of the surface's operators with a few columns of values, stored row by row. Each is a plain loop
// over rows; transposes gather too, or add up in rows of each part's own, so that any number of threads
// gives the same bytes. What the arrays hold is said in kernels.py, runs.py, ways.py and gutter.py.

#include "columns.h"

static inline void corner_weights(const float* beyond, float w[8]) {
  const float x = beyond[0], y = beyond[1], z = beyond[2];
  const float xy[4] = {(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y};
  for (int i = 0; i < 4; i++) w[2 * i] = xy[i] * (1 - z), w[2 * i + 1] = xy[i] * z;
}

constexpr int STRIP = 16;  // rows whose entries stand side by side
constexpr int GROUP = 8;   // rows of one length
typedef float Strip __attribute__((vector_size(4 * STRIP)));
typedef int16_t Whole __attribute__((vector_size(2 * STRIP)));

template <int C>
static void strips_times(int64_t first, int64_t last, int64_t rows, int64_t margin, int64_t plane,
                         const int32_t* start, const int32_t* distance, const int16_t* weight, const int32_t* single,
                         const int16_t* lane, const int32_t* column, const int16_t* single_weight, const float* after,
                         int64_t count, const float* scaled, float* y) {
  const float* in = scaled + margin;
  for (int64_t s = first; s < last; s++) {
    Strip sum[C] = {};
    const float* here = in + s * STRIP;
    for (int64_t p = start[s]; p < start[s + 1]; p++) {
      Whole whole;
      std::memcpy(&whole, weight + p * STRIP, sizeof whole);
      const Strip w = __builtin_convertvector(whole, Strip);
      for (int c = 0; c < C; c++) {
        Strip held;
        std::memcpy(&held, here + c * plane + distance[p], sizeof held);
        sum[c] += w * held;
      }
    }
    float own[C][STRIP];
    std::memcpy(own, sum, sizeof own);
    for (int64_t q = single[s]; q < single[s + 1]; q++)
      for (int c = 0; c < C; c++) own[c][lane[q]] += float(single_weight[q]) * in[c * plane + column[q]];
    const int64_t end = std::min<int64_t>(STRIP, rows - s * STRIP);
    for (int64_t r = 0; r < end; r++)
      for (int c = 0; c < C; c++) y[(s * STRIP + r) * count + c] = after[s * STRIP + r] * own[c][r];
  }
}

// The taps whose bits are set, one after the other, and zeros
static inline void packed_taps(uint32_t mask, const float* taps, float* factor) {
#if MASKED
  _mm512_storeu_ps(factor, _mm512_maskz_compress_ps(__mmask16(mask), _mm512_loadu_ps(taps)));
  if (mask >> 16) {
    const int n = __builtin_popcount(mask & 0xffff);
    _mm512_mask_storeu_ps(factor + 16, 0xffff, _mm512_setzero_ps());
    _mm512_mask_storeu_ps(factor + n, __mmask16(0xffff),
                          _mm512_maskz_compress_ps(__mmask16(mask >> 16), _mm512_loadu_ps(taps + 16)));
  } else
    _mm512_storeu_ps(factor + 16, _mm512_setzero_ps());
#else
  std::fill(factor, factor + 32, 0.0f);
  for (int n = 0; mask; mask &= mask - 1) factor[n++] = taps[__builtin_ctz(mask)];
#endif
}

extern "C" {

// y = after · W (before · x), W of whole numbers: by diagonals of STRIP rows, and single entries. `scaled`: a
// plane of `margin` + rows + `margin` + STRIP for every column.
void kernel_times(int64_t rows, int64_t margin, const int32_t* start, const int32_t* distance, const int16_t* weight,
                  const int32_t* single, const int16_t* lane, const int32_t* column, const int16_t* single_weight,
                  const float* before, const float* after, const float* x, int64_t count, float* scaled, float* y,
                  int64_t threads) {
  const int64_t plane = rows + 2 * margin + STRIP, strips = (rows + STRIP - 1) / STRIP;
  parallel(rows, threads, [=](int64_t first, int64_t last) {
    for (int64_t c = 0; c < count; c++) {
      float* to = scaled + c * plane + margin;
      for (int64_t i = first; i < last; i++) to[i] = before[i] * x[i * count + c];
      if (first == 0) std::fill(to - margin, to, 0.0f);
      if (last == rows) std::fill(to + rows, to + rows + margin + STRIP, 0.0f);
    }
  });
  parallel(strips, threads, [=](int64_t first, int64_t last) {
    if (count == 3)
      strips_times<3>(first, last, rows, margin, plane, start, distance, weight, single, lane, column, single_weight,
                      after, count, scaled, y);
    else
      for (int64_t c = 0; c < count; c++)
        strips_times<1>(first, last, rows, margin, plane, start, distance, weight, single, lane, column,
                        single_weight, after, count, scaled + c * plane, y + c);
  });
}

// Row i: taps[b] for every bit b of mask[i], of consecutive ones of the `columns` rows of x from first[i] on
void runs_times(int64_t rows, int64_t columns, const int32_t* first_of, const int32_t* mask, const float* taps,
                const float* x, int64_t pitch, int64_t count, float* y, int64_t y_pitch, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last) {
    blocks(count, [=](auto some, int64_t c) {
      typedef typename decltype(some)::T T;
      float factor[GROUP][32];
      for (int64_t i = first; i < last; i += GROUP) {
        const int rest = int(std::min<int64_t>(GROUP, last - i));
        for (int64_t r = i + 2 * GROUP; r < std::min(i + 3 * GROUP, last); r++) {
          const float* in = x + first_of[r] * pitch + c;
          for (int64_t line = 0; line < 12 * pitch; line += 16) __builtin_prefetch(in + line);
        }
        int most = 0;  // one length for all of a group: where loops end is hard to foretell
        for (int r = 0; r < rest; r++) {
          packed_taps(uint32_t(mask[i + r]), taps, factor[r]);
          most = std::max(most, __builtin_popcount(uint32_t(mask[i + r])));
        }
        int64_t from[GROUP];
        for (int r = 0; r < GROUP; r++) from[r] = first_of[i + std::min(r, rest - 1)];
        const int64_t end = *std::max_element(from, from + GROUP);
        if (rest < GROUP || end + most > columns) {
          for (int r = 0; r < rest; r++) {
            T sum{};
            const float* in = x + from[r] * pitch + c;
            const int length = int(std::min<int64_t>(most, columns - from[r]));
            for (int k = 0; k < length; k++, in += pitch) sum += factor[r][k] * some.load(in);
            some.store(y + (i + r) * y_pitch + c, sum);
          }
          continue;
        }
        T sum[GROUP] = {};  // side by side: each waits for its last product
        const float* in[GROUP];
        for (int r = 0; r < GROUP; r++) in[r] = x + from[r] * pitch + c;
        for (int k = 0; k < most; k++)
          for (int r = 0; r < GROUP; r++) sum[r] += factor[r][k] * some.load(in[r]), in[r] += pitch;
        for (int r = 0; r < GROUP; r++) some.store(y + (i + r) * y_pitch + c, sum[r]);
      }
    });
  });
}

constexpr int AHEAD = 16;  // items of work for which memory is asked beforehand

// Points of one cell follow each other: what its corners hold stays in registers. `begin` (cells + 1): where the
// points of each cell begin in `order`, which says which points these are; `beyond` is in that order.

// From nodes to points; columns of x, `x_pitch` floats from row to row, are those of all groups
void ways_up(int64_t cells, const int32_t* begin, const int32_t* order, const float* beyond, const int32_t* corner,
             const float* x, int64_t x_pitch, const int64_t* address, int64_t groups, int64_t each, int64_t pitch,
             int64_t points, const float* scale, int64_t threads) {
  const Groups out{address, groups, each, pitch, points, scale};
  parallel(cells, threads, [=](int64_t first, int64_t last) {
    blocks(groups * each, [&](auto some, int64_t c) {
      typedef typename decltype(some)::T T;
      const Parts parts(out, c, some.n);
      const int64_t end = begin[last] - 1;
      for (int64_t s = first; s < last; s++) {
        T held[8];
        for (int k = 0; k < 8; k++) held[k] = some.load(x + int64_t(corner[8 * s + k]) * x_pitch + c);
        const int32_t* next = corner + 8 * std::min(s + AHEAD, last - 1);
        for (int k = 0; k < 8; k++) __builtin_prefetch(x + int64_t(next[k]) * x_pitch + c);
        for (int64_t p = begin[s]; p < begin[s + 1]; p++) {
          float w[8];
          corner_weights(beyond + 3 * p, w);
          parts.prefetch(order[std::min(p + AHEAD, end)]);
          T near{}, far{};
          for (int k = 0; k < 4; k++) near += w[k] * held[k], far += w[k + 4] * held[k + 4];
          parts.store(order[p], near + far, some);
        }
      }
    });
  });
}

// The transpose. `nodes` rows of y, which start at 0, and behind them those that several parts of the cells, as
// many to each, would add to at once: row `nodes` + i belongs to `twin`[i].
void ways_down(int64_t cells, int64_t some_cells, const int32_t* begin, const int32_t* order, const float* beyond,
               const int32_t* corner, const int64_t* address, int64_t groups, int64_t each, int64_t pitch,
               int64_t points, const float* scale, int64_t nodes, int64_t twins, const int32_t* twin, float* y,
               int64_t y_pitch, int64_t threads) {
  const Groups in{address, groups, each, pitch, points, scale};
  parallel((cells + some_cells - 1) / some_cells, threads, [=](int64_t first, int64_t last) {
    last = std::min(cells, last * some_cells), first *= some_cells;
    blocks(groups * each, [&](auto some, int64_t c) {
      typedef typename decltype(some)::T T;
      const Parts parts(in, c, some.n);
      const int64_t end = begin[last] - 1;
      for (int64_t s = first; s < last; s++) {
        T sum[8] = {};
        const int32_t* next = corner + 8 * std::min(s + AHEAD, last - 1);
        for (int k = 0; k < 8; k++) __builtin_prefetch(y + int64_t(next[k]) * y_pitch + c, 1);
        for (int64_t p = begin[s]; p < begin[s + 1]; p++) {
          float w[8];
          corner_weights(beyond + 3 * p, w);
          parts.prefetch(order[std::min(p + AHEAD, end)]);
          const T held = parts.load(order[p], some);
          for (int k = 0; k < 8; k++) sum[k] += w[k] * held;
        }
        for (int k = 0; k < 8; k++) {  // whole vectors: what is stored by parts is slow to load again
          float* at = y + int64_t(corner[8 * s + k]) * y_pitch + c;
          T had;
          std::memcpy(&had, at, sizeof had);
          had += sum[k];
          std::memcpy(at, &had, sizeof had);
        }
      }
    });
  });
  for (int64_t i = 0; i < twins; i++)
    for (int64_t c = 0; c < y_pitch; c++) y[twin[i] * y_pitch + c] += y[(nodes + i) * y_pitch + c];
}

// Means of covered rows, `each` columns, put behind them in every group
void gutter_times(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                  const int64_t* address, int64_t groups, int64_t each, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last) {
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
  parallel(groups, threads, [=](int64_t first, int64_t last) {
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
