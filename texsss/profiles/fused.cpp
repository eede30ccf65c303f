// Weights of the layered models, block by block of columns (channels of rows): profiles at all frequencies, and
// their projection, never leave the first cache. Formulas and their sources stand in layered_diffusion.py,
// layered_sp3.py and what these use; names are the same.

#include "diffusion.h"
#include "even.h"
#include "four_streams.h"
#include "once.h"
#include "sweep.h"

constexpr float FEW = 1e-6f;
constexpr float MOST[2] = {3, 1.5f}, SMOOTH = 0.1f, FADED = 0.01f, LEAST = 1e-12f;  // of led_out.py
constexpr int TOGETHER = 2;  // frequencies, or terms, side by side

// What is asked, in the order of fused.py; `numbers` follow as read in Asked
struct Header {
  int32_t sp3, layers, channels, endless, below, once, twice, deflected, marched, finer, exits, sets, terms, frequencies;
};

struct Asked {
  Header h;
  std::vector<double> etas;
  const double* outlets;  // admittances of a face of every layer
  Direction directions[BEAMS], level[BEAMS];
  std::vector<Direction> finer;
  std::vector<Exit> exits[2], straight;  // as seen from above, and from below
  const Parameters* sets[2];
  const Fadings* fadings;  // of the top and of the bottom
  const Streams* streams;
  float aligned;

  Asked(const Header& header, const double* numbers) : h(header) {
    auto next = [&](size_t count) {
      const double* here = numbers;
      numbers += count;
      return here;
    };
    const double* given = next(h.layers);
    etas.assign(given, given + h.layers);
    outlets = next(h.layers);
    auto read = [&](Direction& direction) {
      const double* from = next(4);
      direction.share = float(from[1]), direction.top = float(from[2]), direction.bottom = float(from[3]);
      for (double eta : etas) direction.cosines.push_back(float(refracted(from[0], etas[0], eta)));
    };
    for (Direction& direction : directions) read(direction);
    finer.resize(h.finer);
    for (Direction& direction : finer) read(direction);
    // for the march all is of one index, and nothing mirrors
    const std::vector<double> outer(h.layers, etas[0]);
    for (int j = 0; j < BEAMS; j++)
      level[j] = {directions[j].share, 0, 0, std::vector<float>(h.layers, directions[j].cosines[0])};
    for (int side = 0; side < 2; side++) {
      std::vector<double> seen = etas;
      if (side) seen.assign(etas.rbegin(), etas.rend());
      for (int i = 0; i < h.exits; i++) {
        const double* from = next(4);
        exits[side].push_back(exit_at(from[0], from[1], from[2], from[3], seen));
        if (h.marched && side == 0) straight.push_back(exit_at(from[0], from[1], 0, 0, outer));
      }
      sets[side] = (const Parameters*)next(31 * h.sets);
    }
    if (h.sp3) fadings = (const Fadings*)next(12);
    if (h.deflected) streams = (const Streams*)next(14), aligned = float(*next(1));
  }
};

struct Solver {
  const Asked& asked;
  const Header& h;
  const bool endless;
  Diffusion diffusion;
  Once reduced, truly, nearly, marched;
  White white;
  std::vector<Sweep> sweeps, others;
  Layers layers, below, pale, unreduced, peaked;  // from the surface inwards, from below; without absorption; in truth
  Lights lights, beneath, shining, unreduced_lights, peaked_lights, level;
  FourStreams four;
  const bool mirroring;
  Even even, pale_even;
  V factor, passed;  // of multiple scattering, and of all on its way through
  V scale, most;     // of led_out.py
  V first;              // what scatters once,
  Sweep::Orders still;  // and what modes make of light, where s = 0: if anything scatters twice
  Ways ways;  // of light that enters from all around

  explicit Solver(const Asked& a) : asked(a), h(a.h), endless(a.h.endless), sweeps(a.h.sets), others(a.h.sets), mirroring(Even::holds(endless, a.etas)) {}

