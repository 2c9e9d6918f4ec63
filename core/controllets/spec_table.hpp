#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "core/controllets/descriptor.hpp"

// Lists of specs for a descriptor. Each entry names the enumerator by which the law reads it, so the compiler
// checks that the enum and the list agree:
//
//   enum Parameter : std::size_t { kStiffness, kDampingRatio, kParameterCount };
//   .parameters = spec_table<kParameterCount>(
//       parameter_at<kStiffness>({.name = "stiffness_n_per_m", .unit = "N/m", .initial = {400}, .max =
//       5000}), parameter_at<kDampingRatio>({.name = "damping_ratio", .initial = {1}, .min = 0.1, .max = 2}))
namespace multipanda {

// Specs that take the indices kFirst ... kFirst + kSize - 1 of a descriptor's list.
template <typename Spec, std::size_t kFirst, std::size_t kSize>
struct SpecsAt {
  std::vector<Spec> specs;
  Spec& operator[](std::size_t i) { return specs[i]; }
};

template <auto kIndex>
SpecsAt<ParameterSpec, kIndex, 1> parameter_at(ParameterSpec spec) {
  return {{std::move(spec)}};
}

template <auto kIndex>
SpecsAt<InputSpec, kIndex, 1> input_at(InputSpec spec) {
  return {{std::move(spec)}};
}

// An output of kSize numbers; kIndex is the place of its first number.
template <auto kIndex, std::size_t kSize = 1>
SpecsAt<OutputSpec, kIndex, kSize> output_at(std::string name, std::string doc) {
  return {{{std::move(name), kSize, std::move(doc)}}};
}

// A group of specs that several laws share, from index kIndex on.
template <auto kIndex, typename Spec, std::size_t kFirst, std::size_t kSize>
SpecsAt<Spec, kIndex, kSize> group_at(SpecsAt<Spec, kFirst, kSize> group) {
  return {std::move(group.specs)};
}

namespace detail {
template <std::size_t kParts>
consteval bool complete_in_order(const std::array<std::size_t, kParts>& first,
                                 const std::array<std::size_t, kParts>& size, std::size_t count) {
  std::size_t next = 0;
  for (std::size_t i = 0; i < kParts; ++i) {
    if (first[i] != next) return false;
    next += size[i];
  }
  return next == count;
}
}  // namespace detail

// The whole list. kCount is the enum's last enumerator. Does not compile unless the entries are complete and
// in the order of the enum.
template <auto kCount, typename Spec, std::size_t... kFirst, std::size_t... kSize>
std::vector<Spec> spec_table(SpecsAt<Spec, kFirst, kSize>... parts) {
  static_assert(detail::complete_in_order(std::array<std::size_t, sizeof...(parts)>{kFirst...},
                                          std::array<std::size_t, sizeof...(parts)>{kSize...}, kCount),
                "list every enumerator once, in the order of the enum, which ends with the count");
  std::vector<Spec> specs;
  (specs.insert(specs.end(), parts.specs.begin(), parts.specs.end()), ...);
  return specs;
}

}  // namespace multipanda
