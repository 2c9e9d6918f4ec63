#include "models/from_urdf.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "common/own_files.hpp"
#include "common/text.hpp"
#include "core/types/rotation_between.hpp"
#include "models/load_parts.hpp"
#include "models/robot_description.hpp"
#include "models/urdf_tree.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument(why); }

Placement placement_of(const Pose& X) { return {X.position, rpy_of(X.rotation)}; }

// Extracts one arm from a robot. Segment i is the body that moves with joint i of the arm (0: the base), in a
// frame whose z axis is the axis of the joint, about which it turns or along which it slides.
class ChainReader {
 public:
  ChainReader(const UrdfTree& tree, const UrdfChain& chain) : tree_(tree), chain_(chain) {}

  std::vector<AttachedShape> shapes() {
    read();
    // Whatever base_link is fixed to belongs to the base.
    std::string root = chain_.base_link;
    Pose X_BR;
    for (const UrdfJoint* joint = tree_.parent_joint(root); joint != nullptr && joint->type == "fixed";
         joint = tree_.parent_joint(root)) {
      X_BR = X_BR * joint->X_PC.inverse();
      root = joint->parent;
    }
    attach(root, 0, {{X_BR}});
    return std::move(shapes_);
  }

  RobotDescription read() {
    check_names();
    find_path();
    bodies_.resize(arm_.size() + 1);
    robot_.joints.resize(arm_.size());
    collect(chain_.base_link, 0, Pose{});
    if (bodies_[0].mass <= 0) {  // fixed: its mass has no effect
      bodies_[0] = {1, Vector3::Zero(), 0.01 * Matrix3::Identity()};
    }
    for (std::size_t i = 1; i < bodies_.size(); ++i) check_body(i);
    robot_.links = bodies_;
    read_limits();
    finish();
    return std::move(robot_);
  }

 private:
  void check_names() const {
    for (const auto& link : {chain_.base_link, chain_.tip_link}) {
      if (tree_.links.count(link) == 0) {
        refuse("the URDF has no link " + in_quotes(link) +
               name_hint(link, tree_.link_names(), "there are none"));
      }
    }
    const auto known = [&](const std::string& joint) {
      if (tree_.joint(joint) == nullptr) {
        refuse("the URDF has no joint " + in_quotes(joint) +
               name_hint(joint, tree_.joint_names(), "there are none"));
      }
    };
    for (const auto& held : chain_.held_joints) {
      known(held.first);
      if (!std::isfinite(held.second))
        refuse("joint " + in_quotes(held.first) + " is held at a value that is not a finite number");
    }
    for (const auto& limit : chain_.limits) known(limit.first);
  }

  bool is_held(const UrdfJoint& joint) const { return chain_.held_joints.count(joint.name) > 0; }

  void find_path() {
    std::string link = chain_.tip_link;
    while (link != chain_.base_link) {
      const UrdfJoint* joint = tree_.parent_joint(link);
      if (joint == nullptr) {
        refuse("the link " + in_quotes(chain_.tip_link) + " is not a descendant of " +
               in_quotes(chain_.base_link) + "; its chain ends at " + in_quotes(link) +
               ". base_link and tip_link must be the two ends of one arm");
      }
      path_.insert(path_.begin(), joint);
      link = joint->parent;
    }
    for (const UrdfJoint* joint : path_) {
      if (joint->type == "fixed" || is_held(*joint)) continue;
      if (!joint->turns() && !joint->slides()) {
        refuse("joint " + in_quotes(joint->name) + " between base_link and tip_link is " + joint->type +
               "; expected revolute, continuous or prismatic joints. Hold it (held_joints: {" + joint->name +
               ": 0.0}), or choose a base_link behind it");
      }
      if (joint->mimic) {
        refuse("joint " + in_quotes(joint->name) + " mimics " + in_quotes(joint->mimic->joint) +
               "; coupled joints cannot be controlled separately. Hold it (held_joints)");
      }
      arm_.push_back(joint);
    }
    if (arm_.empty() || arm_.size() > kMaxJoints) {
      refuse("between " + in_quotes(chain_.base_link) + " and " + in_quotes(chain_.tip_link) + " there are " +
             std::to_string(arm_.size()) + " joints that move; expected 1 to " + std::to_string(kMaxJoints));
    }
    for (const UrdfJoint* joint : arm_) robot_.prismatic.push_back(joint->slides());
  }

