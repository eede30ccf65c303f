// Rows of a few columns as vectors, and rows of several arrays side by side, for products.cpp.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "threads.h"

typedef float Four __attribute__((vector_size(16)));
typedef float Eight __attribute__((vector_size(32)));

template <class V>
static inline V loaded(const float* from) {
  V v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

template <class V>
static inline void stored(float* to, V v) {
  std::memcpy(to, &v, sizeof v);
}

static inline Four low(Eight v) { return Four{v[0], v[1], v[2], v[3]}; }
static inline Four high(Eight v) { return Four{v[4], v[5], v[6], v[7]}; }
static inline Eight together(Four a, Four b) { return Eight{a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]}; }

// W numbers side by side: 1, 4, 8 or 16
template <int W>
struct Row {
  typedef std::conditional_t<W == 1, float, std::conditional_t<W == 4, Four, Eight>> V;
  static constexpr int EACH = sizeof(V) / 4, PARTS = W / EACH;
  V part[PARTS];
  static Row load(const float* from) {
    Row row;
    for (int k = 0; k < PARTS; k++) row.part[k] = loaded<V>(from + k * EACH);
    return row;
  }
  void store(float* to) const {
    for (int k = 0; k < PARTS; k++) stored(to + k * EACH, part[k]);
  }
  void add(float w, const Row& other) {
    for (int k = 0; k < PARTS; k++) part[k] += w * other.part[k];
  }
  Row times(float w) const {
    Row row;
    for (int k = 0; k < PARTS; k++) row.part[k] = w * part[k];
    return row;
  }
};

// What rows get of others, `beyond` them: of those at `row[start[i]]` to `row[start[i + 1]]`, times `value`. Or nothing
struct Rim {
  const int32_t *start, *row;
  const float* value;
  int64_t beyond;
  template <class Add>
  void give(int64_t i, Add add) const {
    if (!start) return;
    for (int64_t p = start[i], end = start[i + 1]; p < end; p++) add(value[p], beyond + row[p]);
  }
};

// Arrays of `each` columns, `pitch` numbers from row to row and `step` from column to column; `scale`: where the
// factors of every array's rows are, or 0; `rim`: what is added to rows that are loaded, before these
struct Groups {
  const int64_t *address, *scale;
  int64_t count, each, pitch, step;
  Rim rim;
  float* row(int64_t group) const { return (float*)address[group]; }
  const float* scales(int64_t group) const { return scale ? (const float*)scale[group] : nullptr; }
};

// W columns of one array from the `first` on
template <int W>
struct Whole {
  float* row;
  const float* scale;
  int64_t pitch;
  Whole(const Groups& groups, int64_t first)
      : row(groups.row(0) + first), scale(groups.scales(0)), pitch(groups.pitch) {}
  Row<W> load(int64_t i) const {
    const Row<W> own = Row<W>::load(row + i * pitch);
    return scale ? own.times(scale[i]) : own;
  }
  void store(int64_t i, const Row<W>& own) const { (scale ? own.times(scale[i]) : own).store(row + i * pitch); }
};

// At most W columns from the `first` on, number by number
template <int W>
struct Pieces {
  struct Column {
    float* row;
    const float* scale;
  };
  Column columns[W];
  int count;
  int64_t pitch;
  Rim rim;
  Pieces(const Groups& groups, int64_t first)
      : count(int(std::min<int64_t>(W, groups.count * groups.each - first))), pitch(groups.pitch), rim(groups.rim) {
    for (int k = 0; k < count; k++) {
      const int64_t group = (first + k) / groups.each, column = (first + k) % groups.each;
      columns[k] = {groups.row(group) + column * groups.step, groups.scales(group)};
    }
  }
  Row<W> load(int64_t i) const {
    float held[W] = {};
    for (int k = 0; k < count; k++) held[k] = columns[k].row[i * pitch];
    rim.give(i, [&](float value, int64_t row) {
      for (int k = 0; k < count; k++) held[k] += value * columns[k].row[row * pitch];
    });
    for (int k = 0; k < count; k++)
      if (columns[k].scale) held[k] *= columns[k].scale[i];
    return Row<W>::load(held);
  }
  void store(int64_t i, const Row<W>& own) const {
    float held[W];
    own.store(held);
    for (int k = 0; k < count; k++)
      columns[k].row[i * pitch] = columns[k].scale ? columns[k].scale[i] * held[k] : held[k];
  }
};

