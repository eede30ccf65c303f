// Weights of the layered models, block by block of columns (channels of rows): profiles at all frequencies, and
// their projection, never leave the first cache. Formulas and their sources stand in layered_diffusion.py,
// layered_sp3.py and what these use; names are the same.

#include "diffusion.h"
#include "once.h"
#include "sweep.h"

constexpr float DETOUR = 2, FEW = 1e-6f;

// What is asked, in the order of fused.py; `numbers` follow as read in Asked
struct Header {
  int32_t sp3, layers, channels, endless, below, once, twice, deflected, directions, exits, sets, terms, frequencies;
};

struct Asked {
  Header h;
  const double* eta;
  const Direction* directions;
  const double* ends;
  const Exit* exits[2];
  const Parameters* sets[2];

  Asked(const Header& header, const double* numbers) : h(header) {
    auto next = [&](size_t count) {
      const double* here = numbers;
      numbers += count;
      return here;
    };
    eta = next(h.layers);
    directions = (const Direction*)next(4 * h.directions);
    ends = next(2);
    for (int side = 0; side < 2; side++) {
      exits[side] = (const Exit*)next(4 * h.exits);
      sets[side] = (const Parameters*)next(31 * h.sets);
    }
  }
};

struct Stack {
  Layers layers, white, turned_layers;
  Lights lights, lit, turned_lights;
};

struct Solver {
  const Asked& asked;
  Diffusion diffusion;
  Once reduced, truly, helper;
  std::vector<Sweep> sweeps, others;
  Stack stack;
  Layers unreduced;
  Lights unreduced_lights;
  V factor;

  explicit Solver(const Asked& a) : asked(a), sweeps(a.h.sets), others(a.h.sets) {}

  // `stack.layers` from the surface inwards are given; `g` still tells of the true coefficients
  void prepare() {
    const Header& h = asked.h;
    const bool endless = h.endless;
    light_in(stack.layers, endless, asked.directions, h.directions, stack.lights);
    const Layers* layers = &stack.layers;
    const Lights* lights = &stack.lights;
    if (h.below) {
      turned(stack.layers, stack.lights, h.directions, stack.turned_layers, stack.turned_lights);
      layers = &stack.turned_layers, lights = &stack.turned_lights;
    }
    if (!h.sp3) {
      diffusion.prepare(*layers, *lights, endless, asked.ends);
      return;
    }
    const Exit* exits = asked.exits[h.below];
    if (h.once || h.deflected) reduced.prepare(*layers, *lights, h.directions, endless, exits, h.exits, false);
    if (h.deflected) prepare_truly(exits);
    if (!h.twice) return;
    for (int i = 0; i < h.sets; i++)
      sweeps[i].prepare(*layers, *lights, h.directions, endless, asked.sets[h.below][i]);
    factor = furnace();
    if (!h.deflected) return;
    V more = factor * swept(sweeps, 0), handed = survival() * (reduced.at(0) - truly.at(0));
    factor *= positive(1 + handed / (more + 1e-20f));
  }

  void prepare_truly(const Exit* exits) {
    const Header& h = asked.h;
    unreduced = stack.layers;
    for (Layer& layer : unreduced) {
      layer.sigma_s /= 1 - layer.g;
      layer.sigma = greater(layer.sigma_a + layer.sigma_s, all(CLEAR));
    }
    light_in(unreduced, h.endless, asked.directions, h.directions, unreduced_lights);
    if (h.below) {
      Layers layers;
      Lights lights;
      turned(unreduced, unreduced_lights, h.directions, layers, lights);
      truly.prepare(layers, lights, h.directions, h.endless, exits, h.exits, true);
    } else {
      truly.prepare(unreduced, unreduced_lights, h.directions, h.endless, exits, h.exits, true);
    }
  }

  static V swept(const std::vector<Sweep>& sweeps, float s) {
    V total = {};
    for (const Sweep& sweep : sweeps) total += sweep.at(s);
    return total;
  }