  // The position of a joint that does not belong to the arm.
  double position(const UrdfJoint& joint, std::size_t depth = 0) const {
    const auto held = chain_.held_joints.find(joint.name);
    if (held != chain_.held_joints.end()) return held->second;
    if (joint.mimic) {
      const UrdfJoint* leader = tree_.joint(joint.mimic->joint);
      if (std::find(arm_.begin(), arm_.end(), leader) != arm_.end()) {
        refuse("joint " + in_quotes(joint.name) + " moves with the arm's joint " + in_quotes(leader->name) +
               "; such couplings are not supported. Hold it (held_joints: {" + joint.name + ": 0.0})");
      }
      if (depth > tree_.joints.size()) refuse("joint " + in_quotes(joint.name) + " mimics itself");
      return joint.mimic->multiplier * position(*leader, depth + 1) + joint.mimic->offset;
    }
    return std::min(std::max(0.0, joint.lower.value_or(-HUGE_VAL)), joint.upper.value_or(HUGE_VAL));
  }

  // Adds `link` and everything attached to it; X_SL is its pose in its segment.
  void collect(const std::string& link, std::size_t segment, const Pose& X_SL) {
    if (link == chain_.tip_link) robot_.flange = placement_of(X_SL);
    const RigidBody& body = tree_.links.at(link);
    if (body.mass > 0) {
      const RigidBody here = moved(body, X_SL);
      bodies_[segment] = bodies_[segment].mass > 0 ? merged(bodies_[segment], here) : here;
    }
    for (const UrdfJoint* joint : tree_.child_joints(link)) {
      const auto place = std::find(arm_.begin(), arm_.end(), joint);
      if (place != arm_.end()) {
        const auto i = static_cast<std::size_t>(place - arm_.begin());
        const Pose X_CS = axis_frame(*joint);
        robot_.joints[i] = placement_of(X_SL * joint->X_PC * X_CS);
        collect(joint->child, i + 1, X_CS.inverse());
      } else {
        const bool on_path = std::find(path_.begin(), path_.end(), joint) != path_.end();
        if (segment == 0 && !on_path && joint->type != "fixed") continue;
        collect(joint->child, segment, X_SL * joint->pose_at(position(*joint)));
      }
    }
  }

  // The frame of a segment in that of its link: z is the joint's axis.
  static Pose axis_frame(const UrdfJoint& joint) {
    return {rotation_between(Vector3::UnitZ(), joint.axis).toRotationMatrix(), Vector3::Zero()};
  }

  // Positions of a joint outside the arm at which its shapes are included.
  std::vector<double> seen_positions(const UrdfJoint& joint) const {
    if (joint.type == "fixed" || is_held(joint)) return {position(joint)};
    if (!joint.lower || !joint.upper) return {position(joint)};
    return {*joint.lower, 0.5 * (*joint.lower + *joint.upper), *joint.upper};
  }

  using Steps = std::vector<std::vector<Pose>>;
  // Behind `steps` one more with these poses. A step grows while it is small: poses multiply along a chain.
  static Steps followed_by(Steps steps, const std::vector<Pose>& poses) {
    if (steps.back().size() * poses.size() > kMostPoses) {
      steps.push_back(poses);
      return steps;
    }
    std::vector<Pose> products;
    for (const Pose& X : steps.back()) {
      for (const Pose& X_next : poses) products.push_back(X * X_next);
    }
    steps.back() = std::move(products);
    return steps;
  }

