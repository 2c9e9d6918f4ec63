#include "runtime/error_report.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kErrors = kArmErrorCount;
constexpr double kSlow_us = 500;   // computing time beyond which the controllers are the cause
constexpr double kTooNear = 0.05;  // parts of an arm closer than this are named [m]

JointVector joints(const JointArray& values, std::size_t n) {
  JointVector result(static_cast<Eigen::Index>(n));
  std::copy_n(values.begin(), n, result.data());
  return result;
}

// Keeps the value that exceeds its limit most or is nearest to it.
struct Worst {
  ReflexDetail detail;
  double share = -std::numeric_limits<double>::infinity();
  void see(ArmError error, Eigen::Index index, double value, double limit, double by) {
    if (!(by > share)) return;
    share = by;
    detail = {.error = error, .index = static_cast<std::int8_t>(index), .value = value, .limit = limit};
  }
};

// Quantities of the arm's last state, computed once.
class Case {
 public:
  Case(std::span<const ArmCycle> cycles, const ArmErrorLimits& limits)
      : cycles_(cycles), limits_(limits), n_(limits.joint_count), last_(cycles.back().arm) {}

  ReflexDetail detail_of(ArmError error) {
    switch (error) {
      case ArmError::joint_position_limits_violation:
      case ArmError::joint_move_in_wrong_direction:
        return position(error);
      case ArmError::joint_velocity_violation:
        return velocity(error);
      case ArmError::cartesian_velocity_violation:
        return cartesian_velocity(error);
      case ArmError::self_collision_avoidance_violation:
        return self_collision(error);
      case ArmError::joint_reflex:
        return torque_beyond(error);
      case ArmError::cartesian_reflex:
        return wrench_beyond(error);
      case ArmError::communication_constraints_violation:
        return {.error = error, .value = static_cast<double>(missed_in_row()), .limit = 20};
      case ArmError::power_limit_violation:
        return power(error);
      case ArmError::controller_torque_discontinuity:
        return torque_step(error);
      case ArmError::tau_j_range_violation:
        return torque_range(error);
      default:
        return {};
    }
  }

  // Adds context to the number.
  std::string remark(ArmError error, const ReflexDetail& detail) const {
    switch (error) {
      case ArmError::self_collision_avoidance_violation:
        return nearest_names_.empty() ? "" : "Nearest: " + nearest_names_ + ".";
      case ArmError::joint_reflex:
      case ArmError::cartesian_reflex:
        if (!limits_.thresholds) {
          return "The arm's thresholds are unknown to this program; set them with 'collision:' in the scene.";
        }
        if (limits_.thresholds->acceleration)
          return "While the arm accelerates it uses the thresholds for acceleration.";
        return {};
      case ArmError::controller_torque_discontinuity:
        return detail && std::abs(detail.value) <= detail.limit * (1 + 1e-5)
                   ? "The sent commands kept the limit: commands were lost, so the arm received the change "
                     "of several periods at once."
                   : "";
      case ArmError::communication_constraints_violation:
        return who_was_late();
      default:
        return is_of_motion(error)
                   ? "The error concerns commanded motion, but multipanda sends torques: another program or "
                     "a motion of the arm itself caused it."
                   : "";
    }
  }

  double answered() const {
    std::uint64_t answers = 0;
    const std::uint64_t first = cycles_.front().arm.sequence, last = last_.sequence;
    for (const auto& c : cycles_) answers += c.arm.due ? 1 : 0;
    const std::uint64_t periods = last >= first ? last - first + 1 : cycles_.size();
    return periods == 0 ? 0 : std::min(1.0, static_cast<double>(answers) / static_cast<double>(periods));
  }

  // Numbers of states that were lost or arrived too late to be answered.
  std::uint64_t missed_in_row() const {
    std::uint64_t worst = 0, before = cycles_.front().arm.sequence;
    for (const auto& c : cycles_) {
      if (!c.arm.due) continue;
      if (c.arm.sequence > before + 1) worst = std::max(worst, c.arm.sequence - before - 1);
      before = c.arm.sequence;
    }
    if (!cycles_.back().arm.due && last_.sequence > before) worst = std::max(worst, last_.sequence - before);
    return worst;
  }

 private:
  static bool is_of_motion(ArmError error) {
    const auto name = to_string(error);
    return name.find("motion_generator") != std::string_view::npos ||
           name.find("pose_deviation") != std::string_view::npos ||
           name.find("profile") != std::string_view::npos || name.find("p2p") != std::string_view::npos;
  }

