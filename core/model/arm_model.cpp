#include "core/model/arm_model.hpp"

#include <random>
#include <stdexcept>
#include <urdf_parser/urdf_parser.h>

#include "core/model/model_terms.hpp"
#include "core/model/pinocchio_model.hpp"
#include "core/types/triangular.hpp"

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

pinocchio::SE3 pose_of(const urdf::Pose& X) {
  const auto& [x, y, z, w] = X.rotation;
  return {Eigen::Quaterniond(w, x, y, z).matrix(), Vector3(X.position.x, X.position.y, X.position.z)};
}

pinocchio::Inertia inertia_of(const urdf::Inertial& body) {
  const pinocchio::SE3 X = pose_of(body.origin);
  Matrix3 inertia;
  inertia << body.ixx, body.ixy, body.ixz, body.ixy, body.iyy, body.iyz, body.ixz, body.iyz, body.izz;
  return {body.mass, X.translation(), X.rotation() * inertia * X.rotation().transpose()};
}

template <class X, class Y, class Z, class Any>
pinocchio::JointModel joint_along(const Vector3& axis) {
  if (axis == Vector3::UnitX()) return X();
  if (axis == Vector3::UnitY()) return Y();
  if (axis == Vector3::UnitZ()) return Z();
  return Any(axis.normalized());
}

// Builds the tree as Pinocchio's own reader does (dynamics_test.cpp compares them). That one's libraries,
// with meshes, collisions and octrees, would be 27 MB of every process.
class ModelBuilder {
 public:
  ModelBuilder(ArmModel::Pinocchio& to, const ArmModelSource& source) : to_(to), source_(source) {}

  // Returns the joint that moves the flange.
  pinocchio::JointIndex build() {
    const auto tree = urdf::parseURDF(source_.urdf);
    if (tree == nullptr || tree->getRoot() == nullptr)
      refuse(source_.name, "the URDF cannot be read; its faults were printed to standard error");
    add(*tree->getRoot(), 0, pinocchio::SE3::Identity());
    if (!flange_joint_) refuse(source_.name, "the URDF has no link '" + source_.flange + "'");
    return *flange_joint_;
  }

 private:
  // `X_JL`: in the frame of the joint that moves the link.
  void add(const urdf::Link& link, pinocchio::JointIndex joint, const pinocchio::SE3& X_JL) {
    if (link.inertial) to_.model.appendBodyToJoint(joint, inertia_of(*link.inertial), X_JL);
    if (link.name == source_.flange) {
      flange_joint_ = joint;
      to_.X_JF = X_JL;
    }
    for (const auto& child : link.child_links) {
      const urdf::Joint& own = *child->parent_joint;
      const pinocchio::SE3 X_JC = X_JL * pose_of(own.parent_to_joint_origin_transform);
      if (own.type == urdf::Joint::FIXED) {
        add(*child, joint, X_JC);
      } else {
        add(*child, add_joint(own, joint, X_JC), pinocchio::SE3::Identity());
      }
    }
  }

  pinocchio::JointIndex add_joint(const urdf::Joint& own, pinocchio::JointIndex parent,
                                  const pinocchio::SE3& X_JC) {
    const Vector3 axis(own.axis.x, own.axis.y, own.axis.z);
    const auto value = [](double number) { return Eigen::VectorXd::Constant(1, number); };
    pinocchio::JointModel type;
    if (own.type == urdf::Joint::REVOLUTE) {
      type = joint_along<pinocchio::JointModelRX, pinocchio::JointModelRY, pinocchio::JointModelRZ,
                         pinocchio::JointModelRevoluteUnaligned>(axis);
    } else if (own.type == urdf::Joint::PRISMATIC) {
      type = joint_along<pinocchio::JointModelPX, pinocchio::JointModelPY, pinocchio::JointModelPZ,
                         pinocchio::JointModelPrismaticUnaligned>(axis);
    } else {
      refuse(source_.name, "the URDF has a joint with several coordinates or without limits, '" + own.name +
                               "'; expected revolute and prismatic joints");
    }
    return to_.model.addJoint(parent, type, X_JC, own.name, value(own.limits->effort),
                              value(own.limits->velocity), value(own.limits->lower),
                              value(own.limits->upper));
  }