// One to five arrays of three columns, as colours are; to be written, they are without gaps. There a fourth number is
// read and written behind all rows but the `last`, which is the next row's first: rows are written in ascending order.
template <int COUNT>
struct Colours {
  static constexpr int W = COUNT == 1 ? 4 : COUNT == 2 ? 8 : 16;
  float* row[COUNT];
  const float* scale[COUNT];
  int64_t pitch, step, last;
  Rim rim;
  Colours(const Groups& groups, int64_t last)
      : pitch(groups.pitch), step(groups.step), last(pitch == 3 && step == 1 ? last : -1), rim(groups.rim) {
    for (int g = 0; g < COUNT; g++) row[g] = groups.row(g), scale[g] = groups.scales(g);
  }
  Four three(const float* from) const { return Four{from[0], from[step], from[2 * step], 0.0f}; }
  void put(int64_t i, int g, Four own) const {
    float* to = row[g] + 3 * i;
    if (scale[g]) own *= scale[g][i];
    if (i < last)
      stored(to, own);
    else
      for (int c = 0; c < 3; c++) to[c] = own[c];
  }
  Row<W> load(int64_t i) const {
    Four own[5] = {};
    for (int g = 0; g < COUNT; g++) {
      const float* from = row[g] + pitch * i;
      own[g] = i < last ? loaded<Four>(from) : three(from);
    }
    rim.give(i, [&](float value, int64_t other) {
      for (int g = 0; g < COUNT; g++) own[g] += value * three(row[g] + pitch * other);
    });
    for (int g = 0; g < COUNT; g++)
      if (scale[g]) own[g] *= scale[g][i];
    const auto [a, b, c, d, e] = own;
    // threes without the fourth number
    const Four first = {a[0], a[1], a[2], b[0]}, second = {b[1], b[2], c[0], c[1]};
    const Four third = {c[2], d[0], d[1], d[2]}, fourth = {e[0], e[1], e[2], 0.0f};
    Row<W> all;
    if constexpr (W == 4)
      all.part[0] = first;
    else
      all.part[0] = together(first, second);
    if constexpr (W == 16) all.part[1] = together(third, fourth);
    return all;
  }
  void store(int64_t i, const Row<W>& all) const {
    if constexpr (W == 4) return put(i, 0, all.part[0]);
    if constexpr (W > 4) {
      const Four a = low(all.part[0]), b = high(all.part[0]);
      put(i, 0, a);
      put(i, 1, Four{a[3], b[0], b[1], b[2]});
      if constexpr (W == 16) {
        const Four c = low(all.part[1]), d = high(all.part[1]);
        put(i, 2, Four{b[2], b[3], c[0], c[1]});
        if constexpr (COUNT > 3) put(i, 3, Four{c[1], c[2], c[3], d[0]});
        if constexpr (COUNT > 4) put(i, 4, d);
      }
    }
  }
};

// `work(width, first)` for blocks of columns in vectors of 1, 4, 8 or 16: `width` is a constant
template <class Work>
static void blocks(int64_t columns, Work work) {
  for (int64_t c = 0; c < columns; c += 16) {
    const int64_t left = columns - c;
    if (left == 1)
      work(std::integral_constant<int, 1>(), c);
    else if (left <= 4)
      work(std::integral_constant<int, 4>(), c);
    else if (left <= 8)
      work(std::integral_constant<int, 8>(), c);
    else
      work(std::integral_constant<int, 16>(), c);
  }
}

template <int COUNT, class Work>
static void coloured(const Groups& groups, int64_t first, int64_t last, Work work) {
  typedef Colours<COUNT> Own;
  work(std::integral_constant<int, Own::W>(), int64_t(0), first, last, Own(groups, last - 1));
}

// `work(width, first column, first row, last row, rows)` for blocks of columns of all groups, which are read or written
template <class Work>
static void laid(const Groups& groups, bool written, int64_t first, int64_t last, Work work) {
  const int64_t each = groups.each;
  if (each == 3 && (!written || (groups.pitch == 3 && groups.step == 1))) {
    if (groups.count == 1) return coloured<1>(groups, first, last, work);
    if (groups.count == 2) return coloured<2>(groups, first, last, work);
    if (groups.count == 3) return coloured<3>(groups, first, last, work);
    if (groups.count == 4) return coloured<4>(groups, first, last, work);
    if (groups.count == 5) return coloured<5>(groups, first, last, work);
  }
  const bool one = groups.count == 1 && groups.step == 1 && !groups.rim.start;
  const bool whole = one && (each == 1 || each == 4 || each == 8 || each % 16 == 0);
  blocks(groups.count * each, [&](auto width, int64_t c) {
    constexpr int W = decltype(width)::value;
    if (whole)
      work(width, c, first, last, Whole<W>(groups, c));
    else
      work(width, c, first, last, Pieces<W>(groups, c));
  });
}