  // As collect(), for shapes.
  void attach(const std::string& link, std::size_t segment, const Steps& steps) {
    if (const auto found = tree_.collisions.find(link); found != tree_.collisions.end()) {
      for (const UrdfGeometry& shape : found->second)
        shapes_.push_back({segment, followed_by(steps, {shape.X_LG}), shape, link});
    }
    for (const UrdfJoint* joint : tree_.child_joints(link)) {
      const auto place = std::find(arm_.begin(), arm_.end(), joint);
      if (place != arm_.end()) {
        attach(joint->child, static_cast<std::size_t>(place - arm_.begin()) + 1,
               {{axis_frame(*joint).inverse()}});
        continue;
      }
      const bool on_path = std::find(path_.begin(), path_.end(), joint) != path_.end();
      if (segment == 0 && !on_path && joint->type != "fixed") continue;
      std::vector<Pose> poses;
      for (const double at : seen_positions(*joint)) poses.push_back(joint->pose_at(at));
      attach(joint->child, segment, followed_by(steps, poses));
    }
  }

  void check_body(std::size_t segment) const {
    const RigidBody& body = bodies_[segment];
    const std::string what = "the body that joint " + in_quotes(arm_[segment - 1]->name) + " moves";
    if (body.mass <= 0) {
      refuse(what + " has no mass, which computing torques requires. Give the link " +
             in_quotes(arm_[segment - 1]->child) + " an <inertial>, or hold the joint (held_joints)");
    }
    if (!is_physical(body)) {
      refuse(what +
             " has an inertia that is not physically consistent (principal moments about the center of mass "
             "must be positive, each below the sum of the other two); correct <inertia> of the link " +
             in_quotes(arm_[segment - 1]->child) + " or of what is fixed to it");
    }
  }

  void read_limits() {
    const auto n = static_cast<Eigen::Index>(arm_.size());
    JointLimits& limits = robot_.limits;
    for (JointVector* v : {&limits.q_min, &limits.q_max, &limits.dq_max, &limits.tau_max}) v->resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const UrdfJoint& joint = *arm_[static_cast<std::size_t>(i)];
      const auto found = chain_.limits.find(joint.name);
      const UrdfLimits given = found == chain_.limits.end() ? UrdfLimits{} : found->second;
      const LimitKeys& keys = limit_keys(joint.slides());
      if (given.prismatic && *given.prismatic != joint.slides()) {
        refuse("joint " + in_quotes(joint.name) + " is " + joint.type + "; expected its limits as " +
               keys.lower + ", " + keys.upper + ", " + keys.velocity + ", " + keys.effort);
      }
      const auto one = [&](const std::optional<double>& ours, const std::optional<double>& theirs,
                           const char* key) {
        if (!ours && !theirs) {
          refuse("the URDF has no " + std::string(key) + " of joint " + in_quotes(joint.name) +
                 "; add it (limits: {" + joint.name + ": {" + key + ": ...}})");
        }
        return ours ? *ours : *theirs;
      };
      limits.q_min[i] = one(given.lower, joint.lower, keys.lower);
      limits.q_max[i] = one(given.upper, joint.upper, keys.upper);
      limits.dq_max[i] = one(given.velocity, joint.velocity, keys.velocity);
      limits.tau_max[i] = one(given.effort, joint.effort, keys.effort);
      const std::string cure = " of joint " + in_quotes(joint.name) +
                               "; a URDF has 0 for unknown values: add the limits (limits: {" + joint.name +
                               ": {...}})";
      const auto expected = [&](const std::string& what) { refuse("expected " + what + cure); };
      if (limits.q_min[i] >= limits.q_max[i]) expected(std::string(keys.lower) + " below " + keys.upper);
      if (limits.dq_max[i] <= 0) expected(std::string(keys.velocity) + " above 0");
      if (limits.tau_max[i] <= 0) expected(std::string(keys.effort) + " above 0");
    }
    limits.ddq_max = JointVector::Constant(n, kUrdfAcceleration);
    limits.dddq_max = JointVector::Constant(n, kUrdfJerk);
    limits.tau_rate_max = JointVector::Constant(n, kUrdfTorqueRate);
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!arm_[static_cast<std::size_t>(i)]->slides()) continue;
      limits.ddq_max[i] = kUrdfLinearAcceleration;
      limits.dddq_max[i] = kUrdfLinearJerk;
      limits.tau_rate_max[i] = std::max(kUrdfTorqueRate, limits.tau_max[i] / kUrdfForceRise);
    }
    robot_.q_home = JointVector::Zero(n).cwiseMax(limits.q_min).cwiseMin(limits.q_max);
  }

  void finish() {
    robot_.name = tree_.name;
    robot_.title = tree_.name + ", " + chain_.base_link + " to " + chain_.tip_link;
    for (const UrdfJoint* joint : arm_) {
      robot_.joint_names.push_back(joint->name);
      if (joint->damping == 0 && joint->friction == 0) continue;
      std::ostringstream text;  // as a stream writes numbers: short
      text << joint->name << " " << joint->damping << (joint->slides() ? " N s/m and " : " N m s/rad and ")
           << joint->friction << (joint->slides() ? " N" : " N m");
      robot_.left_out_friction.push_back(text.str());
    }
    // Thin capsules along the links, because the URDF's visuals are not read.
    for (std::size_t i = 0; i <= arm_.size(); ++i) {
      Shape stick;
      stick.link = "link" + std::to_string(i);
      stick.to = i < arm_.size() ? robot_.joints[i].position : robot_.flange.position;
      stick.radius = 0.03;
      stick.kind = stick.to.norm() < 1e-6 ? ShapeKind::sphere : ShapeKind::capsule;
      stick.color = i % 2 == 0 ? "silver" : "white";
      robot_.visuals.push_back(stick);
    }
  }

  const UrdfTree& tree_;
  const UrdfChain& chain_;
  std::vector<const UrdfJoint*> path_;  // from the base to the tip
  std::vector<const UrdfJoint*> arm_;   // the movable ones among them
  std::vector<RigidBody> bodies_;       // per segment
  std::vector<AttachedShape> shapes_;
  RobotDescription robot_;
};

}  // namespace

