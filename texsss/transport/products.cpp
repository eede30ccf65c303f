// Products of the surface's operators with a few columns of values, stored row by row. Each is a plain loop
// over rows; transposes gather too, or add up in rows of each part's own, so that any number of threads
// gives the same bytes. What the arrays hold is said in kernels.py, bricks.py, ways.py and gutter.py.

#include "bricks.h"
#include "columns.h"
#include "stencil.h"

#ifdef __AVX2__
#include <immintrin.h>
#endif

constexpr int STRIP = 16;  // rows whose entries stand side by side
constexpr int HALF = STRIP / 2;

static inline Eight numbers(const uint8_t* whole) {
#ifdef __AVX2__  // what compilers do not find by themselves
  return (Eight)_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)whole)));
#else
  Eight made;
  for (int k = 0; k < HALF; k++) made[k] = float(whole[k]);
  return made;
#endif
}

// Rows of a strip, times `after`; added to what is there, or not
template <int C>
static inline void put_strip(const Eight sum[C][2], const float* after, int64_t rows, int64_t count, bool added,
                             float* y) {
  float own[C][STRIP];
  std::memcpy(own, sum, sizeof own);
  for (int64_t r = 0; r < rows; r++)
    for (int c = 0; c < C; c++) y[r * count + c] = after[r] * own[c][r] + (added ? y[r * count + c] : 0.0f);
}

static inline void put_four(float* y, Four own, bool added) { stored(y, added ? own + loaded<Four>(y) : own); }

// Three planes of sixteen numbers, in threes
static inline void put_colours(const Eight sum[3][2], const float* after, bool added, float* y) {
  for (int half = 0; half < 2; half++) {
    const Eight scale = loaded<Eight>(after + half * HALF);
    const Eight r = sum[0][half] * scale, g = sum[1][half] * scale, b = sum[2][half] * scale;
    for (int k = 0; k < 2; k++, y += 12) {
      const Four red = k ? high(r) : low(r), green = k ? high(g) : low(g), blue = k ? high(b) : low(b);
      put_four(y, Four{red[0], green[0], blue[0], red[1]}, added);
      put_four(y + 4, Four{green[1], blue[1], red[2], green[2]}, added);
      put_four(y + 8, Four{blue[2], red[3], green[3], blue[3]}, added);
    }
  }
}

template <int C>
static void strips_times(int64_t first, int64_t last, int64_t rows, const int32_t* start, const int32_t* distance,
                         const uint8_t* weight, const float* after, int64_t count, bool added, const float* scaled,
                         int64_t plane, float* y) {
  for (int64_t s = first; s < last; s++) {
    Eight sum[C][2] = {};
    const float* here = scaled + STRIP + s * STRIP;
    for (int64_t p = start[s], end = start[s + 1]; p < end; p++) {
      const Eight w[2] = {numbers(weight + p * STRIP), numbers(weight + p * STRIP + HALF)};
      const float* from = here + distance[p];
      for (int c = 0; c < C; c++)
        for (int half = 0; half < 2; half++) sum[c][half] += w[half] * loaded<Eight>(from + c * plane + half * HALF);
    }
    const int64_t left = std::min<int64_t>(STRIP, rows - s * STRIP);
    float* to = y + s * STRIP * count;
    if constexpr (C == 3)
      if (count == 3 && left == STRIP) {
        put_colours(sum, after + s * STRIP, added, to);
        continue;
      }
    put_strip<C>(sum, after + s * STRIP, left, count, added, to);
  }
}

namespace stencil {

// Loops are functions of their own: what they are given is theirs, and need not be read again after every store.

template <int W, class Own>
__attribute__((noinline)) static void some_up(int64_t first, int64_t last, const Points points, const float* x,
                                              int64_t pitch, const Own own) {
  float w[NODES][SOME];
  for (int64_t i = first; i < last; i++) {
    const int one = int((i - first) % SOME);
    if (one == 0) points.weights(i, w);
    if (i + AHEAD < last) points.ask(i + AHEAD, x, pitch);
    const int32_t* at = points.around(i);
    const uint8_t* place = points.places(i);
    Row<W> even = Row<W>::load(x + at[place[0]] * pitch).times(w[0][one]);
    Row<W> odd = Row<W>::load(x + at[place[1]] * pitch).times(w[1][one]);
    for (int k = 2; k < NODES - 1; k += 2) {
      even.add(w[k][one], Row<W>::load(x + at[place[k]] * pitch));
      odd.add(w[k + 1][one], Row<W>::load(x + at[place[k + 1]] * pitch));
    }
    even.add(w[NODES - 1][one], Row<W>::load(x + at[place[NODES - 1]] * pitch));
    even.add(1.0f, odd);
    own.store(i, even);
  }
}

template <int W, class Own>
__attribute__((noinline)) static void some_down(int64_t first, int64_t last, const Points points, float* y,
                                                int64_t pitch, const Own own) {
  float w[NODES][SOME];
  for (int64_t i = first; i < last; i++) {
    const int one = int((i - first) % SOME);
    if (one == 0) points.weights(i, w);
    if (i + AHEAD < last) points.ask(i + AHEAD, y, pitch);
    const int32_t* at = points.around(i);
    const uint8_t* place = points.places(i);
    const Row<W> held = own.load(i);
    for (int k = 0; k < NODES; k++) {
      float* to = y + at[place[k]] * pitch;
      Row<W> sum = Row<W>::load(to);
      sum.add(w[k][one], held);
      sum.store(to);
    }
  }
}

}  // namespace stencil

