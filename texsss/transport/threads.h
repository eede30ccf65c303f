// Work shared between threads, for products.cpp and pairs.cpp.

#pragma once

#include <algorithm>
#include <cstdint>
#include <thread>

constexpr int64_t MOST_THREADS = 256;

// `work(first, last)` for as many parts of `count` items as there are threads; where the system has no more
// threads or memory to give, one after the other
template <class Work>
static void parallel(int64_t count, int64_t threads, Work work) {
  threads = std::max<int64_t>(1, std::min({threads, count, MOST_THREADS}));
  std::thread others[MOST_THREADS];
  for (int64_t t = 1; t < threads; t++) {
    const int64_t first = count * t / threads, last = count * (t + 1) / threads;
    try {
      others[t] = std::thread([=] { work(first, last); });
    } catch (...) {
      work(first, last);
    }
  }
  work(int64_t(0), count / threads);
  for (auto& other : others)
    if (other.joinable()) other.join();
}