  // Of `layers`, which are given; their g still tells of the true coefficients
  void prepare() {
    light_in(layers, endless, asked.directions, lights, asked.finer);
    if (h.below) turned(layers, lights, below, beneath);
    const Layers& seen = h.below ? below : layers;
    const Lights& falling = h.below ? beneath : lights;
    if (!h.sp3) {
      diffusion.prepare(seen, falling, endless);
      return;
    }
    reduced.prepare(seen, falling, endless, asked.exits[h.below], false, !h.below);
    if (BEAMS > 1) ways.find(layers, false, !endless);
    passed = all(1);
    if (h.deflected && (!h.below || !h.twice)) prepare_truly();
    if (h.marched) {
      const Layers& seen = h.deflected ? unreduced : layers;
      light_in(seen, endless, asked.level, level);
      marched.prepare(seen, level, endless, asked.straight, h.deflected, true, false);
    }
    if (!h.twice) return;
    for (int i = 0; i < h.sets; i++) prepare(sweeps[i], seen, falling, h.below, i);
    if (mirroring) even.prepare(layers, asked.finer, asked.exits[0]);
    factor = furnace();
    still = by_modes(sweeps, 0), first = reduced.at(0);
    V more = factor * and_evenly(still.twice, even, 0);
    scale = (still.once + LEAST) * inverse(first + LEAST), most = all(MOST[h.below]);
    if (!h.deflected) return;
    most = 1 + (MOST[h.below] - 1) * across(seen);
    V handed = four.lacking(layers, endless, h.below, asked.directions, asked.finer, *asked.streams);
    if (h.below)
      passed = positive(1 + handed / (more + first + FEW));
    else
      factor *= positive(1 + (handed + first - nearly.at(0)) / (more + 1e-20f));
  }

  void prepare(Sweep& sweep, const Layers& seen, const Lights& falling, int side, int set) const {
    sweep.prepare(seen, falling, endless, asked.sets[side][set], asked.fadings[side], asked.fadings[1 - side]);
  }

  void prepare_truly() {
    unreduced = layers;
    for (Layer& layer : unreduced)
      layer = layer_of(layer.sigma_a, layer.sigma_s / (1 - layer.g), layer.g, layer.d, layer.index);
    if (h.twice) prepare_nearly();
    if (h.twice && h.once) return;
    light_in(unreduced, endless, asked.directions, unreduced_lights, asked.finer);
    if (h.below) {
      const Layers from = unreduced;
      const Lights light = unreduced_lights;
      turned(from, light, unreduced, unreduced_lights);
    }
    truly.prepare(unreduced, unreduced_lights, endless, asked.exits[h.below], true, !h.below);
  }

  // nearly.py
  void prepare_nearly() {
    peaked = unreduced;
    for (Layer& layer : peaked) {
      V forwards = positive(layer.g), straight = asked.aligned * forwards * forwards * forwards, less = layer.sigma_s * straight;
      layer.sigma_s -= less, layer.sigma -= less, layer.g = (layer.g - straight) * inverse(1 - straight);
    }
    light_in(peaked, endless, asked.directions, peaked_lights, asked.finer);
    nearly.prepare(peaked, peaked_lights, endless, asked.exits[0], true, true);
  }

  static Sweep::Orders by_modes(const std::vector<Sweep>& sweeps, float s) {
    Sweep::Orders found = {V{}, V{}};
    for (const Sweep& sweep : sweeps) {
      const Sweep::Orders own = sweep.at(s);
      found.once += own.once, found.twice += own.twice;
    }
    return found;
  }

  V and_evenly(V twice, const Even& even, float s) const {
    return mirroring && even.thin ? twice * even.rest + even.at(s) : twice;
  }

  // What scatters again, of which `once` does only once, and `entered` through films
  V scattered_more(V once, V entered, float s) const {
    const Sweep::Orders found = s == 0 ? still : by_modes(sweeps, s);
    return and_evenly(led_out(entered * found.twice, entered * found.once, scale * once), even, s);
  }

  // led_out.py: by how much it knows the way out of layers that scatter forwards, and what leaves
  V across(const Layers& seen) const {
    const std::vector<V>& shares = sweeps[0].near.ways.shares;
    V total = {};
    for (int k = 0; k < h.layers; k++) {
      const V own = 1 - seen[k].g * seen[k].g;
      total += (h.layers > 1 ? shares[k] : all(1)) * own * own;
    }
    return total;
  }

  V led_out(V twice, V own, V once) const {
    once += root(once * once + (own * own * (SMOOTH * SMOOTH) + TINY));
    own *= 1 + std::sqrt(1 + SMOOTH * SMOOTH);
    const V rest = twice * FADED + LEAST;
    return twice * (own + most * once + rest) * inverse(most * own + once + rest);
  }

  // What multiple scattering lacks for the same stack without absorption to return all light
  V furnace() {
    V lacking = extinguished(layers, endless, asked.finer), have = {};
    for (int side = 0; side < (endless ? 1 : 2); side++) {
      if (side) {
        turned(layers, lights, pale, shining);
      } else {
        pale = layers, shining = lights;
      }
      for (int k = 0; k < h.layers; k++) {
        Layer& layer = pale[k];
        layer.sigma_a = V{}, layer.sigma_s = layer.sigma;
        for (int j = 0; j < BEAMS; j++) {
          Light& light = shining[k * BEAMS + j];
          light.source = layer.sigma * light.share * (1 / light.cosine);
        }
      }
      lacking -= white.all_of(pale, shining, endless, asked.exits[side]);
      for (int i = 0; i < h.sets; i++) prepare(others[i], pale, shining, side, i);
      if (mirroring && !side) pale_even.prepare(pale, asked.finer, asked.exits[0]);
      have += and_evenly(by_modes(others, 0).twice, pale_even, 0);
    }
    return greater(lesser((lacking + FEW) * inverse(have + FEW), all(2)), all(0.5f));
  }

