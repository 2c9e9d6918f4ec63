#include "core/model/arm_model.hpp"

#include <random>
#include <stdexcept>
#include <urdf_parser/urdf_parser.h>

#include "core/model/model_terms.hpp"
#include "core/model/pinocchio_chain.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {

namespace {

[[noreturn]] void refuse(const std::string& arm, const std::string& why) {
  throw std::invalid_argument("model of arm '" + arm + "': " + why);
}

// Fills an empty limit from the URDF, checks the size of a given one.
void complete(JointVector& limit, const JointVector& from_urdf, const std::string& arm, const char* what) {
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

// Builds the chain as Pinocchio's own reader does (dynamics_test.cpp compares them). That one's libraries,
// with meshes, collisions and octrees, would be 27 MB of every process.
class ChainBuilder {
 public:
  ChainBuilder(ArmModel::Chain& to, const ArmModelSource& source) : to_(to), source_(source) {}

  void build() {
    const auto tree = urdf::parseURDF(source_.urdf);
    if (tree == nullptr || tree->getRoot() == nullptr)
      refuse(source_.name, "the URDF cannot be read; its faults were printed to standard error");
    add(*tree->getRoot(), kBase, pinocchio::SE3::Identity());
    if (!flange_joint_) refuse(source_.name, "the URDF has no link '" + source_.flange + "'");
    const std::size_t n = to_.joints.size();
    if (n == 0 || n > kMaxJoints) {
      refuse(source_.name,
             "the URDF has " + std::to_string(n) + " joints; expected 1 to " + std::to_string(kMaxJoints));
    }
    if (branches_) refuse(source_.name, "the URDF branches; expected a chain of joints");
    if (*flange_joint_ + 1 != static_cast<int>(n))
      refuse(source_.name, "flange link '" + source_.flange + "' must be behind the last joint");
  }

 private:
  static constexpr int kBase = -1;

  // `X_JL`: in the frame of the joint that moves the link.
  void add(const urdf::Link& link, int joint, const pinocchio::SE3& X_JL) {
    if (link.inertial)
      (joint == kBase ? to_.base : to_.joints[static_cast<std::size_t>(joint)].link) +=
          X_JL.act(inertia_of(*link.inertial));
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
        branches_ = branches_ || joint + 1 != static_cast<int>(to_.joints.size());
        add_joint(own, X_JC);
        add(*child, static_cast<int>(to_.joints.size()) - 1, pinocchio::SE3::Identity());
      }
    }
  }

  void add_joint(const urdf::Joint& own, const pinocchio::SE3& X_PJ) {
    if (own.type != urdf::Joint::REVOLUTE && own.type != urdf::Joint::PRISMATIC) {
      refuse(source_.name, "the URDF has a joint with several coordinates or without limits, '" + own.name +
                               "'; expected revolute and prismatic joints");
    }
    const Vector3 axis(own.axis.x, own.axis.y, own.axis.z);
    if (!(axis.norm() > 1e-6)) refuse(source_.name, "the axis of joint '" + own.name + "' has no direction");
    to_.joints.emplace_back(own.type == urdf::Joint::PRISMATIC, axis, X_PJ);
    if (to_.joints.size() > kMaxJoints) return;
    const auto append = [](JointVector& to, double value) {
      to.conservativeResize(to.size() + 1);
      to[to.size() - 1] = value;
    };
    append(to_.limits.tau_max, own.limits->effort);
    append(to_.limits.dq_max, own.limits->velocity);
    append(to_.limits.q_min, own.limits->lower);
    append(to_.limits.q_max, own.limits->upper);
  }

  ArmModel::Chain& to_;
  const ArmModelSource& source_;
  std::optional<int> flange_joint_;
  bool branches_ = false;
};

}  // namespace

ChainJoint::ChainJoint(bool is_prismatic, const Vector3& along, const pinocchio::SE3& at_zero)
    : prismatic(is_prismatic), axis(along.normalized()), X_PJ(at_zero) {
  for (int i = 0; i < 3; ++i)
    if (along == Vector3::Unit(i)) coordinate = i;
}

JointVector joint_constant(std::size_t n, double value) {
  return JointVector::Constant(static_cast<Eigen::Index>(n), value);
}

pinocchio::Inertia inertia_in_joint(const pinocchio::SE3& X_JF, const Load& load) {
  return X_JF.act(pinocchio::Inertia(load.mass, load.p_FC, load.inertia_C));
}

ArmModel::ArmModel(ArmModelSource source) : source_(std::move(source)), chain_(std::make_unique<Chain>()) {
  ChainBuilder(*chain_, source_).build();
  auto& joints = chain_->joints;
  joint_count_ = joints.size();
  joints.front().X_PJ = pinocchio::SE3(source_.X_WB.rotation, source_.X_WB.position) * joints.front().X_PJ;

  auto& limits = source_.limits;
  const ArmLimits& of_urdf = chain_->limits;
  complete(limits.q_min, of_urdf.q_min, source_.name, "q_min");
  complete(limits.q_max, of_urdf.q_max, source_.name, "q_max");
  complete(limits.dq_max, of_urdf.dq_max, source_.name, "dq_max");
  complete(limits.tau_max, of_urdf.tau_max, source_.name, "tau_max");
  const JointVector generous = joint_constant(joint_count_, 1000);
  complete(limits.ddq_max, generous, source_.name, "ddq_max");
  complete(limits.tau_rate_max, generous, source_.name, "tau_rate_max");
  if ((limits.q_min.array() >= limits.q_max.array()).any()) refuse(source_.name, "q_min must be below q_max");
  if (const auto& friction = source_.known_friction) {
    for (const JointVector* figures : {&friction->p1, &friction->p2, &friction->p3}) {
      if (figures->size() != of_urdf.q_min.size())
        refuse(source_.name, "known_friction must have one value per joint");
    }
  }
  if (source_.q_home.size() == 0) source_.q_home = 0.5 * (limits.q_min + limits.q_max);
  if (source_.q_home.size() != of_urdf.q_min.size())
    refuse(source_.name, "q_home must have one value per joint");
  if (source_.motor_inertia.size() != 0 && source_.motor_inertia.size() != of_urdf.q_min.size()) {
    refuse(source_.name, "motor_inertia must have one value per joint");
  }
  if (source_.known_motor_inertia.size() != 0 && source_.known_motor_inertia.size() != of_urdf.q_min.size()) {
    refuse(source_.name, "known_motor_inertia must have one value per joint");
  }
  check_collision_shapes(source_, joint_count_);
}

ArmModel::~ArmModel() = default;

bool ArmModel::is_prismatic(std::size_t joint) const { return chain_->joints[joint].prismatic; }

JointRange ArmModel::joint_range() const {
  JointRange range{.min = source_.limits.q_min, .max = source_.limits.q_max};
  for (std::size_t i = 0; i < joint_count_; ++i) range.prismatic |= (is_prismatic(i) ? 1u : 0u) << i;
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
