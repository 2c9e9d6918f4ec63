#include "core/types/codes.hpp"

#include <array>
#include <cstddef>

namespace multipanda {
namespace {

constexpr std::array<std::string_view, static_cast<std::size_t>(Intervention::count_)> kInterventions = {
    "none",
    "torque not finite",
    "torque implausible",
    "controllet threw an exception",
    "controllet reported a fault",
    "reference stale",
    "state not finite",
    "state too old",
    "joint position limit",
    "joint velocity limit",
    "workspace limit",
    "arm not ready",
    "torque clamped",
    "torque rate clamped",
    "stop requested"};

constexpr std::array<std::string_view, static_cast<std::size_t>(Verdict::count_)> kVerdicts = {
    "pending",
    "accepted",
    "unknown controllet",
    "unknown arm",
    "unknown feature",
    "unknown parameter",
    "unknown input",
    "wrong number of values",
    "value not finite",
    "value out of bounds",
    "two owners for one arm",
    "arm is stopped: resume it first",
    "arm is not ready for control",
    "controllet is not active",
    "controllet refused to start from the measured state",
    "the active controllets changed in between: ask again",
    "too many requests at once: ask again",
    "the loop is not running",
    "no answer from the loop in time"};

template <typename Table>
std::string_view look_up(const Table& table, std::size_t i) {
  return i < table.size() ? table[i] : std::string_view("unknown code");
}

}  // namespace

std::string_view to_string(Intervention code) {
  return look_up(kInterventions, static_cast<std::size_t>(code));
}
std::string_view to_string(Verdict code) { return look_up(kVerdicts, static_cast<std::size_t>(code)); }

}  // namespace multipanda
