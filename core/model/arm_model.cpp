#include "core/model/arm_model.hpp"

#include <stdexcept>

#include <pinocchio/parsers/urdf.hpp>

#include "core/model/pinocchio_model.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse(const std::string& arm, const std::string& why) {
  throw std::invalid_argument("model of arm '" + arm + "': " + why);
}

// Fills an empty limit from the URDF, checks the size of a given one.
void complete(JointVector& limit, const Eigen::VectorXd& from_urdf, const std::string& arm,
              const char* what) {
  if (limit.size() == 0) limit = from_urdf;
  if (limit.size() != from_urdf.size()) {
    refuse(arm, std::string(what) + " has " + std::to_string(limit.size()) + " values, the URDF has " +
                    std::to_string(from_urdf.size()) + " joints");
  }
  if (!limit.allFinite()) refuse(arm, std::string(what) + " must be finite for every joint");
}

void check_collision_shapes(const ArmModelSource& source, std::size_t joint_count) {
  const auto& shapes = source.collision_shapes;
  for (const auto& part : shapes) {
    if (part.joint < -1 || part.joint >= static_cast<int>(joint_count)) {
      refuse(source.name, "collision shape '" + part.name + "' is at joint " + std::to_string(part.joint) +
                              "; expected -1 (base) to " + std::to_string(joint_count - 1));
    }
    if (part.shape.kind == ConvexShape::Kind::half_space) {
      refuse(source.name, "collision shape '" + part.name + "' is a half space; expected a bounded shape");
    }
  }
  for (const auto& [a, b] : source.self_pairs) {
    if (a >= shapes.size() || b >= shapes.size() || shapes[a].joint == shapes[b].joint) {
      refuse(source.name, "a pair of collision shapes must name two existing shapes on different links");
    }
  }
}

}  // namespace

JointVector joint_constant(std::size_t n, double value) {
  return JointVector::Constant(static_cast<Eigen::Index>(n), value);
}

pinocchio::Inertia inertia_in_joint(const pinocchio::SE3& X_JF, const Load& load) {
  return X_JF.act(pinocchio::Inertia(load.mass, load.p_FC, load.inertia_C));
}

ArmModel::ArmModel(ArmModelSource source)
    : source_(std::move(source)), pinocchio_(std::make_unique<Pinocchio>()) {
  auto& p = *pinocchio_;
  try {
    pinocchio::urdf::buildModelFromXML(source_.urdf, p.model);
  } catch (const std::exception& error) {
    refuse(source_.name, std::string("cannot read the URDF: ") + error.what());
  }
  if (p.model.nq != p.model.nv)
    refuse(source_.name,
           "the URDF has a joint with several coordinates; expected revolute and prismatic joints");
  joint_count_ = static_cast<std::size_t>(p.model.nv);
  if (joint_count_ == 0 || joint_count_ > kMaxJoints) {
    refuse(source_.name, "the URDF has " + std::to_string(joint_count_) + " joints; expected 1 to " +
                             std::to_string(kMaxJoints));
  }
  for (pinocchio::JointIndex j = 1; j < p.model.joints.size(); ++j) {
    if (p.model.parents[j] != j - 1) refuse(source_.name, "the URDF branches; expected a chain of joints");
    prismatic_.push_back(p.model.joints[j].shortname().starts_with("JointModelP"));
  }
  if (!p.model.existFrame(source_.flange))
    refuse(source_.name, "the URDF has no link '" + source_.flange + "'");
  p.flange = p.model.getFrameId(source_.flange);
  p.last_joint = p.model.joints.size() - 1;
  if (p.model.frames[p.flange].parentJoint != p.last_joint) {
    refuse(source_.name, "flange link '" + source_.flange + "' must be behind the last joint");
  }
  p.X_JF = p.model.frames[p.flange].placement;
  const pinocchio::SE3 X_WB(source_.X_WB.rotation, source_.X_WB.position);
  p.model.jointPlacements[1] = X_WB * p.model.jointPlacements[1];
  p.model.gravity.linear() = Vector3(0, 0, -9.81);

  auto& limits = source_.limits;
  complete(limits.q_min, p.model.lowerPositionLimit, source_.name, "q_min");
  complete(limits.q_max, p.model.upperPositionLimit, source_.name, "q_max");
  complete(limits.dq_max, p.model.velocityLimit, source_.name, "dq_max");
  complete(limits.tau_max, p.model.effortLimit, source_.name, "tau_max");
  const Eigen::VectorXd generous = Eigen::VectorXd::Constant(p.model.nv, 1000.0);
  complete(limits.ddq_max, generous, source_.name, "ddq_max");
  complete(limits.tau_rate_max, generous, source_.name, "tau_rate_max");
  if ((limits.q_min.array() >= limits.q_max.array()).any()) refuse(source_.name, "q_min must be below q_max");
  if (const auto& friction = source_.known_friction) {
    for (const JointVector* figures : {&friction->p1, &friction->p2, &friction->p3}) {
      if (figures->size() != p.model.nv) refuse(source_.name, "known_friction must have one value per joint");
    }
  }
  if (source_.q_home.size() == 0) source_.q_home = 0.5 * (limits.q_min + limits.q_max);
  if (source_.q_home.size() != p.model.nv) refuse(source_.name, "q_home must have one value per joint");
  if (source_.motor_inertia.size() != 0 && source_.motor_inertia.size() != p.model.nv) {
    refuse(source_.name, "motor_inertia must have one value per joint");
  }
  if (source_.known_motor_inertia.size() != 0 && source_.known_motor_inertia.size() != p.model.nv) {
    refuse(source_.name, "known_motor_inertia must have one value per joint");
  }
  check_collision_shapes(source_, joint_count_);
}

ArmModel::~ArmModel() = default;

JointRange ArmModel::joint_range() const {
  JointRange range{.min = source_.limits.q_min, .max = source_.limits.q_max};
  for (std::size_t i = 0; i < joint_count_; ++i) range.prismatic |= (prismatic_[i] ? 1u : 0u) << i;
  return range;
}

}  // namespace multipanda