  // What multiple scattering lacks for the same stack without absorption to return all light
  V furnace() {
    const Header& h = asked.h;
    stack.white = stack.layers, stack.lit = stack.lights;
    for (int k = 0; k < h.layers; k++) {
      Layer& layer = stack.white[k];
      layer.sigma_a = V{}, layer.sigma_s = layer.sigma;
      for (int j = 0; j < h.directions; j++) {
        Light& light = stack.lit[k * h.directions + j];
        light.source = layer.sigma * float(light.share / light.cosine);
      }
    }
    V lacking = 1 - ballistic(stack.lights, h.endless, asked.directions, h.directions), have = {};
    for (int side = 0; side < (h.endless ? 1 : 2); side++) {
      const Layers* layers = &stack.white;
      const Lights* lights = &stack.lit;
      if (side) {
        turned(stack.white, stack.lit, h.directions, stack.turned_layers, stack.turned_lights);
        layers = &stack.turned_layers, lights = &stack.turned_lights;
      }
      helper.prepare(*layers, *lights, h.directions, h.endless, asked.exits[side], h.exits, false);
      lacking -= helper.at(0);
      for (int i = 0; i < h.sets; i++)
        others[i].prepare(*layers, *lights, h.directions, h.endless, asked.sets[side][i]);
      have += swept(others, 0);
    }
    return greater(lesser((lacking + FEW) / (have + FEW), all(2)), all(0.5f));
  }

  // Share that is left of light bound outwards in the reduced medium, and inwards in truth
  V survival() const {
    const Header& h = asked.h;
    V left = {}, total = all(TINY);
    for (int k = 0; k < h.layers; k++)
      for (int j = 0; j < h.directions; j++) {
        const Light& light = stack.lights[k * h.directions + j];
        V onwards = k + 1 < h.layers ? stack.lights[(k + 1) * h.directions + j].down
                    : h.endless      ? V{}
                                     : light.down * light.beam;
        V scattered = float(light.share) * (light.down - onwards);
        left += scattered * decay(DETOUR * stack.layers[k].sigma_a / stack.layers[k].sigma);
        total += scattered;
      }
    return left / total;
  }

  V at(float s) const {
    const Header& h = asked.h;
    if (!h.sp3) return diffusion.at(s);
    V total = {};
    if (h.once) total = h.deflected ? truly.at(s) : reduced.at(s);
    if (h.twice) total += factor * swept(sweeps, s);
    return total;
  }
};

// Rows `first` … `last`: `result` (rows, terms, channels) is `matrix` (terms, frequencies) times the profile at `s`.
// `fields`: sigma_a, sigma_s, g and thickness at rows, layers and channels, by their `strides`.
extern "C" void weigh(const Header* header, const double* numbers, const float* const* fields, const int64_t* strides,
                      const float* s, const float* matrix, int64_t first, int64_t last, float* result) {
  const Asked asked(*header, numbers);
  const Header& h = asked.h;
  const int C = h.channels;
#if defined(__SSE__)
  const unsigned state = __builtin_ia32_stmxcsr();
  __builtin_ia32_ldmxcsr(state | 0x8040);  // denormal numbers are 0: they take a hundred times longer
#endif
  Solver solver(asked);
  solver.stack.layers.resize(h.layers);
  std::vector<V> spectrum(h.frequencies);
  for (int64_t block = first * C; block < last * C; block += WIDTH) {
    const int lanes = int(last * C - block < WIDTH ? last * C - block : WIDTH);
    int64_t row[WIDTH], channel[WIDTH];
    row[0] = block / C, channel[0] = block - row[0] * C;
    for (int i = 1; i < WIDTH; i++) {  // the last column again where there are no more
      const int64_t next = channel[i - 1] + (i < lanes);
      channel[i] = next == C ? 0 : next, row[i] = row[i - 1] + (next == C);
    }
    for (int k = 0; k < h.layers; k++) {
      V value[4];
      for (int f = 0; f < 4; f++) {
        const int64_t* step = strides + 3 * f;
        const float* field = fields[f] + k * step[1];
        float found[WIDTH];
        for (int i = 0; i < WIDTH; i++) found[i] = field[row[i] * step[0] + channel[i] * step[2]];
        value[f] = load(found);
      }
      V sigma_s = value[1] * (1 - value[2]);
      solver.stack.layers[k] = {value[0], sigma_s, greater(value[0] + sigma_s, all(CLEAR)), value[2], value[3], asked.eta[k]};
    }
    solver.prepare();
    for (int i = 0; i < h.frequencies; i++) spectrum[i] = solver.at(s[i]);
    for (int t = 0; t < h.terms; t++) {
      V total = {};
      for (int i = 0; i < h.frequencies; i++) total += matrix[t * h.frequencies + i] * spectrum[i];
      float made[WIDTH];
      std::memcpy(made, &total, sizeof made);
      for (int i = 0; i < lanes; i++) result[(row[i] * h.terms + t) * C + channel[i]] = made[i];
    }
  }
#if defined(__SSE__)
  __builtin_ia32_ldmxcsr(state);
#endif
}