  ArmModel::Pinocchio& to_;
  const ArmModelSource& source_;
  std::optional<pinocchio::JointIndex> flange_joint_;
};

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
  const pinocchio::JointIndex flange_joint = ModelBuilder(p, source_).build();
  joint_count_ = static_cast<std::size_t>(p.model.nv);
  if (joint_count_ == 0 || joint_count_ > kMaxJoints) {
    refuse(source_.name, "the URDF has " + std::to_string(joint_count_) + " joints; expected 1 to " +
                             std::to_string(kMaxJoints));
  }
  for (pinocchio::JointIndex j = 1; j < p.model.joints.size(); ++j) {
    if (p.model.parents[j] != j - 1) refuse(source_.name, "the URDF branches; expected a chain of joints");
    prismatic_.push_back(p.model.joints[j].shortname().starts_with("JointModelP"));
  }
  p.last_joint = p.model.joints.size() - 1;
  if (flange_joint != p.last_joint) {
    refuse(source_.name, "flange link '" + source_.flange + "' must be behind the last joint");
  }
  const pinocchio::SE3 X_WB(source_.X_WB.rotation, source_.X_WB.position);
  p.model.jointPlacements[1] = X_WB * p.model.jointPlacements[1];
  p.model.gravity.linear() = Vector3(0, 0, -9.81);

  auto& limits = source_.limits;
  complete(limits.q_min, p.model.lowerPositionLimit, source_.name, "q_min");
  complete(limits.q_max, p.model.upperPositionLimit, source_.name, "q_max");
  complete(limits.dq_max, p.model.upperVelocityLimit, source_.name, "dq_max");
  complete(limits.tau_max, p.model.upperEffortLimit, source_.name, "tau_max");
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

namespace {

constexpr int kDrawnPoses = 48;  // the home configuration and seeded ones over the range of every joint

JointVector drawn_pose(const ArmModel& model, int k, std::mt19937& engine) {
  JointVector q = model.q_home();
  const ArmLimits& limits = model.limits();
  for (Eigen::Index i = 0; k > 0 && i < q.size(); ++i) {
    const double share = static_cast<double>(engine()) / static_cast<double>(std::mt19937::max());
    q[i] = limits.q_min[i] + share * (limits.q_max[i] - limits.q_min[i]);
  }
  return q;
}

// 1 / (M^-1)_ii: the inertia that a torque of joint i alone accelerates while all other joints are free.
void keep_least(const JointMatrix& M, JointVector& least) {
  JointMatrix L;
  if (!cholesky_factor(M, L)) return;
  for (Eigen::Index i = 0; i < M.cols(); ++i) {
    const JointVector e = JointVector::Unit(M.cols(), i);
    least[i] = std::min(least[i], 1.0 / cholesky_solve(L, e)[i]);
  }
}

}  // namespace

const JointVector& ArmModel::least_inertia() const {
  std::call_once(least_->once, [this] {
    ModelTerms terms(std::shared_ptr<const ArmModel>(std::shared_ptr<void>(), this));
    terms.set_config({}, source_.tool, {});
    std::mt19937 engine(1);
    JointVector least = JointVector::Constant(static_cast<Eigen::Index>(joint_count_), 1e9);
    for (int k = 0; k < kDrawnPoses; ++k) {
      terms.update(drawn_pose(*this, k, engine), JointVector::Zero(least.size()));
      JointMatrix M = terms.M();
      if (source_.known_motor_inertia.size() == least.size()) M.diagonal() -= source_.known_motor_inertia;
      if (source_.motor_inertia.size() == least.size()) M.diagonal() += source_.motor_inertia;
      keep_least(M, least);
    }
    least_->inertia = least;
  });
  return least_->inertia;
}

}  // namespace multipanda
