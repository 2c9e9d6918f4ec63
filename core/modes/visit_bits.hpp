#pragma once

#include <bit>
#include <cstdint>

#include "core/modes/request.hpp"
#include "core/types/arm_set.hpp"

namespace multipanda {

// Instances of a set, lowest index first: the order in which they are computed is always the same.
template <typename Visit>
void for_each(InstanceSet set, Visit visit) {
  for (; set != 0; set &= set - 1) visit(static_cast<InstanceIndex>(std::countr_zero(set)));
}

template <typename Visit>
void for_each(ArmSet arms, Visit visit) {
  for (std::uint32_t bits = arms.bits(); bits != 0; bits &= bits - 1) {
    visit(static_cast<ArmIndex>(std::countr_zero(bits)));
  }
}

}  // namespace multipanda
