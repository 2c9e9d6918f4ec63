#include "cockpit/run/moved_inputs.hpp"

#include <algorithm>
#include <cmath>

#include "runtime/live_input/request_handler.hpp"

namespace multipanda::cockpit {
namespace {

// Deceleration of the reference (core/reference/reference.hpp), and the shortest time that it takes.
constexpr double kBraking = 4, kTurnBraking = 8, kJointBraking = 5;  // [m/s^2], [rad/s^2]
constexpr double kLeastTime = 0.1;                                   // [s]

// Distance within which a speed is reduced to zero.
double way(double speed, double braking) { return speed * std::max(0.5 * kLeastTime, speed / (2 * braking)); }

Quaternion quaternion(const std::vector<double>& pose) { return {pose[3], pose[4], pose[5], pose[6]}; }

}  // namespace

std::vector<double> MovedInputs::resting_place(Quantity quantity, const std::vector<double>& before,
                                               const std::vector<double>& now, double dt) {
  std::vector<double> rest = now;
  switch (quantity) {
    case Quantity::twist:
    case Quantity::wrench:
      std::ranges::fill(rest, 0);
      break;
    case Quantity::scalar:
      break;
    case Quantity::joints:
      if (!(dt > 0)) break;
      for (std::size_t k = 0; k < now.size(); ++k) {
        const double speed = (now[k] - before[k]) / dt;
        rest[k] += std::copysign(way(std::abs(speed), kJointBraking), speed);
      }
      break;
    case Quantity::pose: {
      if (!(dt > 0)) break;
      const Vector3 v = (Vector3(now[0], now[1], now[2]) - Vector3(before[0], before[1], before[2])) / dt;
      const double speed = v.norm();
      for (Eigen::Index k = 0; speed > 0 && k < 3; ++k)
        rest[static_cast<std::size_t>(k)] += v[k] / speed * way(speed, kBraking);
      const Quaternion R = quaternion(now);
      Eigen::AngleAxisd turn(R * quaternion(before).inverse());  // in the world
      double angle = turn.angle();
      if (angle > M_PI) angle -= 2 * M_PI;
      const double rate = angle / dt;
      const double more = std::copysign(way(std::abs(rate), kTurnBraking), rate);
      const Quaternion end = Quaternion(Eigen::AngleAxisd(more, turn.axis())) * R;
      const std::array<double, 4> wxyz{end.w(), end.x(), end.y(), end.z()};
      std::ranges::copy(wxyz, rest.begin() + 3);
      break;
    }
  }
  return rest;
}

bool MovedInputs::bring_to_rest(Instance& instance, std::size_t index, const RecordReader& records) {
  Reference& input = instance.inputs()[index];
  const auto* field = records.find(instance.name() + "/" + input.spec().name);
  const auto* time = records.find("t_ns");
  RecordReader::Record newest, before;
  const std::uint64_t count = records.records();
  if (field == nullptr || count < 2 || !records.read(count - 1, newest) || !records.read(count - 2, before))
    return false;
  const auto values_of = [&](const RecordReader::Record& record) {
    std::vector<double> values(field->count);
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = RecordReader::number(record, *field, k);
    return values;
  };
  const auto now = values_of(newest), then = values_of(before);
  double dt = 1e-9 * (RecordReader::number(newest, *time) - RecordReader::number(before, *time));
  const auto finite = [](const std::vector<double>& values) {
    return std::ranges::all_of(values, [](double x) { return std::isfinite(x); });
  };
  if (!finite(now)) return false;
  if (!finite(then)) dt = 0;  // it began with the newest record
  const auto rest = resting_place(input.spec().quantity, then, now, dt);
  Target goal;
  goal.size = static_cast<std::uint8_t>(rest.size());
  std::ranges::copy(rest, goal.values.begin());
  // Directly to the input, like samples of streams: it replaces every earlier sample.
  return input.post(goal) == Verdict::accepted;
}

bool MovedInputs::stands_still(const Instance& instance, std::uint64_t since,
                               const RecordReader& records) const {
  const auto* time = records.find("t_ns");
  RecordReader::Record record;
  double newest = std::nan("");
  for (std::uint64_t number = records.records(); number-- > since;) {
    if (!records.read(number, record)) return false;
    for (const ArmIndex arm : instance.arm_list()) {
      const auto* speeds = records.find(modes_.arm_name(arm) + "/dq_rad_per_s");
      for (std::size_t k = 0; k < speeds->count; ++k) {
        if (!(std::abs(RecordReader::number(record, *speeds, k)) < kStillest)) return false;
      }
    }
    const double t = 1e-9 * RecordReader::number(record, *time);
    if (std::isnan(newest)) newest = t;
    if (newest - t >= kStill) return true;
  }
  return false;
}

InstanceSet MovedInputs::come_to_rest(const RecordReader& records, bool deactivate) {
  for (const std::uint64_t ticket : tickets_) modes_.withdraw(ticket);
  tickets_.clear();
  InstanceSet ending = 0;
  const InstanceSet active = modes_.active();
  for (const auto& [place, unused] : inputs_) {
    const auto& [index, input] = place;
    if ((active & bit(index)) == 0) continue;
    const bool rests = bring_to_rest(modes_.instance(index), input, records);
    if (deactivate || !rests) ending |= bit(index);
  }
  inputs_.clear();
  for (const auto& [index, record] : std::exchange(changed_, {})) {
    const Instance& instance = modes_.instance(index);
    // Its start may have been taken and not be visible yet, so it ends whether it is active or not.
    if (deactivate || !(instance.descriptor().guided || stands_still(instance, record, records)))
      ending |= bit(index);
  }
  if (ending != 0) end_or_stop(modes_, ending);
  return deactivate ? 0 : ending & active;
}

}  // namespace multipanda::cockpit
