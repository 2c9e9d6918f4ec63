// Feeds the wire's readers from files, seeds or libFuzzer (-fsanitize=fuzzer brings its own main).
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "fci/wire/testing/fuzz_input.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (!multipanda::fci::survives(std::as_bytes(std::span(data, size)))) std::abort();
  return 0;
}

#ifndef MULTIPANDA_LIBFUZZER
int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: fci_fuzz FILE... | --seed N [--count N]\n");
    return 2;
  }
  const std::string first = argv[1];
  if (first == "--seed" && argc >= 3) {
    std::mt19937_64 random(std::strtoull(argv[2], nullptr, 10));
    const long count = argc >= 5 ? std::strtol(argv[4], nullptr, 10) : 100000;
    std::vector<std::uint8_t> bytes;
    for (long i = 0; i < count; ++i) {
      bytes.resize(random() % 3000);
      for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
      LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
    }
    return 0;
  }
  for (int i = 1; i < argc; ++i) {
    std::ifstream file(argv[i], std::ios::binary);
    if (!file) {
      std::fprintf(stderr, "fci_fuzz: %s cannot be read\n", argv[i]);
      return 2;
    }
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  }
  return 0;
}
#endif
