// Products of the surface's operators with a few columns of values, stored row by row. Each is a plain loop
// over rows; transposes gather too, or add up in rows of each part's own, so that any number of threads
// gives the same bytes. What the arrays hold is said in kernels.py, bricks.py, ways.py and gutter.py.

#include "bricks.h"
#include "columns.h"

static inline void corner_weights(const float* beyond, float w[8]) {
  const float x = beyond[0], y = beyond[1], z = beyond[2];
  const float xy[4] = {(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y};
  for (int i = 0; i < 4; i++) w[2 * i] = xy[i] * (1 - z), w[2 * i + 1] = xy[i] * z;
}

constexpr int STRIP = 16;  // rows whose entries stand side by side
typedef float Strip __attribute__((vector_size(4 * STRIP)));

static inline Strip numbers(const uint8_t* whole) {
#if MASKED
  return (Strip)_mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i*)whole)));
#else
  Strip made;
  for (int k = 0; k < STRIP; k++) made[k] = float(whole[k]);
  return made;
#endif
}

// Rows of a strip, times `after`; added to what is there, or not
template <int C>
static inline void put_strip(const Strip sum[C], const float* after, int64_t rows, int64_t count, bool added,
                             float* y) {
  float own[C][STRIP];
  std::memcpy(own, sum, sizeof own);
  for (int64_t r = 0; r < rows; r++)
    for (int c = 0; c < C; c++) y[r * count + c] = after[r] * own[c][r] + (added ? y[r * count + c] : 0.0f);
}

#if MASKED
// Three planes of sixteen numbers, in threes
static inline void put_colours(const Strip sum[3], const float* after, bool added, float* y) {
  alignas(64) static const int32_t FIRST[3][16] = {{0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5},
                                                   {21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26},
                                                   {0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0}};
  alignas(64) static const int32_t THIRD[3][16] = {{0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15},
                                                   {0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15},
                                                   {26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31}};
  const __m512 scale = _mm512_loadu_ps(after);
  __m512 held[3];
  for (int c = 0; c < 3; c++) held[c] = _mm512_mul_ps((__m512)sum[c], scale);
  for (int k = 0; k < 3; k++) {
    const __m512 two = _mm512_permutex2var_ps(held[0], _mm512_load_si512(FIRST[k]), held[1]);
    const __m512 all = _mm512_permutex2var_ps(two, _mm512_load_si512(THIRD[k]), held[2]);
    _mm512_storeu_ps(y + k * STRIP, added ? _mm512_add_ps(all, _mm512_loadu_ps(y + k * STRIP)) : all);
  }
}
#endif

template <int C>
static void strips_times(int64_t first, int64_t last, int64_t rows, const int32_t* start, const int32_t* distance,
                         const uint8_t* weight, const float* after, int64_t count, bool added, const float* scaled,
                         int64_t plane, float* y) {
  for (int64_t s = first; s < last; s++) {
    Strip sum[C] = {};
    const float* here = scaled + STRIP + s * STRIP;
    for (int64_t p = start[s], end = start[s + 1]; p < end; p++) {
      const Strip w = numbers(weight + p * STRIP);
      for (int c = 0; c < C; c++) {
        Strip held;
        std::memcpy(&held, here + c * plane + distance[p], sizeof held);
        sum[c] += w * held;
      }
    }
    const int64_t left = std::min<int64_t>(STRIP, rows - s * STRIP);
    float* to = y + s * STRIP * count;
#if MASKED
    if (C == 3 && count == 3 && left == STRIP) {
      put_colours(sum, after + s * STRIP, added, to);
      continue;
    }
#endif
    put_strip<C>(sum, after + s * STRIP, left, count, added, to);
  }
}

constexpr int AHEAD = 16;  // points for which memory is asked beforehand

// Points stand in `cell`s, `beyond` the first of the nodes at their corners. Loops are functions of their own: what
// they are given is theirs, and need not be read again after every store.

// Asks for what the corners of a point's cell hold, unless the one before has asked
static inline void ask(int64_t i, const int32_t* cell, const int32_t* corner, const float* x, int64_t pitch) {
  if (cell[i] == cell[i - 1]) return;
  const int32_t* at = corner + 8 * int64_t(cell[i]);
  for (int k = 0; k < 8; k++) __builtin_prefetch(x + at[k] * pitch);
}

template <class Some, class Own>
static void some_up(int64_t first, int64_t last, const int32_t* cell, const float* beyond, const int32_t* corner,
                    const float* x, int64_t pitch, const Some some, const Own& own) {
  typedef typename Some::T T;
  const Own parts = own;
  for (int64_t i = first; i < last; i++) {
    if (i + AHEAD < last) ask(i + AHEAD, cell, corner, x, pitch);
    const int32_t* at = corner + 8 * int64_t(cell[i]);
    float w[8];
    corner_weights(beyond + 3 * i, w);
    T near{}, far{};
    for (int k = 0; k < 4; k++) {
      near += w[k] * some.load(x + at[k] * pitch);
      far += w[k + 4] * some.load(x + at[k + 4] * pitch);
    }
    parts.store(i, near + far, some);
  }
}