  ReflexDetail position(ArmError error) const {
    Worst worst;
    for (std::size_t i = 0; i < n_; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const double q = last_.q[i];
      worst.see(error, k, q, limits_.motion.q_max[k], q - limits_.motion.q_max[k]);
      worst.see(error, k, q, limits_.motion.q_min[k], limits_.motion.q_min[k] - q);
    }
    return worst.detail;
  }

  ReflexDetail velocity(ArmError error) const {
    Worst worst;
    for (std::size_t i = 0; i < n_; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const double limit = limits_.velocity_margin * limits_.motion.dq_max[k];
      worst.see(error, k, last_.dq[i], limit, std::abs(last_.dq[i]) / limit);
    }
    return worst.detail;
  }

  ReflexDetail cartesian_velocity(ArmError error) {
    ModelTerms& terms = model();
    const Vector6 V = terms.V_WE().vector;
    Worst worst;
    const auto& limit = limits_.motion.cartesian;
    const double linear = limits_.velocity_margin * limit.velocity;
    const double angular = limits_.velocity_margin * limit.rotation_velocity;
    if (linear > 0) worst.see(error, 0, V.head<3>().norm(), linear, V.head<3>().norm() / linear);
    if (angular > 0) worst.see(error, 3, V.tail<3>().norm(), angular, V.tail<3>().norm() / angular);
    return worst.detail;
  }

  // Only pairs of parts of the arm, which does not know its environment.
  ReflexDetail self_collision(ArmError error) {
    ModelTerms& terms = model();
    const auto& shapes = limits_.model->collision_shapes();
    const auto placed = [&](const CollisionShape& shape) {
      return shape.joint < 0 ? limits_.model->X_WB() * shape.X_JS
                             : terms.X_WJ(static_cast<std::size_t>(shape.joint)) * shape.X_JS;
    };
    double nearest = kTooNear;
    nearest_names_.clear();
    for (const auto& [a, b] : limits_.model->self_pairs()) {
      const double d =
          closest_points(shapes[a].shape, placed(shapes[a]), shapes[b].shape, placed(shapes[b])).distance;
      if (d >= nearest) continue;
      nearest = d;
      nearest_names_ = fmt::format("{} and {}, {:.1f} mm apart", shapes[a].name, shapes[b].name, 1000 * d);
    }
    if (nearest_names_.empty()) return {};
    return {.error = error, .value = nearest, .limit = limits_.self_distance.value_or(0)};
  }

  ReflexDetail torque_beyond(ArmError error) const {
    if (!last_.has_tau_ext || limits_.beside_moving_base) return {};
    Worst worst;
    for (std::size_t i = 0; i < n_; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const double limit = limits_.thresholds ? limits_.thresholds->nominal.torque_upper[k] : 0;
      const double size = std::abs(last_.tau_ext[i]);
      worst.see(error, k, last_.tau_ext[i], limit, size - limit);
    }
    return worst.detail;
  }

  ReflexDetail wrench_beyond(ArmError error) {
    if (!last_.has_wrench_estimate || limits_.beside_moving_base) return {};
    const Matrix3 R_KW = model().X_WK().rotation.transpose();
    Vector6 F_K_W;
    std::copy_n(last_.F_K_W_est.begin(), 6, F_K_W.data());
    Vector6 F_K_K;
    F_K_K << R_KW * F_K_W.head<3>(), R_KW * F_K_W.tail<3>();
    Worst worst;
    for (Eigen::Index k = 0; k < 6; ++k) {
      const double limit = limits_.thresholds ? limits_.thresholds->nominal.wrench_upper[k] : 0;
      const double size = std::abs(F_K_K[k]);
      worst.see(error, k, F_K_K[k], limit, size - limit);
    }
    return worst.detail;
  }

  ReflexDetail power(ArmError error) const {
    double power = 0;
    for (std::size_t i = 0; i < n_; ++i) power += std::abs(last_.tau_J[i] * last_.dq[i]);
    return {.error = error, .value = power, .limit = limits_.power_max.value_or(0)};
  }

  ReflexDetail torque_range(ArmError error) const {
    Worst worst;
    for (std::size_t i = 0; i < n_; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      worst.see(error, k, last_.tau_J[i], limits_.tau_max[k], std::abs(last_.tau_J[i]) / limits_.tau_max[k]);
    }
    return worst.detail;
  }

