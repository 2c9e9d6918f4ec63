#include "runtime/embedded/shared_arm_state.hpp"

#include <algorithm>
#include <multipanda_headers_hash.hpp>
#include <string_view>

namespace multipanda {
namespace {

// The struct behind the value if it begins like a SharedArmState; nullptr otherwise.
const SharedArmState* behind(double value) {
  const auto address = std::bit_cast<std::uintptr_t>(value);
  constexpr std::uintptr_t kFirstPage = 4096, kLast = std::uintptr_t{1} << 47;  // of user space
  if (address < kFirstPage || address >= kLast || address % alignof(SharedArmState) != 0) return nullptr;
  const auto* shared = reinterpret_cast<const SharedArmState*>(address);  // NOLINT(performance-no-int-to-ptr)
  return shared->magic == SharedArmState::kMagic ? shared : nullptr;
}

bool same_headers(const SharedArmState& shared) {
  return shared.size == sizeof(SharedArmState) && shared.headers == SharedArmState::this_build();
}

std::string text(const SharedArmState::Headers& headers) {
  return {headers.begin(), std::ranges::find(headers, '\0')};
}

}  // namespace

SharedArmState::Headers SharedArmState::this_build() {
  constexpr std::string_view kHash = MULTIPANDA_HEADERS_HASH;
  static_assert(kHash.size() < Headers{}.size());
  Headers headers{};
  std::ranges::copy(kHash, headers.begin());
  return headers;
}

const SharedArmState* shared_arm_state(double value) {
  const SharedArmState* shared = behind(value);
  return shared != nullptr && same_headers(*shared) && shared->layout == kStateLayout ? shared : nullptr;
}

std::string shared_arm_state_refusal(double value) {
  const SharedArmState* shared = behind(value);
  if (shared == nullptr) return {};
  if (!same_headers(*shared)) {
    return "the hardware was built with other headers (hash " + text(shared->headers) +
           ") than this controller (hash " + text(SharedArmState::this_build()) +
           "); build multipanda_hardware and multipanda_controller from the same source";
  }
  if (shared->layout != kStateLayout) {
    return "the hardware was built with the same headers as this controller, but with other flags or another "
           "Eigen, so that type layouts differ; build multipanda_hardware and multipanda_controller in the "
           "same way";
  }
  return {};
}

}  // namespace multipanda
