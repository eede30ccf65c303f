// Work shared between threads, for products.cpp and pairs.cpp.

#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <new>
#include <thread>

constexpr int64_t MOST_THREADS = 256;

// `work(first, last)` for as many parts of `count` items as there are threads; where the system has no more
// threads to give, one after the other. Whether there was memory for all of it: nothing is thrown.
template <class Work>
static bool parallel(int64_t count, int64_t threads, Work work) {
  std::atomic<bool> enough(true);
  const auto part = [&enough, &work](int64_t first, int64_t last) __attribute__((noinline)) {  // once, not thrice
    try {
      work(first, last);
    } catch (const std::bad_alloc&) {
      enough = false;
    }
  };
  threads = std::max<int64_t>(1, std::min({threads, count, MOST_THREADS}));
  std::thread others[MOST_THREADS];
  for (int64_t t = 1; t < threads; t++) {
    const int64_t first = count * t / threads, last = count * (t + 1) / threads;
    try {
      others[t] = std::thread(part, first, last);
    } catch (const std::exception&) {  // no thread, or no memory for one
      part(first, last);
    }
  }
  part(0, count / threads);
  for (auto& other : others)
    if (other.joinable()) other.join();
  return enough;
}
