#pragma once

#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/codes.hpp"
#include "core/types/spatial.hpp"

// The numbers of a record by name: those of the cycle, and of each arm as arm_sample.hpp declares them. A
// visitor has
//   one(name, value, known), many(name, span of values, known)
// for values of double, std::uint64_t, std::int64_t and bool. `known`: the arm reports the quantity.
namespace multipanda {

// Data that the thread taking the records adds to an arm's sample.
struct ArmAddition {
  bool stopped = false;  // until it is resumed
  Intervention last_intervention = Intervention::none, removed_by = Intervention::none;
  Pose X_WE;  // end effector in the world
};

// Calls take(value) for a number and take(span) for several, of an arm of `joints` joints.
template <class T>
void with_numbers(const T& value, std::size_t joints, auto&& take) {
  if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, double>) {
    take(value);
  } else if constexpr (std::is_integral_v<T>) {
    take(std::conditional_t<std::is_signed_v<T>, std::int64_t, std::uint64_t>{value});
  } else if constexpr (std::is_same_v<T, PoseArray>) {
    const auto numbers = pose_of(value).values();
    take(std::span<const double>(numbers));
  } else if constexpr (std::is_same_v<T, JointFlags> || std::is_same_v<T, AxisFlags>) {
    std::array<bool, T().size()> flags{};
    for (std::size_t i = 0; i < flags.size(); ++i) flags[i] = value[i];
    take(std::span<const bool>(flags).first(std::is_same_v<T, JointFlags> ? joints : flags.size()));
  } else {
    take(std::span<const double>(value).first(std::is_same_v<T, JointArray> ? joints : value.size()));
  }
}

void visit_value(auto& to, const char* name, const auto& value, bool known, std::size_t joints) {
  with_numbers(value, joints, [&]<class V>(const V& numbers) {
    if constexpr (std::is_arithmetic_v<V>) {
      to.one(name, numbers, known);
    } else {
      to.many(name, numbers, known);
    }
  });
}

void visit_sample(auto& to, const ArmSample& sample, std::size_t joints) {
#define MULTIPANDA_VISIT(type, member, name, message, known, doc) \
  visit_value(to, #name, sample.member, sample.known, joints);
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_VISIT)
#undef MULTIPANDA_VISIT
}

void visit_arm(auto& to, const ArmSample& sample, const ArmAddition& more, std::size_t joints) {
  visit_sample(to, sample, joints);
  to.one("stopped", more.stopped, true);
  to.one("last_intervention", static_cast<std::uint64_t>(more.last_intervention), true);
  to.one("removed_by", static_cast<std::uint64_t>(more.removed_by), true);
  const auto pose = more.X_WE.values();
  to.many("position_m", std::span<const double>(pose).first(3), true);
  to.many("quaternion_wxyz", std::span<const double>(pose).last(4), true);
}

void visit_cycle(auto& to, const CycleRecord& record) {
  to.one("cycle", record.cycle, true);
  to.one("t_ns", record.t.ns, true);
  to.one("start_ns", record.start.ns, true);
  to.one("period_s", record.period_s, true);
  to.one("overruns", record.overruns, true);
  const StageTimes& stages = record.stages;
  for (const auto& [name, ns] : {std::pair{"read_ns", stages.read},
                                 {"controllets_ns", stages.controllets},
                                 {"features_ns", stages.features},
                                 {"safety_ns", stages.safety},
                                 {"write_ns", stages.write},
                                 {"total_ns", stages.total}})
    to.one(name, std::int64_t{ns}, true);
}

// Number of values of a quantity of this type.
template <class T>
std::size_t count_of(std::size_t joints) {
  std::size_t count = 1;
  with_numbers(T{}, joints, [&](const auto& numbers) {
    if constexpr (requires { numbers.size(); }) count = numbers.size();
  });
  return count;
}

// A field of a record, whose numbers have 8 bytes each.
struct RecordField {
  std::string name;
  char type = 'f';         // f: floating point; u, i: integers
  std::size_t offset = 0;  // bytes from the begin of the record
  std::size_t count = 1;
};

// A visitor that lists the fields of a record.
class FieldList {
 public:
  explicit FieldList(std::size_t offset) : offset_(offset) {}
  void prefix(const std::string& text) { prefix_ = text; }
  template <class T>
  void one(const std::string& name, T /*value*/, bool /*known*/) {
    add(name, std::is_floating_point_v<T> ? 'f' : std::is_signed_v<T> ? 'i' : 'u', 1);
  }
  template <class T>
  void many(const std::string& name, std::span<const T> values, bool /*known*/) {
    add(name, std::is_floating_point_v<T> ? 'f' : 'u', values.size());
  }
  void add(const std::string& name, char type, std::size_t count) {
    fields_.push_back({prefix_ + name, type, offset_, count});
    offset_ += 8 * count;
  }

  std::size_t offset() const { return offset_; }
  std::vector<RecordField>& fields() { return fields_; }

 private:
  std::size_t offset_;
  std::string prefix_;
  std::vector<RecordField> fields_;
};

// A visitor that writes them. Unknown lists of numbers become NaN.
class FieldWriter {
 public:
  explicit FieldWriter(std::byte* at) : at_(at) {}
  void one(const char* /*name*/, auto value, bool /*known*/) { put(value); }
  template <class T>
  void many(const char* /*name*/, std::span<const T> values, bool known) {
    for (const T value : values) {
      if constexpr (std::is_same_v<T, double>) {
        put(known ? value : std::numeric_limits<double>::quiet_NaN());
      } else {
        put(value);
      }
    }
  }

 private:
  template <class T>
  void put(T value) {
    const std::conditional_t<std::is_same_v<T, bool>, std::uint64_t, T> number{value};
    static_assert(sizeof(number) == 8);
    std::memcpy(at_, &number, 8);
    at_ += 8;
  }
  std::byte* at_;
};

// A visitor that writes all of them as floating point.
class NumberWriter {
 public:
  explicit NumberWriter(double* to) : to_(to) {}
  void one(const char* /*name*/, auto value, bool /*known*/) { *to_++ = static_cast<double>(value); }
  template <class T>
  void many(const char* /*name*/, std::span<const T> values, bool known) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    for (const T value : values)
      *to_++ = std::is_same_v<T, bool> || known ? static_cast<double>(value) : kNan;
  }

 private:
  double* to_;
};

}  // namespace multipanda
