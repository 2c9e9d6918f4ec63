#pragma once

#include <cstdint>
#include <random>

namespace multipanda {

// Uniform in [-1, 1) from the generator's bits, so that every standard library gives the same numbers.
class SeededDraw {
 public:
  SeededDraw(std::uint64_t seed, std::uint64_t repeat) : bits_(seed * 1'000'003 + repeat) {
    for (int i = 0; i < 8; ++i) bits_();  // the first numbers of adjacent seeds are similar
  }
  double operator()() { return static_cast<double>(bits_() >> 11) * 0x1p-52 - 1.0; }

 private:
  std::mt19937_64 bits_;
};

}  // namespace multipanda
