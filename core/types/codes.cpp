#include "core/types/codes.hpp"

#include <array>
#include <cstddef>

namespace multipanda {
namespace {

struct Rule {
  std::string_view text;
  std::string_view unit;  // of value and limit; empty: none
};

constexpr std::array<Rule, static_cast<std::size_t>(Intervention::count_)> kInterventions{
    {{"none", ""},
     {"torque not finite", "N m"},
     {"torque implausible", "N m"},
     {"controllet threw an exception", ""},
     {"controllet reported a fault", ""},
     {"reference stale", "s"},
     {"state not finite", ""},
     {"state too old", "s"},
     {"joint position limit", "rad"},
     {"joint velocity limit", "rad/s"},
     {"workspace limit", "m"},
     {"arm not ready", ""},
     {"torque clamped", "N m"},
     {"torque rate clamped", "N m/s"},
     {"stop requested", ""},
     {"observed arm lost", "s"},
     {"force sensor silent", "s"},
     {"force sensor saturated", "N or N m"},
     {"force sensor fault", ""},
     {"force sensor not tared", "N or N m"},
     {"force sensor contradicts the arm", "N m"}}};

struct VerdictText {
  std::string_view name, text;
};
constexpr std::array<VerdictText, static_cast<std::size_t>(Verdict::count_)> kVerdicts = {
    {{"pending", "pending"},
     {"accepted", "accepted"},
     {"unknown_instance", "unknown controllet"},
     {"unknown_arm", "unknown arm"},
     {"unknown_feature", "unknown feature"},
     {"unknown_parameter", "unknown parameter"},
     {"unknown_input", "unknown input"},
     {"wrong_size", "wrong number of values"},
     {"not_finite", "value not finite"},
     {"out_of_bounds", "value out of bounds"},
     {"two_owners", "two owners for one arm"},
     {"arm_stopped", "arm is stopped: resume it first"},
     {"arm_not_ready", "arm is not ready for control"},
     {"not_active", "controllet is not active"},
     {"start_refused", "controllet refused to start from the measured state"},
     {"superseded", "the active controllets changed in the meantime: try again"},
     {"queue_full", "too many requests at once: try again"},
     {"loop_not_running", "the loop is not running"},
     {"timeout", "the loop did not take it in time; it is not executed"},
     {"observes_itself", "a controllet would observe its own arm through others"}}};
static_assert(!kInterventions.back().text.empty() && !kVerdicts.back().text.empty(), "every code has a text");

}  // namespace

std::string_view to_string(Intervention code) {
  const auto i = static_cast<std::size_t>(code);
  return i < kInterventions.size() ? kInterventions[i].text : "unknown code";
}

std::string_view unit_of(Intervention code) {
  const auto i = static_cast<std::size_t>(code);
  return i < kInterventions.size() ? kInterventions[i].unit : "";
}

std::string_view to_string(Verdict code) {
  const auto i = static_cast<std::size_t>(code);
  return i < kVerdicts.size() ? kVerdicts[i].text : "unknown code";
}

std::string_view name_of(Verdict code) {
  const auto i = static_cast<std::size_t>(code);
  return i < kVerdicts.size() ? kVerdicts[i].name : "unknown";
}

}  // namespace multipanda
