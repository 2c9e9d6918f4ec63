#include "experiments/bare_math.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "benchmarks/bare/bare_libraries.hpp"

namespace multipanda {

double bare_math_us(const std::vector<std::shared_ptr<const ArmModel>>& models) {
  using bench::BareDualImpedance;
  using bench::Vector7;
  constexpr int kEvaluations = 301;
  constexpr double kSwing = 0.2;  // amplitude of the joints' motion [rad]
  if (models.size() < 2 || models[0]->joint_count() != 7 || models[1]->joint_count() != 7)
    return std::numeric_limits<double>::quiet_NaN();
  BareDualImpedance law(*models[0], *models[1], Pose{},
                        {.translational_stiffness = Vector3::Constant(400),
                         .rotational_stiffness = 30,
                         .damping_ratio = 1,
                         .null_space_stiffness = 5});
  std::array<BareDualImpedance::Input, 2> inputs;
  std::vector<double> times;
  double sum = 0;
  for (int k = 0; k < kEvaluations; ++k) {
    for (std::size_t arm = 0; arm < 2; ++arm) {
      const Vector7 q_home = models[arm]->q_home();
      inputs[arm] = {.q = q_home + Vector7::Constant(kSwing * std::sin(0.01 * k)),
                     .dq = Vector7::Constant(kSwing * std::cos(0.01 * k)),
                     .X_W_d = models[arm]->X_WB() * Pose{Matrix3::Identity(), Vector3(0.4, 0, 0.4)},
                     .V_d = Vector6::Zero(),
                     .A_d = Vector6::Zero(),
                     .q_N = q_home};
    }
    const auto begin = std::chrono::steady_clock::now();
    const auto& tau = law.torques(inputs);
    times.push_back(
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    sum += tau[0][0] + tau[1][0];
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  if (!std::isfinite(sum)) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = times.begin() + kEvaluations / 2;
  std::nth_element(times.begin(), middle, times.end());
  return *middle;
}

}  // namespace multipanda