  // The largest step between two successive commands: the arm assumes one period between them.
  // The command of the last cycle came after the error.
  ReflexDetail torque_step(ArmError error) const {
    Worst worst;
    const ArmSample* before = nullptr;
    for (const auto& c : cycles_.first(cycles_.size() - 1)) {
      if (!c.arm.due) continue;
      if (before != nullptr) {
        for (std::size_t i = 0; i < n_; ++i) {
          const auto k = static_cast<Eigen::Index>(i);
          const double rate = std::abs(c.arm.tau_cmd[i] - before->tau_cmd[i]) / kArmPeriod;
          worst.see(error, k, rate, limits_.tau_rate_max[k], rate / limits_.tau_rate_max[k]);
        }
      }
      before = &c.arm;
    }
    return worst.detail;
  }

  // The times of the cycles tell whether controllers, this computer or the network caused the error.
  std::string who_was_late() const {
    double slowest_us = 0, longest_ms = 0;
    std::size_t at = 0;
    for (std::size_t i = 0; i < cycles_.size(); ++i) {
      slowest_us = std::max(slowest_us, static_cast<double>(cycles_[i].total_ns) * 1e-3);
      if (i > 0 && cycles_[i].period_s * 1e3 > longest_ms) {
        longest_ms = cycles_[i].period_s * 1e3;
        at = i;
      }
    }
    std::size_t silent = 0, in_row = 0;
    for (const auto& c : cycles_) {
      in_row = !c.arm.due && c.others_due ? in_row + 1 : 0;
      silent = std::max(silent, in_row);
    }
    if (silent >= 3) {
      return fmt::format(
          "Packets of other arms arrived for {} cycles while those of this arm did not: the cause is the "
          "connection to "
          "this arm (cable, switch, its control unit).",
          silent);
    }
    if (slowest_us > kSlow_us) {
      return fmt::format(
          "A cycle took {:.0f} us to compute: the cause is the controllers or an interruption of them.",
          slowest_us);
    }
    if (longest_ms > 2) {
      return fmt::format(
          "No cycle began for {:.1f} ms before cycle {}: this computer stalled or the network was silent; "
          "'multipanda doctor' shows which.",
          longest_ms, cycles_[at].cycle);
    }
    return "Every received state was answered in time: the commands were lost or late on the way to the arm.";
  }

  ModelTerms& model() {
    if (!terms_) {
      terms_.emplace(limits_.model);
      terms_->set_config(limits_.frames, limits_.tool, limits_.load);
      terms_->update(joints(last_.q, n_), joints(last_.dq, n_));
    }
    return *terms_;
  }

  std::span<const ArmCycle> cycles_;
  const ArmErrorLimits& limits_;
  std::size_t n_;
  const ArmSample& last_;
  std::optional<ModelTerms> terms_;
  std::string nearest_names_;
};

// Estimated from measurements whose own limits were checked first.
bool is_contact(ArmError error) {
  return error == ArmError::joint_reflex || error == ArmError::cartesian_reflex;
}

// A limit of zero means unpublished: only the value is shown.
std::string sentence_of(ArmError error, const ReflexDetail& detail) {
  if (!detail) return std::string(explain(error)) + " The records do not show where and by how much.";
  std::string text = describe(detail);  // "What happened. (joint 4: value, limit x N m)"
  if (const auto at = text.find(". ("); at != std::string::npos)
    text = fmt::format("{}{}.", text.substr(0, at), text.substr(at + 1));
  const auto none = text.rfind(", limit 0 ");
  return none == std::string::npos ? text : fmt::format("{}{}", text.substr(0, none), text.substr(none + 9));
}

}  // namespace

ErrorExplanation explain(std::uint64_t errors, std::span<const ArmCycle> cycles,
                         const ArmErrorLimits& limits) {
  ErrorExplanation result;
  if (cycles.empty()) return result;
  Case records(cycles, limits);
  for (std::size_t i = 0; i < kErrors; ++i) {
    if ((errors >> i & 1u) == 0) continue;
    const auto error = static_cast<ArmError>(i);
    const ReflexDetail detail = records.detail_of(error);
    if (!result.detail || (is_contact(result.detail.error) && detail)) result.detail = detail;
    std::string sentence = fmt::format("{}: {}", to_string(error), sentence_of(error, detail));
    const std::string remark = records.remark(error, detail);
    if (!remark.empty()) sentence += " " + remark;
    result.sentences.push_back(std::move(sentence));
    if (std::find(result.cures.begin(), result.cures.end(), cure(error)) == result.cures.end())
      result.cures.emplace_back(cure(error));
  }
  if (errors >> kErrors != 0) {
    result.sentences.emplace_back("The arm reports an error that is unknown to this program.");
    result.cures.emplace_back("see the arm's own log");
  }
  result.cycles = cycles.size();
  result.answered = records.answered();
  result.missed_in_row = records.missed_in_row();
  return result;
}

}  // namespace multipanda
