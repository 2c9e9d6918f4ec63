#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/reference/target.hpp"

namespace multipanda::test {

// A goal that no way into a run takes, and what each of them answers.
struct WrongGoal {
  Quantity quantity;           // of the input: pose in the world, or joints
  std::vector<double> values;  // in the order of Target
  double duration_s = 0;
  std::string sentence;  // contained in the refusal
};

// For the inputs of one arm of this model.
inline std::vector<WrongGoal> wrong_goals(const ArmModel& model) {
  const auto text = [](double number) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.6g", number);
    return std::string(buffer);
  };
  const std::vector<double> pose{0.4, 0, 0.4, 0, 1, 0, 0}, home(model.q_home().begin(), model.q_home().end());
  const std::size_t n = home.size();
  const auto with = [](std::vector<double> values, std::size_t i, double value) {
    values[i] = value;
    return values;
  };
  std::vector<WrongGoal> goals{
      {Quantity::pose, with(pose, 0, 5), 0, "out of reach: "},
      {Quantity::pose, {400, 0, 400, 0, 1, 0, 0}, 0, "at most (this looks like millimeters)"},
      {Quantity::pose, with(pose, 2, 1e300), 0,
       "number 3 of 7 is 1e+300; expected at most 1000, in SI units"},
      {Quantity::pose, with(pose, 4, 2), 0,
       "the quaternion's length is 2; expected a unit quaternion, w first"},
      {Quantity::pose, with(pose, 1, NAN), 0, "number 2 of 7 is not finite"},
      {Quantity::pose, {0.4, 0, 0.4}, 0, "expected 7 numbers, found 3"},
      {Quantity::pose, pose, -1, "the duration is -1 s; expected 0 to 86400 s"},
      {Quantity::pose, pose, 1e6, "the duration is 1e+06 s; expected 0 to 86400 s"},
      {Quantity::joints, {0.1}, 0, "expected " + std::to_string(n) + " numbers, found 1"},
      {Quantity::joints, with(home, n - 1, INFINITY), 0,
       "number " + std::to_string(n) + " of " + std::to_string(n) + " is not finite"}};
  for (std::size_t i = 0; i < n; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double low = model.limits().q_min[k], high = model.limits().q_max[k];
    const std::string joint = "joint" + std::to_string(i + 1) + ": ";
    const std::string range = " rad is outside of " + text(low) + " to " + text(high) + " rad";
    for (const double q : {low - 0.01, high + 0.01})
      goals.push_back({Quantity::joints, with(home, i, q), 0, joint + text(q) + range});
    const double degrees = std::round(home[i] * 180 / M_PI);
    if (std::abs(degrees) < 10) continue;
    goals.push_back({Quantity::joints, with(home, i, degrees), 0,
                     joint + text(degrees) + range + " (this looks like degrees)"});
  }
  return goals;
}

}  // namespace multipanda::test