// Means of rows of three columns; a fourth number that is read is the next row's
static void colour_means(int64_t first, int64_t last, const int32_t* start, const int32_t* column, const float* value,
                         int64_t covered, const int64_t* address, int64_t groups) {
  for (int64_t g = 0; g < groups; g++)  // one after the other: several would not fit into the cache
    for (int64_t i = first; i < last; i++) {
      float* copy = (float*)address[g];
      if (i + 16 < last)
        for (int64_t p = start[i + 16], end = start[i + 17]; p < end; p++)
          __builtin_prefetch(copy + 3 * int64_t(column[p]));
      Four sum{};
      for (int64_t p = start[i], end = start[i + 1]; p < end; p++)
        sum += value[p] * loaded<Four>(copy + 3 * int64_t(column[p]));
      float* to = copy + 3 * (covered + i);
      for (int c = 0; c < 3; c++) to[c] = sum[c];
    }
}

// The same of one column
static void number_means(int64_t first, int64_t last, const int32_t* start, const int32_t* column, const float* value,
                         int64_t covered, float* copy, int64_t pitch) {
  for (int64_t i = first; i < last; i++) {
    float sum = 0;
    for (int64_t p = start[i], end = start[i + 1]; p < end; p++) sum += value[p] * copy[column[p] * pitch];
    copy[(covered + i) * pitch] = sum;
  }
}

extern "C" {

// Each says whether there was memory for what it needed

// y = after · W (before · x), or added to y; W of whole numbers, by diagonals of STRIP rows. `scaled`: a plane of
// STRIP + rows + STRIP for every column, where before · x goes first unless `x` is null: then it is there. Numbers of
// x are `pitch` and `step` apart; `rim_…`: what its rows get of those behind them, see Rim.
bool kernel_times(int64_t rows, const int32_t* start, const int32_t* distance, const uint8_t* weight,
                  const float* before, const float* after, const float* x, int64_t count, int64_t pitch, int64_t step,
                  const int32_t* rim_start, const int32_t* rim_row, const float* rim_value, float* scaled, float* y,
                  int64_t added, int64_t threads) {
  const int64_t plane = rows + 2 * STRIP, strips = (rows + STRIP - 1) / STRIP;
  const Rim rim{rim_start, rim_row, rim_value, rows};
  const auto scale = [=](int64_t first, int64_t last) {
    for (int64_t c = 0; c < count; c++) {
      const float* from = x + c * step;
      float* to = scaled + c * plane + STRIP;
      if (pitch == 3)  // a constant, for vectors
        for (int64_t i = first; i < last; i++) to[i] = before[i] * from[i * 3];
      else
        for (int64_t i = first; i < last; i++) to[i] = before[i] * from[i * pitch];
      if (first == 0) std::fill(to - STRIP, to, 0.0f);
      if (last == rows) std::fill(to + rows, to + rows + STRIP, 0.0f);
    }
    if (rim.start)
      for (int64_t i = first; i < last; i++)
        rim.give(i, [&](float value, int64_t row) {
          for (int64_t c = 0; c < count; c++)
            scaled[c * plane + STRIP + i] += before[i] * value * x[row * pitch + c * step];
        });
  };
  const auto multiply = [=](int64_t first, int64_t last) {
    if (count == 3)
      return strips_times<3>(first, last, rows, start, distance, weight, after, count, added, scaled, plane, y);
    for (int64_t c = 0; c < count; c++)
      strips_times<1>(first, last, rows, start, distance, weight, after, count, added, scaled + c * plane, plane,
                      y + c);
  };
  return (!x || parallel(rows, threads, scale)) && parallel(strips, threads, multiply);
}

// A convolution along z, y and x of `count` columns of nodes. Turn by turn: from `bricks` to `first`, `second` and
// `bricks` again, which `last` names; `near_…`: the `around` bricks from which each is made; `taps` as in Taps. `even`
// and `odd`: room for the bricks in between. Adds to y where `added`.
bool bricks_times(int64_t all, int64_t first_count, int64_t second_count, int64_t around, int64_t reach, int64_t count,
                  const int32_t* start, const int8_t* place, const int32_t* near_z, const int32_t* near_y,
                  const int32_t* near_x, const int32_t* last_of, const float* padded_taps, float* even, float* odd,
                  const float* x, int64_t pitch, float* y, int64_t y_pitch, int64_t added, int64_t threads) {
  using namespace bricks;
  const int64_t size = count * NODES;
  const Taps taps(padded_taps, reach);
  const auto fill = [=](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) {
      float* to = even + b * size;
      std::fill(to, to + size, 0.0f);
      for (int64_t n = start[b]; n < start[b + 1]; n++)
        for (int64_t c = 0; c < count; c++) to[c * NODES + place[n]] = x[n * pitch + c];
    }
  };
  const auto along_z = [=](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) turned(count, taps, near_z + b * around, even, size, odd + b * size);
  };
  const auto along_y = [=](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) turned(count, taps, near_y + b * around, odd, size, even + b * size);
  };
  const auto along_x = [=](int64_t first, int64_t last) {
    float made[3 * NODES];
    for (int64_t b = first; b < last; b++)
      for (int64_t c = 0; c < count; c += 3) {
        const int64_t some = std::min<int64_t>(3, count - c);
        turned(some, taps, near_x + b * around, even + c * NODES, size, made);
        for (int64_t n = start[last_of[b]]; n < start[last_of[b] + 1]; n++)
          for (int64_t k = 0; k < some; k++) {
            float* to = y + n * y_pitch + c + k;
            *to = made[k * NODES + place[n]] + (added ? *to : 0.0f);
          }
      }
  };
  return parallel(all, threads, fill) && parallel(first_count, threads, along_z) &&
         parallel(second_count, threads, along_y) && parallel(all, threads, along_x);
}

