// Which points lie within a radius of which, and the weights of Gaussians between them: the loops of
// neighbours.py and smoothing.py, where the formulas stand, without arrays in between.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "lanes.h"
#include "threads.h"

// exp of 0 and less, to 2e-7; loops over it become vectors
static inline float decay(float x) {
  x = x < -80.0f ? -80.0f : x;
  const float turns = x * 1.442695041f - 0.5f;
  const int whole = int(turns);  // towards 0: the nearest whole number, as turns are below 0
  const float rest = (x - whole * 0.693359375f) + whole * 2.12194440e-4f;
  float p = 1.9875691500e-4f;
  p = p * rest + 1.3981999507e-3f;
  p = p * rest + 8.3334519073e-3f;
  p = p * rest + 4.1665795894e-2f;
  p = p * rest + 1.6666665459e-1f;
  p = p * rest + 5.0000001201e-1f;
  p = p * rest * rest + rest + 1.0f;
  const int32_t bits = (whole + 127) << 23;
  float scale;
  std::memcpy(&scale, &bits, 4);
  return p * scale;
}

constexpr int STRIP = 16;  // as in kernels.py

// The distances between the points of some pairs, each once, in the order they were met
struct Distances {
  struct Entry {
    int32_t distance, place;  // -1: not met
  };
  std::vector<Entry> table;
  std::vector<int32_t> used;
  void clear(int64_t most) {
    size_t size = 64;
    while (size < size_t(2 * most)) size *= 2;
    if (table.size() < size)
      table.assign(size, {0, -1});
    else
      for (int32_t slot : used) table[slot].place = -1;
    used.clear();
  }
  // How many were met before this one
  int32_t place(int32_t distance) {
    const size_t mask = table.size() - 1;
    size_t slot = (uint32_t(distance) * 2654435761u >> 7) & mask;
    while (table[slot].place >= 0 && table[slot].distance != distance) slot = (slot + 1) & mask;
    if (table[slot].place < 0) table[slot] = {distance, int32_t(used.size())}, used.push_back(int32_t(slot));
    return table[slot].place;
  }
};

// Points in the order of their voxels' `key`: the runs of those in and around one voxel after the other, ascending.
// `offset`: from a voxel to the `columns` around it, each a run of keys 2·`steps` + 1 long
struct Around {
  const int64_t *key, *end, *offset;
  int64_t columns, steps;
  std::vector<const int64_t*> low, high;
  Around(const int64_t* key, int64_t points, const int64_t* offset, int64_t columns, int64_t steps)
      : key(key), end(key + points), offset(offset), columns(columns), steps(steps) {}
  // How many points are candidates for those of a voxel
  int64_t of(int64_t voxel) {
    const bool begun = !low.empty();
    if (!begun) low.resize(columns), high.resize(columns);
    int64_t candidates = 0;
    for (int64_t c = 0; c < columns; c++) {  // voxels ascend, and so do the ends of ranges
      const int64_t least = voxel + offset[c] - steps, most = voxel + offset[c] + steps;
      if (!begun) {
        low[c] = std::lower_bound(key, end, least);
        high[c] = std::upper_bound(low[c], end, most);
      }
      while (low[c] < end && *low[c] < least) low[c]++;
      while (high[c] < end && *high[c] <= most) high[c]++;
      candidates += high[c] - low[c];
    }
    return candidates;
  }
};

// Where every voxel begins among points that are in their order, and where the last ends
static std::vector<int64_t> voxels_of(const int64_t* key, int64_t points) {
  std::vector<int64_t> voxels;
  for (int64_t i = 0; i < points; i++)
    if (!i || key[i] != key[i - 1]) voxels.push_back(i);
  voxels.push_back(points);
  return voxels;
}

