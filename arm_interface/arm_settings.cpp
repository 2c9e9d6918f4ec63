#include "arm_interface/arm_settings.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include <Eigen/Eigenvalues>

#include "core/types/overloaded.hpp"

namespace multipanda {

namespace {

// Upper bounds for any arm: larger values would make the simulation diverge.
constexpr double kMostMass = 100, kMostLength = 10;  // [kg], [m]

// Franka's ranges
constexpr double kMostJointStiffness = 14250;  // [N m/rad]
const Vector6 kMostCartesianStiffness = (Vector6() << 3000, 3000, 3000, 300, 300, 300).finished();

std::string check_positive(const auto& values, std::size_t expected, const char* name) {
  if (static_cast<std::size_t>(values.size()) != expected) {
    return std::string(name) + ": expected " + std::to_string(expected) + " values, found " +
           std::to_string(values.size());
  }
  if (!values.allFinite() || (values.array() < 0).any()) {
    return std::string(name) + " must be finite and not negative";
  }
  return {};
}

}  // namespace

ArmSettings default_settings(const ArmModel& model) {
  const auto n = model.joint_count();
  ArmSettings settings;
  settings.joint_stiffness = joint_constant(n, 2000);
  settings.cartesian_stiffness << 3000, 3000, 3000, 300, 300, 300;
  ContactThresholds& limit = settings.thresholds.nominal;
  limit.torque_lower = limit.torque_upper = model.limits().tau_max;
  limit.wrench_lower = limit.wrench_upper = Vector6::Constant(100);
  settings.guiding = {.axes = {true, true, true, true, true, true}, .elbow = true};
  return settings;
}

SetCollisionThresholds careful_thresholds(const ArmModel& model,
                                          const std::optional<SetCollisionThresholds>& given) {
  const auto n = model.joint_count();
  const JointVector& most = model.limits().tau_max;
  SetCollisionThresholds set;
  set.nominal.torque_lower = most.cwiseMin(joint_constant(n, 20));
  set.nominal.torque_upper = most.cwiseMin(joint_constant(n, 40));
  set.nominal.wrench_lower << 20, 20, 20, 10, 10, 10;
  set.nominal.wrench_upper << 80, 80, 80, 25, 25, 25;
  if (!given) return set;
  const auto lower = [](ContactThresholds set, const ContactThresholds& most) {
    set.torque_lower = JointVector(set.torque_lower.cwiseMin(most.torque_lower));
    set.torque_upper = JointVector(set.torque_upper.cwiseMin(most.torque_upper));
    set.wrench_lower = Vector6(set.wrench_lower.cwiseMin(most.wrench_lower));
    set.wrench_upper = Vector6(set.wrench_upper.cwiseMin(most.wrench_upper));
    return set;
  };
  if (given->acceleration) set.acceleration = lower(*given->acceleration, set.nominal);
  set.nominal = lower(given->nominal, set.nominal);
  return set;
}

std::string check_pose(const Pose& X, const char* name) {
  if (X.position.allFinite() && X.position.norm() <= kMostLength && X.rotation.allFinite() &&
      (X.rotation.transpose() * X.rotation).isIdentity(1e-6) && X.rotation.determinant() > 0) {
    return {};
  }
  return std::string(name) + " must be a position within 10 m and a rotation";
}

std::string check_load(const Load& load) {
  if (!std::isfinite(load.mass) || load.mass < 0) return "the load's mass must be 0 or more kilograms";
  if (load.mass > kMostMass || load.p_FC.norm() > kMostLength)
    return "the load is too large: at most 100 kg within 10 m of the flange";
  if (!load.p_FC.allFinite() || !load.inertia_C.allFinite()) return "the load has a value that is not finite";
  if ((load.inertia_C - load.inertia_C.transpose()).norm() > 1e-9) {
    return "the load's inertia must be a symmetric matrix";
  }
  const Vector3 principal = Eigen::SelfAdjointEigenSolver<Matrix3>(load.inertia_C).eigenvalues();
  if (principal[0] < -1e-9 || principal[0] + principal[1] < principal[2] - 1e-9) {
    return "the load's inertia is not physically consistent: principal moments must be positive and none may "
           "exceed the sum of the others";
  }
  // A radius of gyration of 1 m exceeds that of any object an arm carries.
  if (principal[2] > std::max(load.mass, 1e-3)) return "the load's inertia is that of a body larger than 1 m";
  return {};
}

namespace {

std::string check_end_effector(const Pose& X_FE, const ArmModel& model) {
  std::string why = check_pose(X_FE, "X_FE");
  const double most = model.farthest_end_effector();
  if (!why.empty() || X_FE.position.norm() <= most) return why;
  std::array<char, 320> text;
  std::snprintf(text.data(), text.size(),
                "X_FE is %.4g m from the flange of arm '%s': at most %.4g m; if its tool is longer, set "
                "'farthest_end_effector_m' of the arm in the scene",
                X_FE.position.norm(), model.name().c_str(), most);
  return text.data();
}

std::string check_load(const Load& load, const ArmModel& model) {
  if (auto why = check_load(load); !why.empty()) return why;
  std::array<char, 320> text;
  // A center of mass too far out for the weakest joint is a mistake; compensating it would push the arm up.
  constexpr double kGravity = 9.81;
  const double moment = kGravity * load.mass * load.p_FC.norm();
  double most = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    if (!model.is_prismatic(i)) most = std::min(most, model.limits().tau_max[static_cast<Eigen::Index>(i)]);
  }
  if (moment > most) {
    std::snprintf(
        text.data(), text.size(),
        "a payload of %.4g kg whose center of mass is %.4g m from the flange weighs %.3g N m there, more "
        "than the weakest joint of arm '%s' can carry (%.3g N m): check the center of mass",
        load.mass, load.p_FC.norm(), moment, model.name().c_str(), most);
    return text.data();
  }
  if (!model.largest_load() || load.mass <= *model.largest_load()) return {};
  std::snprintf(
      text.data(), text.size(),
      "a payload of %.4g kg is too heavy for arm '%s': at most %.4g kg besides hand and tool; if it can "
      "carry more, set 'largest_load_kg' of the arm in the scene",
      load.mass, model.name().c_str(), *model.largest_load());
  return text.data();
}

}  // namespace

