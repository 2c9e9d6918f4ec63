#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/types/capacity.hpp"

namespace multipanda {

using ArmIndex = std::size_t;  // position of an arm in the scene, from 0

// A set of arms as bits, for example those whose packets arrived or those that a controllet owns.
class ArmSet {
 public:
  constexpr ArmSet() = default;
  static constexpr ArmSet all(std::size_t count) { return ArmSet((1u << count) - 1u); }
  static constexpr ArmSet from_bits(std::uint32_t bits) { return ArmSet(bits); }
  static constexpr ArmSet of(ArmIndex arm) { return ArmSet(1u << arm); }

  constexpr bool contains(ArmIndex arm) const { return (bits_ >> arm & 1u) != 0; }
  constexpr bool contains(ArmSet other) const { return (bits_ & other.bits_) == other.bits_; }
  constexpr bool overlaps(ArmSet other) const { return (bits_ & other.bits_) != 0; }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr std::size_t size() const { return static_cast<std::size_t>(std::popcount(bits_)); }
  constexpr ArmIndex first() const { return static_cast<ArmIndex>(std::countr_zero(bits_)); }
  constexpr std::uint32_t bits() const { return bits_; }

  constexpr ArmSet operator|(ArmSet o) const { return ArmSet(bits_ | o.bits_); }
  constexpr ArmSet operator&(ArmSet o) const { return ArmSet(bits_ & o.bits_); }
  constexpr ArmSet operator-(ArmSet o) const { return ArmSet(bits_ & ~o.bits_); }
  constexpr ArmSet& operator|=(ArmSet o) { return *this = *this | o; }
  constexpr bool operator==(const ArmSet&) const = default;

 private:
  explicit constexpr ArmSet(std::uint32_t bits) : bits_(bits) {}
  static_assert(kMaxArms <= 31, "an ArmSet has 32 bits and all(count) shifts by count");
  std::uint32_t bits_ = 0;
};

}  // namespace multipanda