extern "C" {

// Each says whether there was memory for what it needed

// Points in the order of their voxels' `key`; x, y, z are sorted so too, `order` says which each is. `offset`:
// from a voxel to the `columns` around it, each a run of keys 2·`steps` + 1 long. For the points from `begin` to `end`,
// of these those that are `asked` for where that is not null: fills `count`, or, where that is null, `column` and
// `squared` from `start` on. All of these begin with the first such point.
bool pairs(int64_t points, const int64_t* key, const int32_t* order, const float* x, const float* y, const float* z,
           int64_t columns, const int64_t* offset, int64_t steps, float radius_squared, int64_t begin, int64_t end,
           const uint8_t* asked, int32_t* count, const int32_t* start, int32_t* column, float* squared,
           int64_t threads) {
  const auto wanted = [=](int64_t point) {
    return point >= begin && point < end && (!asked || asked[point - begin]);
  };
  std::vector<int64_t> voxels;
  if (!parallel(1, 1, [&](int64_t, int64_t) { voxels = voxels_of(key, points); })) return false;
  return parallel(int64_t(voxels.size()) - 1, threads, [&](int64_t first, int64_t last) {
    Around around(key, points, offset, columns, steps);
    std::vector<int32_t> near;
    std::vector<float> away;
    for (int64_t v = first; v < last; v++) {
      if (std::none_of(order + voxels[v], order + voxels[v + 1], wanted)) continue;
      const int64_t candidates = around.of(key[voxels[v]]);
      const auto &low = around.low, &high = around.high;
      if (int64_t(near.size()) < candidates) near.resize(candidates), away.resize(candidates);
      for (int64_t i = voxels[v]; i < voxels[v + 1]; i++) {
        if (!wanted(order[i])) continue;
        int64_t found = 0;
        if (count) {  // on its own, as it becomes vectors
          for (int64_t c = 0; c < columns; c++)
            for (int64_t j = low[c] - key; j < high[c] - key; j++) {
              const float a = x[j] - x[i], b = y[j] - y[i], d = z[j] - z[i];
              found += a * a + b * b + d * d < radius_squared;
            }
          count[order[i] - begin] = int32_t(found);
          continue;
        }
        for (int64_t c = 0; c < columns; c++)
          for (int64_t j = low[c] - key; j < high[c] - key; j++) {
            const float a = x[j] - x[i], b = y[j] - y[i], d = z[j] - z[i], distance = a * a + b * b + d * d;
            near[found] = int32_t(j), away[found] = distance;
            found += distance < radius_squared;
          }
        const int64_t to = start[order[i] - begin];
        for (int64_t n = 0; n < found; n++) column[to + n] = order[near[n]], squared[to + n] = away[n];
      }
    }
  });
}

// Points as for `pairs`, with their unit normals; all but `order` go on for one vector. `result` (points, 10): how many
// lie within the radius and face the same half-space, then the sums of x, y, z, xx, xy, xz, yy, yz, zz from each point
bool spread(int64_t points, const int64_t* key, const int32_t* order, const float* x, const float* y, const float* z,
            const float* nx, const float* ny, const float* nz, int64_t columns, const int64_t* offset, int64_t steps,
            float radius_squared, float* result, int64_t threads) {
  std::vector<int64_t> voxels;
  if (!parallel(1, 1, [&](int64_t, int64_t) { voxels = voxels_of(key, points); })) return false;
  I lane;
  for (int k = 0; k < WIDTH; k++) lane[k] = k;
  return parallel(int64_t(voxels.size()) - 1, threads, [&](int64_t first, int64_t last) {
    Around around(key, points, offset, columns, steps);
    for (int64_t v = first; v < last; v++) {
      around.of(key[voxels[v]]);
      for (int64_t i = voxels[v]; i < voxels[v + 1]; i++) {
        V sum[10] = {};
        for (int64_t c = 0; c < columns; c++) {
          const int64_t end = around.high[c] - key;
          for (int64_t j = around.low[c] - key; j < end; j += WIDTH) {
            const V a = load(x + j) - x[i], b = load(y + j) - y[i], d = load(z + j) - z[i];
            const V alike = load(nx + j) * nx[i] + load(ny + j) * ny[i] + load(nz + j) * nz[i];
            const I near = a * a + b * b + d * d < all(radius_squared), there = lane < I{} + int32_t(end - j);
            const I counts = near & (alike > V{}) & there;
            const V w = real(-counts), wa = w * a, wb = w * b, wd = w * d;
            sum[0] += w, sum[1] += wa, sum[2] += wb, sum[3] += wd;
            sum[4] += wa * a, sum[5] += wa * b, sum[6] += wa * d, sum[7] += wb * b, sum[8] += wb * d, sum[9] += wd * d;
          }
        }
        for (int s = 0; s < 10; s++) {
          float total = 0;
          for (int k = 0; k < WIDTH; k++) total += sum[s][k];
          result[10 * int64_t(order[i]) + s] = total;
        }
      }
    }
  });
}

// Per row from `begin` to `end` that is `asked` for: the sum of weights, and of weights times squared distances, over
// the pairs that `reach` keeps. All but what points have begin with the first one.
bool moments(int64_t begin, int64_t end, const uint8_t* asked, const int32_t* start, const int32_t* column,
             const float* squared, const float* widest, float reach, const float* sharpness, const float* area,
             float* sum, float* moment, int64_t threads) {
  return parallel(end - begin, threads, [=](int64_t first, int64_t last) {
    std::vector<float> weight;
    for (int64_t i = begin + first; i < begin + last; i++) {
      if (!asked[i - begin]) continue;
      const int64_t from = start[i - begin], n = start[i - begin + 1] - from;
      if (int64_t(weight.size()) < n) weight.resize(n);
      float* w = weight.data();
      const float own = sharpness[i], kept = widest[i];
      for (int64_t k = 0; k < n; k++) {
        const int32_t j = column[from + k];
        const float d = squared[from + k], e = decay(-0.5f * (own + sharpness[j]) * d) * area[j];
        w[k] = (kept + widest[j]) * d < reach ? e : 0.0f;
      }
      float total = 0, second = 0;
      for (int64_t k = 0; k < n; k++) total += w[k], second += w[k] * squared[from + k];
      sum[i - begin] = total, moment[i - begin] = second;
    }
  });
}

// Weights of 0 to `whole` of those pairs, in the rows from `begin`, where a strip begins, to `end`; `from` is theirs.
// Fills the count of diagonals of every strip of rows: distances between points; or, where that is null, entries from
// `start` on (their weights 0 so far) and the `total` of weight × area of each row.
bool entries(int64_t begin, int64_t end, const int32_t* from, const int32_t* point, const float* squared,
             const float* widest, float reach, const float* sharpness, const float* area, float whole,
             int32_t* diagonals, const int32_t* start, int32_t* distance, uint8_t* weight, float* total,
             int64_t threads) {
  const int64_t strips = (end - begin + STRIP - 1) / STRIP;
  return parallel(strips, threads, [=](int64_t first, int64_t last) {
    Distances seen;
    for (int64_t s = first; s < last; s++) {
      const int64_t top = begin + s * STRIP, bottom = std::min(end, top + STRIP);
      seen.clear(from[bottom - begin] - from[top - begin]);
      if (!diagonals) std::fill(total + top - begin, total + bottom - begin, 0.0f);
      for (int64_t i = top; i < bottom; i++)
        for (int64_t k = from[i - begin]; k < from[i - begin + 1]; k++) {
          const int64_t j = point[k];
          if ((widest[i] + widest[j]) * squared[k] >= reach) continue;
          const int32_t place = seen.place(int32_t(j - i));
          if (diagonals) continue;
          const float w = std::floor(whole * decay(-0.5f * (sharpness[i] + sharpness[j]) * squared[k]) + 0.5f);
          total[i - begin] += w * area[j];
          distance[start[s] + place] = int32_t(j - i);
          weight[int64_t(start[s] + place) * STRIP + i - top] = uint8_t(w);
        }
      if (diagonals) diagonals[s] = int32_t(seen.used.size());
    }
  });
}
}
