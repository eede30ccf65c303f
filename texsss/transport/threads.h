// Work shared between threads, for products.cpp and pairs.cpp.

#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <new>
#include <thread>

constexpr int64_t MOST_THREADS = 256;

// Parts per thread: whoever is done first, as others run beside, takes the next one
constexpr int64_t PARTS_EACH = 8;

// `work(first, last)` for parts of `count` items, shared between threads; where the system has no more threads to
// give, by those there are. Whether there was memory for all of it: nothing is thrown.
template <class Work>
static bool parallel(int64_t count, int64_t threads, Work work) {
  threads = std::max<int64_t>(1, std::min({threads, count, MOST_THREADS}));
  const int64_t parts = threads > 1 ? std::min(count, threads * PARTS_EACH) : 1;
  std::atomic<bool> enough(true);
  std::atomic<int64_t> next(0);
  const auto some = [&]() __attribute__((noinline)) {
    try {
      for (int64_t k = next++; k < parts; k = next++) work(count * k / parts, count * (k + 1) / parts);
    } catch (const std::bad_alloc&) {
      enough = false;
    }
  };
  std::thread others[MOST_THREADS];
  for (int64_t t = 1; t < threads; t++) {
    try {
      others[t] = std::thread(some);
    } catch (const std::exception&) {  // no thread, or no memory for one
      break;
    }
  }
  some();
  for (auto& other : others)
    if (other.joinable()) other.join();
  return enough;
}
