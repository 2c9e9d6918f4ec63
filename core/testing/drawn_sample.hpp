#pragma once

#include <map>
#include <random>
#include <string>
#include <vector>

#include "core/state/arm_sample.hpp"
#include "core/types/spatial.hpp"

// A sample of an arm with drawn quantities, and what each encoding must hold of them.
namespace multipanda::test {

struct DrawnSample {
  ArmSample sample;
  std::map<std::string, std::vector<double>> numbers;  // by name: flags 0 or 1, poses x y z qw qx qy qz
  std::map<std::string, std::string> known,
      in_message;  // what says that it is reported; its field in messages
};

// `reports`: whether the arm reports what it may leave out.
inline DrawnSample draw_sample(std::mt19937_64& random, std::size_t joints, bool reports = true) {
  const auto number = [&] { return std::uniform_real_distribution<>(0.5, 9)(random); };
  const auto draw = [&]<class T>(T& out) -> std::vector<double> {
    std::vector<double> numbers;
    if constexpr (std::is_same_v<T, bool>) {
      out = random() % 2 == 0;
      numbers = {out ? 1.0 : 0.0};
    } else if constexpr (std::is_integral_v<T>) {
      out = static_cast<T>(random() % 8);  // also a mode
      numbers = {static_cast<double>(out)};
    } else if constexpr (std::is_same_v<T, double>) {
      numbers = {out = number()};
    } else if constexpr (std::is_same_v<T, PoseArray>) {
      const Quaternion q(
          Eigen::AngleAxisd(0.1 * number(), Vector3(number(), number(), number()).normalized()));
      numbers = {number(), number(), number(), q.w(), q.x(), q.y(), q.z()};
      std::copy_n(numbers.begin(), 3, out.begin());
      Eigen::Map<Matrix3>(out.data() + 3) = q.toRotationMatrix();
    } else if constexpr (std::is_same_v<T, JointFlags> || std::is_same_v<T, AxisFlags>) {
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = random() % 2 == 0;
        numbers.push_back(out[i] ? 1.0 : 0.0);
      }
      numbers.resize(std::is_same_v<T, JointFlags> ? joints : numbers.size());
    } else {
      for (double& value : out) numbers.push_back(value = number());
      numbers.resize(std::is_same_v<T, JointArray> ? joints : numbers.size());
    }
    return numbers;
  };
  DrawnSample drawn;
  ArmSample& sample = drawn.sample;
#define MULTIPANDA_DRAW(type, member, name, message, flag, doc) \
  drawn.numbers[#name] = draw(sample.member);                   \
  drawn.known[#name] = #flag;                                   \
  drawn.in_message[#name] = #message;
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_DRAW)
#undef MULTIPANDA_DRAW
  sample.has_tau_ext = sample.has_wrench_estimate = sample.has_contact_truth = reports;
  sample.has_gripper = sample.has_report = reports;
  drawn.numbers["has_gripper"] = drawn.numbers["has_report"] = {reports ? 1.0 : 0.0};
  return drawn;
}

}  // namespace multipanda::test