  void spectrum(const float* s, V* result) const {
    int i = 0;
    if (!h.sp3)
      for (; i + TOGETHER <= h.frequencies; i += TOGETHER) diffusion.at<TOGETHER>(s + i, result + i);
    for (; i < h.frequencies; i++)
      if (h.sp3)
        result[i] = at(s[i]);
      else
        diffusion.at<1>(s + i, result + i);
  }

  V at(float s) const {
    const bool unlike = h.deflected && (!h.below || !h.twice);
    V once = {}, total = {};
    if (h.twice || !unlike) once = h.twice && s == 0 ? first : reduced.at(s);
    if (unlike && h.twice)
      total = h.once ? nearly.at(s) : nearly.at(s) - truly.at(s);
    else if (h.once)
      total = unlike ? truly.at(s) : once;
    const bool films = BEAMS > 1 && h.layers > 1;
    const Fading& entering = asked.fadings[0].leaving;
    if (h.twice) total += factor * scattered_more(once, films && !h.below ? ways.there_and_back(entering, s) : all(1), s);
    total *= passed;
    if (h.marched) total -= marched.at(s);
    return films && h.below ? total * ways.one_way(entering, s) : total;
  }
};

// Rows `first` … `last`: `result` (rows, terms, channels) is `matrix` (terms, frequencies) times the profile at `s`.
// `fields`: sigma_a, sigma_s, g and thickness at rows, layers and channels, by their `strides`.
static void solve(const Header* header, const double* numbers, const float* const* fields, const int64_t* strides,
                  const float* s, const float* matrix, int64_t first, int64_t last, float* result) {
  const Asked asked(*header, numbers);
  const Header& h = asked.h;
  const int C = h.channels;
  Solver solver(asked);
  solver.layers.resize(h.layers);
  std::vector<V> spectrum(h.frequencies);
  for (int64_t block = first * C; block < last * C; block += WIDTH) {
    const int lanes = int(last * C - block < WIDTH ? last * C - block : WIDTH);
    const int64_t start = block / C;
    int row = 0, channel = int(block - start * C), to[WIDTH];
    I rows = {}, channels = {}, from[4];
    for (int i = 0; i < WIDTH; i++) {
      rows[i] = row, channels[i] = channel, to[i] = row * h.terms * C + channel;
      if (i + 1 < lanes && ++channel == C) channel = 0, row++;  // the last column again where there are no more
    }
    for (int f = 0; f < 4; f++) from[f] = rows * int(strides[3 * f]) + channels * int(strides[3 * f + 2]);
    for (int k = 0; k < h.layers; k++) {
      V found[4];
      for (int f = 0; f < 4; f++) {
        const float* first = fields[f] + start * strides[3 * f] + k * strides[3 * f + 1];
        found[f] = (V)gathered((const int32_t*)first, from[f]);
      }
      solver.layers[k] = layer_of(found[0], found[1] * (1 - found[2]), found[2], found[3], {asked.etas[k], asked.outlets[k]});
    }
    solver.prepare();
    solver.spectrum(s, spectrum.data());
    for (int t = 0; t < h.terms; t += TOGETHER) {
      const int some = h.terms - t < TOGETHER ? h.terms - t : TOGETHER;
      V total[TOGETHER] = {};
      const float* by[TOGETHER];
      for (int u = 0; u < TOGETHER; u++) by[u] = matrix + (t + (u < some ? u : 0)) * h.frequencies;
      for (int i = 0; i < h.frequencies; i++)
        for (int u = 0; u < TOGETHER; u++) total[u] += by[u][i] * spectrum[i];
      for (int u = 0; u < some; u++) {
        float made[WIDTH];
        std::memcpy(made, &total[u], sizeof made);
        for (int i = 0; i < lanes; i++) result[(start * h.terms + t + u) * C + to[i]] = made[i];
      }
    }
  }
}

// Whether there was memory for what it holds
extern "C" bool weigh(const Header* header, const double* numbers, const float* const* fields, const int64_t* strides,
                      const float* s, const float* matrix, int64_t first, int64_t last, float* result) {
#if defined(__SSE__)
  const unsigned state = __builtin_ia32_stmxcsr();
  __builtin_ia32_ldmxcsr(state | 0x8040);  // denormal numbers are 0: they take a hundred times longer
#endif
  const bool done = enough([&] { solve(header, numbers, fields, strides, s, matrix, first, last, result); });
#if defined(__SSE__)
  __builtin_ia32_ldmxcsr(state);
#endif
  return done;
}
