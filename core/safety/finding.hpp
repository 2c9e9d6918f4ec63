#pragma once

#include <cstdint>

#include "core/types/codes.hpp"

namespace multipanda {

// Result of a check: nothing (`none`), or the rule, the joint, and the values.
struct Finding {
  Intervention rule = Intervention::none;
  std::uint16_t joint = 0xFFFF;  // 0xFFFF: not specific to a joint
  double value = 0, limit = 0;
  explicit operator bool() const { return rule != Intervention::none; }
};

}  // namespace multipanda