std::string check_request(const ArmRequest& request, const ArmModel& model) {
  const std::size_t n = model.joint_count();
  const auto first_of = [](std::initializer_list<std::string> reasons) {
    for (const auto& reason : reasons) {
      if (!reason.empty()) return reason;
    }
    return std::string{};
  };
  return std::visit(
      Overloaded{[&](const SetLoad& r) { return check_load(r.load, model); },
                 [&](const SetFrames& r) {
                   return first_of({r.X_FE ? check_end_effector(*r.X_FE, model) : std::string{},
                                    r.X_EK ? check_pose(*r.X_EK, "X_EK") : std::string{}});
                 },
                 [&](const SetJointStiffness& r) {
                   const auto why = check_positive(r.stiffness, n, "the joint stiffness");
                   if (!why.empty() || (r.stiffness.array() <= kMostJointStiffness).all()) return why;
                   return std::string("the joint stiffness must be at most 14250 N m/rad");
                 },
                 [](const SetCartesianStiffness& r) {
                   const auto why = check_positive(r.stiffness, 6, "the Cartesian stiffness");
                   if (!why.empty() || (r.stiffness.array() <= kMostCartesianStiffness.array()).all())
                     return why;
                   return std::string("the Cartesian stiffness must be at most 3000 N/m and 300 N m/rad");
                 },
                 [&](const SetCollisionThresholds& r) {
                   // As in scenes; a joint's own limit may be larger on an axis.
                   constexpr double kMost = 1000;  // [N, N m]
                   const auto most = model.limits().tau_max.cwiseMax(kMost).array();
                   const auto why = [&](const ContactThresholds& t) {
                     const std::string wrong =
                         first_of({check_positive(t.torque_lower, n, "the lower torque thresholds"),
                                   check_positive(t.torque_upper, n, "the upper torque thresholds"),
                                   check_positive(t.wrench_lower, 6, "the lower wrench thresholds"),
                                   check_positive(t.wrench_upper, 6, "the upper wrench thresholds")});
                     if (!wrong.empty()) return wrong;
                     const bool usual =
                         (t.torque_lower.array() <= most).all() && (t.torque_upper.array() <= most).all() &&
                         std::max(t.wrench_lower.maxCoeff(), t.wrench_upper.maxCoeff()) <= kMost;
                     return usual ? wrong : "thresholds must be at most 1000 N and 1000 N m";
                   };
                   return first_of({why(r.nominal), r.acceleration ? why(*r.acceleration) : std::string{}});
                 },
                 [](const auto&) { return std::string{}; }},
      request);
}

// Default end effector "Franka Hand" of the arms' web interface, as libfranka programs print it.
Load manufacturers_hand_as_declared() {
  return {.mass = 0.73,
          .p_FC = {-0.01, 0, 0.03},
          .inertia_C = Vector3(0.001, 0.0025, 0.0017).asDiagonal().toDenseMatrix()};
}

Load declared_hand(const Load& hand) {
  constexpr double kMass = 0.03, kMoment = 0.02;  // [kg], [kg m]; the parts differ by 0.0174 and 0.0144
  const Load declared = manufacturers_hand_as_declared();
  const bool same = std::abs(hand.mass - declared.mass) < kMass &&
                    (hand.mass * hand.p_FC - declared.mass * declared.p_FC).norm() < kMoment;
  return same ? declared : hand;
}

}  // namespace multipanda