template <class Some, class Own>
static void some_down(int64_t first, int64_t last, const int32_t* cell, const float* beyond, const int32_t* corner,
                      float* y, int64_t pitch, const Some some, const Own& own) {
  typedef typename Some::T T;
  const Own parts = own;
  for (int64_t i = first; i < last; i++) {
    if (i + AHEAD < last) ask(i + AHEAD, cell, corner, y, pitch);
    const int32_t* at = corner + 8 * int64_t(cell[i]);
    float w[8];
    corner_weights(beyond + 3 * i, w);
    const T held = parts.load(i, some);
    for (int k = 0; k < 8; k++) {  // whole vectors: what is stored by parts is slow to load again
      float* to = y + at[k] * pitch;
      T sum;
      std::memcpy(&sum, to, sizeof sum);
      sum += w[k] * held;
      std::memcpy(to, &sum, sizeof sum);
    }
  }
}

template <class Some>
static void some_means(int64_t first, int64_t last, const int32_t* start, const int32_t* column, const float* value,
                       int64_t covered, float* copy, int64_t pitch, const Some some) {
  for (int64_t i = first; i < last; i++) {
    typename Some::T sum{};
    for (int64_t p = start[i], end = start[i + 1]; p < end; p++) {
      __builtin_prefetch(copy + int64_t(column[p + AHEAD < start[last] ? p + AHEAD : p]) * pitch);
      sum += value[p] * some.load(copy + int64_t(column[p]) * pitch);
    }
    some.store(copy + (covered + i) * pitch, sum);
  }
}

// Number by number: vectors stored in part would have to wait until they can be loaded again
template <int C>
static void sent_back(int64_t rows, const int32_t* start, const int32_t* column, const float* value, const float* grad,
                      int64_t row_step, int64_t step, float* sum, int64_t pitch) {
  for (int64_t i = 0; i < rows; i++) {
    float held[C];
    for (int c = 0; c < C; c++) held[c] = grad[i * row_step + c * step];
    for (int64_t p = start[i], end = start[i + 1]; p < end; p++) {
      __builtin_prefetch(sum + int64_t(column[p + AHEAD < start[rows] ? p + AHEAD : p]) * pitch, 1);
      float* at = sum + int64_t(column[p]) * pitch;
      const float w = value[p];
      for (int c = 0; c < C; c++) at[c] += w * held[c];
    }
  }
}

extern "C" {

// y = after · W (before · x), or added to y; W of whole numbers, by diagonals of STRIP rows. `scaled`: a plane of
// STRIP + rows + STRIP for every column, where before · x goes first unless `x` is null: then it is there.
void kernel_times(int64_t rows, const int32_t* start, const int32_t* distance, const uint8_t* weight,
                  const float* before, const float* after, const float* x, int64_t count, float* scaled, float* y,
                  int64_t added, int64_t threads) {
  const int64_t plane = rows + 2 * STRIP, strips = (rows + STRIP - 1) / STRIP;
  if (x)
    parallel(rows, threads, [=](int64_t first, int64_t last) {
      for (int64_t c = 0; c < count; c++) {
        float* to = scaled + c * plane + STRIP;
        for (int64_t i = first; i < last; i++) to[i] = before[i] * x[i * count + c];
        if (first == 0) std::fill(to - STRIP, to, 0.0f);
        if (last == rows) std::fill(to + rows, to + rows + STRIP, 0.0f);
      }
    });
  parallel(strips, threads, [=](int64_t first, int64_t last) {
    if (count == 3)
      strips_times<3>(first, last, rows, start, distance, weight, after, count, added, scaled, plane, y);
    else
      for (int64_t c = 0; c < count; c++)
        strips_times<1>(first, last, rows, start, distance, weight, after, count, added, scaled + c * plane, plane,
                        y + c);
  });
}

// A convolution along z, y and x of `count` columns of nodes. Turn by turn: from `bricks` to `first`, `second` and
// `bricks` again, which `last` names; `near_…`: the `around` bricks from which each is made. `even` and `odd`: room
// for the bricks in between. Adds to y where `added`.
void bricks_times(int64_t all, int64_t first_count, int64_t second_count, int64_t around, int64_t reach, int64_t count,
                  const int32_t* start, const int8_t* place, const int32_t* near_z, const int32_t* near_y,
                  const int32_t* near_x, const int32_t* last_of, const float* some_taps, float* even, float* odd,
                  const float* x, int64_t pitch, float* y, int64_t y_pitch, int64_t added, int64_t threads) {
  using namespace bricks;
  const int64_t size = count * NODES;
  const Taps taps(some_taps, reach);
  parallel(all, threads, [=](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) {
      float* to = even + b * size;
      std::fill(to, to + size, 0.0f);
      for (int64_t n = start[b]; n < start[b + 1]; n++)
        for (int64_t c = 0; c < count; c++) to[c * NODES + place[n]] = x[n * pitch + c];
    }
  });
  parallel(first_count, threads, [=, &taps](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) turned(count, taps, near_z + b * around, even, odd + b * size);
  });
  parallel(second_count, threads, [=, &taps](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; b++) turned(count, taps, near_y + b * around, odd, even + b * size);
  });
  parallel(all, threads, [=, &taps](int64_t first, int64_t last) {
    std::vector<float> made(size);
    for (int64_t b = first; b < last; b++) {
      turned(count, taps, near_x + b * around, even, made.data());
      for (int64_t n = start[last_of[b]]; n < start[last_of[b] + 1]; n++)
        for (int64_t c = 0; c < count; c++) {
          float* to = y + n * y_pitch + c;
          *to = made[c * NODES + place[n]] + (added ? *to : 0.0f);
        }
    }
  });
}