// From nodes to points; columns of x, `x_pitch` floats from row to row, are those of all groups
bool ways_up(int64_t count, const int32_t* cell, const float* beyond, const uint8_t* kind, const uint8_t* table,
             const int32_t* near, const float* x, int64_t x_pitch, const int64_t* address, int64_t groups,
             int64_t each, int64_t pitch, int64_t step, const int64_t* scale, int64_t threads) {
  const Groups out{address, scale, groups, each, pitch, step, Rim{}};
  const stencil::Points points{count, cell, beyond, kind, table, near};
  return parallel(count, threads, [=](int64_t from, int64_t to) {
    laid(out, true, from, to, [=](auto width, int64_t c, int64_t first, int64_t last, const auto& rows) {
      stencil::some_up<decltype(width)::value>(first, last, points, x + c, x_pitch, rows);
    });
  });
}

// The transpose. `nodes` rows of y, which start at 0, and behind them those that several parts of the points, as
// many to each, would add to at once: row `nodes` + i belongs to `twin`[i], in ascending order. `rim_…`: what points
// get of the rows behind them, see Rim.
bool ways_down(int64_t count, int64_t some_points, const int32_t* cell, const float* beyond, const uint8_t* kind,
               const uint8_t* table, const int32_t* near,
               const int64_t* address, int64_t groups, int64_t each, int64_t pitch, int64_t step,
               const int64_t* scale, const int32_t* rim_start, const int32_t* rim_row, const float* rim_value,
               int64_t nodes, int64_t twins, const int32_t* twin, float* y, int64_t y_pitch, int64_t threads) {
  const Groups in{address, scale, groups, each, pitch, step, Rim{rim_start, rim_row, rim_value, count}};
  const stencil::Points points{count, cell, beyond, kind, table, near};
  const auto spread = [=](int64_t from, int64_t to) {
    laid(in, false, from * some_points, std::min(count, to * some_points),
         [=](auto width, int64_t c, int64_t first, int64_t last, const auto& rows) {
           stencil::some_down<decltype(width)::value>(first, last, points, y + c, y_pitch, rows);
         });
  };
  const auto together = [=](int64_t first, int64_t last) {
    while (first > 0 && first < twins && twin[first] == twin[first - 1]) first++;  // others have begun that row
    for (int64_t i = first; i < twins && (i < last || (i > first && twin[i] == twin[i - 1])); i++)
      for (int64_t c = 0; c < y_pitch; c++) y[twin[i] * y_pitch + c] += y[(nodes + i) * y_pitch + c];
  };
  return parallel((count + some_points - 1) / some_points, threads, spread) && parallel(twins, threads, together);
}

// Means of covered rows, `each` columns, put behind them in every group
bool gutter_times(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                  const int64_t* address, int64_t groups, int64_t each, int64_t threads) {
  return parallel(rows, threads, [=](int64_t first, int64_t last) {
    if (each == 3) return colour_means(first, last, start, column, value, covered, address, groups);
    for (int64_t g = 0; g < groups; g++)
      for (int64_t c = 0; c < each; c++)
        number_means(first, last, start, column, value, covered, (float*)address[g] + c, each);
  });
}
}