RobotDescription robot_from_urdf(const std::string& urdf_text, const UrdfChain& chain) {
  const UrdfTree tree = parse_urdf(urdf_text);
  return ChainReader(tree, chain).read();
}

std::vector<AttachedShape> attached_shapes(const std::string& urdf_text, const UrdfChain& chain) {
  const UrdfTree tree = parse_urdf(urdf_text);
  return ChainReader(tree, chain).shapes();
}

std::filesystem::path urdf_file(const std::string& name, const std::filesystem::path& folder) {
  const std::string scheme = "package://", file_scheme = "file://";
  std::error_code unreadable;
  if (name.rfind(scheme, 0) != 0) {
    const bool is_url = name.rfind(file_scheme, 0) == 0;
    const std::filesystem::path path =
        folder / (is_url ? name.substr(file_scheme.size()) : name);  // an absolute name stays as it is
    if (!std::filesystem::exists(path, unreadable)) refuse("there is no file " + path.string());
    return path;
  }
  const std::string rest = name.substr(scheme.size());
  std::vector<std::filesystem::path> places;
  if (const char* prefixes = std::getenv("AMENT_PREFIX_PATH")) {
    std::istringstream list(prefixes);
    for (std::string prefix; std::getline(list, prefix, ':');) {
      if (!prefix.empty()) places.push_back(std::filesystem::path(prefix) / "share");
    }
  }
  for (const std::filesystem::path& packages : python_package_folders()) {
    const std::filesystem::path wheels = packages / "cmeel.prefix/share";
    places.push_back(wheels);
    places.push_back(wheels / "example-robot-data/robots");
  }
  std::string searched;
  for (const auto& place : places) {
    if (std::filesystem::exists(place / rest, unreadable)) return place / rest;
    searched += (searched.empty() ? "" : ", ") + place.string();
  }
  refuse("there is no file " + rest + " in " + searched +
         "; source the workspace that has the package, or write the path of the file");
}

}  // namespace multipanda