// From nodes to points; columns of x, `x_pitch` floats from row to row, are those of all groups
void ways_up(int64_t count, const int32_t* cell, const float* beyond, const int32_t* corner, const float* x,
             int64_t x_pitch, const int64_t* address, int64_t groups, int64_t each, int64_t pitch, const float* scale,
             int64_t threads) {
  const Groups out{address, groups, each, pitch, count, scale};
  parallel(count, threads, [=](int64_t first, int64_t last) {
    laid(out, [=](auto some, int64_t c, const auto& parts) {
      some_up(first, last, cell, beyond, corner, x + c, x_pitch, some, parts);
    });
  });
}

// The transpose. `nodes` rows of y, which start at 0, and behind them those that several parts of the points, as
// many to each, would add to at once: row `nodes` + i belongs to `twin`[i].
void ways_down(int64_t count, int64_t some_points, const int32_t* cell, const float* beyond, const int32_t* corner,
               const int64_t* address, int64_t groups, int64_t each, int64_t pitch, const float* scale, int64_t nodes,
               int64_t twins, const int32_t* twin, float* y, int64_t y_pitch, int64_t threads) {
  const Groups in{address, groups, each, pitch, count, scale};
  parallel((count + some_points - 1) / some_points, threads, [=](int64_t first, int64_t last) {
    last = std::min(count, last * some_points), first *= some_points;
    laid(in, [=](auto some, int64_t c, const auto& parts) {
      some_down(first, last, cell, beyond, corner, y + c, y_pitch, some, parts);
    });
  });
  for (int64_t i = 0; i < twins; i++)
    for (int64_t c = 0; c < y_pitch; c++) y[twin[i] * y_pitch + c] += y[(nodes + i) * y_pitch + c];
}

// Means of covered rows, `each` columns, put behind them in every group
void gutter_times(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                  const int64_t* address, int64_t groups, int64_t each, int64_t threads) {
  parallel(rows, threads, [=](int64_t first, int64_t last) {
    for (int64_t g = 0; g < groups; g++)
      blocks(each, [=](auto some, int64_t c) {
        some_means(first, last, start, column, value, covered, (float*)address[g] + c, each, some);
      });
  });
}

// The transpose, added to `covered` rows in each group of `to`: a group is one thread's. Numbers of `from` are
// `row_step` and `step` apart.
void gutter_back(int64_t rows, const int32_t* start, const int32_t* column, const float* value, int64_t covered,
                 const int64_t* from, int64_t row_step, int64_t step, const int64_t* to, int64_t groups, int64_t each,
                 int64_t threads) {
  parallel(groups, threads, [=](int64_t first, int64_t last) {
    for (int64_t g = first; g < last; g++) {
      const float* grad = (const float*)from[g];
      float* sum = (float*)to[g];
      if (step == 1 && row_step == each)
        std::memcpy(sum, grad, sizeof(float) * covered * each);
      else
        for (int64_t i = 0; i < covered; i++)
          for (int64_t c = 0; c < each; c++) sum[i * each + c] = grad[i * row_step + c * step];
      if (each == 3)
        sent_back<3>(rows, start, column, value, grad + covered * row_step, row_step, step, sum, each);
      else
        for (int64_t c = 0; c < each; c++)
          sent_back<1>(rows, start, column, value, grad + covered * row_step + c * step, row_step, step, sum + c, each);
    }
  });
}
}
