#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <stdexcept>
#include <utility>

#include "core/geometry/shape.hpp"
#include "models/capsule_fit.hpp"
#include "models/from_urdf.hpp"
#include "models/urdf_tree.hpp"

namespace multipanda {
namespace {

using Points = std::vector<Vector3>;

Points points_of(const UrdfGeometry& shape, const std::filesystem::path& folder) {
  switch (shape.kind) {
    case UrdfGeometry::Kind::box:
      return box_points(shape.size);
    case UrdfGeometry::Kind::cylinder:
      return cylinder_points(shape.radius, shape.length);
    case UrdfGeometry::Kind::sphere:
      return sphere_points(shape.radius);
    case UrdfGeometry::Kind::mesh:
      return mesh_points(urdf_file(shape.file, folder), shape.scale);
    case UrdfGeometry::Kind::unknown:
      break;
  }
  throw std::invalid_argument(shape.file);
}

// The points of a shape in all of its places. Many places are first reduced to few points that contain them.
Points in_all_places(Points points, const std::vector<std::vector<Pose>>& steps) {
  for (std::size_t k = steps.size(); k-- > 0;) {
    if (k + 1 < steps.size()) points = fit_hull(points).corners;
    Points placed;
    for (const Pose& X : steps[k]) {
      for (const auto& p : points) placed.push_back(X * p);
    }
    points = std::move(placed);
  }
  return points;
}

// Poses of link1 to linkN in the base.
std::vector<Pose> poses(const RobotDescription& robot, const JointVector& q) {
  std::vector<Pose> result;
  Pose X;
  for (std::size_t i = 0; i < robot.joint_count(); ++i) {
    const double at = q[static_cast<Eigen::Index>(i)];
    const Pose X_J = robot.is_prismatic(i)
                         ? Pose{Matrix3::Identity(), at * Vector3::UnitZ()}
                         : Pose{Eigen::AngleAxisd(at, Vector3::UnitZ()).toRotationMatrix(), Vector3::Zero()};
    X = X * robot.joints[i].pose() * X_J;
    result.push_back(X);
  }
  return result;
}

std::size_t link_of(const Capsule& capsule) { return std::stoul(capsule.link.substr(4)); }

// Row of a shape in the overlap matrix: each hull of the base, then link1 to linkN.
struct Rows {
  explicit Rows(const RobotDescription& robot)
      : hulls(robot.base_hulls.size()), count(static_cast<Eigen::Index>(hulls + robot.joint_count())) {}
  Eigen::Index of_hull(std::size_t k) const { return static_cast<Eigen::Index>(k); }
  Eigen::Index of_link(std::size_t link) const { return static_cast<Eigen::Index>(hulls + link - 1); }
  std::string name(Eigen::Index row) const {
    const auto i = static_cast<std::size_t>(row);
    return i < hulls ? hull_name(i) : "link" + std::to_string(i - hulls + 1);
  }
  std::size_t hulls;
  Eigen::Index count;
};

// Overlapping pairs in a configuration, without neighbors, which are ignored anyway. A link nearer to a hull
// than `clearance` counts as overlapping.
Eigen::MatrixXi overlaps(const RobotDescription& robot, const JointVector& q, double clearance = 0) {
  const auto X = poses(robot, q);
  const Rows rows(robot);
  Eigen::MatrixXi result = Eigen::MatrixXi::Zero(rows.count, rows.count);
  for (std::size_t a = 0; a < robot.capsules.size(); ++a) {
    for (std::size_t b = a + 1; b < robot.capsules.size(); ++b) {
      const Capsule &one = robot.capsules[a], &other = robot.capsules[b];
      const std::size_t i = link_of(one), j = link_of(other);
      if (j <= i + 1) continue;
      const Pose &X_i = X[i - 1], &X_j = X[j - 1];
      const Closest closest = closest_capsules(X_i * one.from, X_i * one.to, one.radius, X_j * other.from,
                                               X_j * other.to, other.radius);
      if (closest.distance < 0) result(rows.of_link(i), rows.of_link(j)) = 1;
    }
  }
  for (const Capsule& capsule : robot.capsules) {
    const std::size_t j = link_of(capsule);
    if (j < 2) continue;
    const Pose& X_j = X[j - 1];
    for (std::size_t k = 0; k < rows.hulls; ++k) {
      int& found = result(rows.of_hull(k), rows.of_link(j));
      if (found == 0)
        found = hull_overlaps(robot.base_hulls[k], X_j * capsule.from, X_j * capsule.to,
                              capsule.radius + clearance);
    }
  }
  return result;
}

// Returns a sentence that describes them.
std::string ignore_touching_pairs(RobotDescription& robot) {
  constexpr int kSamples = 400;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform;
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  const Rows rows(robot);
  Eigen::MatrixXi often = Eigen::MatrixXi::Zero(rows.count, rows.count);
  for (int k = 0; k < kSamples; ++k) {
    JointVector q(n);
    for (Eigen::Index i = 0; i < n; ++i)
      q[i] = robot.limits.q_min[i] + uniform(random) * (robot.limits.q_max[i] - robot.limits.q_min[i]);
    often += overlaps(robot, q);
  }
  const Eigen::MatrixXi home = overlaps(robot, robot.q_home, kClearAtHome);
  std::string ignored;
  for (Eigen::Index i = 0; i < rows.count; ++i) {
    for (Eigen::Index j = i + 1; j < rows.count; ++j) {
      if (home(i, j) == 0 && often(i, j) <= kOften * kSamples) continue;
      robot.ignored_pairs.emplace_back(rows.name(i), rows.name(j));
      robot.unguarded_pairs.push_back(rows.name(i) + " and " + rows.name(j) +
                                      (home(i, j) > 0 ? " (overlap at home)" : " (overlap often)"));
      ignored += (ignored.empty() ? "" : ", ") + robot.unguarded_pairs.back();
    }
  }
  return ignored.empty() ? "" : " Not checked: neighbors, and " + ignored + ".";
}

std::string millimeters(double length) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f mm", 1e3 * length);
  return text;
}

// Inputs of a fit, apart from the content of the meshes.
struct Fit {
  std::vector<Capsule> capsules;
  std::vector<BaseHull> base_hulls;
  std::string text;
};
using Fitted = std::map<std::string, Fit>;
std::string key_of(const std::string& urdf_text, const UrdfChain& chain,
                   const std::filesystem::path& folder) {
  std::string key = folder.string() + '\n' + chain.base_link + '\n' + chain.tip_link + '\n';
  for (const auto& [joint, position] : chain.held_joints)
    key += joint + ' ' + std::to_string(position) + '\n';
  return key + urdf_text;
}

void fit(const std::string& urdf_text, const UrdfChain& chain, const std::filesystem::path& folder,
         RobotDescription& robot) {
  // By link of the arm, then by link of the URDF: all positions of a finger form one shape.
  std::vector<std::map<std::string, Points>> found(robot.joint_count() + 1);
  // Shapes of the base are fitted in the frame of its first link R with shapes, whichever link is the arm's
  // base_link: arms of one robot then have equal ones.
  std::optional<Pose> first;
  for (const AttachedShape& attached : attached_shapes(urdf_text, chain)) {
    if (attached.segment == 0 && !first)  // one place: joints do not move the base
      first = attached.steps[0][0] * attached.shape.X_LG.inverse();
    try {
      const Points placed = in_all_places(points_of(attached.shape, folder), attached.steps);
      Points& points = found[attached.segment][attached.link];
      points.insert(points.end(), placed.begin(), placed.end());
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(
          "a collision shape of the link '" + attached.link + "' cannot be read: " + error.what() +
          ". Without it the arm would not be protected there. Correct it, or define the shapes in the model "
          "file (with 'self_collision: {capsules: {}, ignored_pairs: []}' there are none, and "
          "collision_avoidance ignores the arm)");
    }
  }
  const Pose X_BR = first.value_or(Pose{});
  std::string wider, without;
  std::vector<Points> of_base;
  for (auto& [name, points] : found[0]) of_base.push_back(std::move(points));
  for (Points& points : of_base) {
    for (auto& p : points) p = X_BR.inverse() * p;
  }
  double base_excess = 0;
  for (FittedHull& hull : fit_hulls(std::move(of_base), kMostBaseHulls)) {
    for (auto& p : hull.corners) p = X_BR * p;
    robot.base_hulls.push_back(std::move(hull.corners));
    base_excess = std::max(base_excess, hull.excess);
  }
  for (std::size_t i = 1; i < found.size(); ++i) {
    const std::string link = "link" + std::to_string(i);
    std::vector<Points> shapes;
    for (auto& [name, points] : found[i]) shapes.push_back(std::move(points));
    double most = 0;
    for (const FittedCapsule& fitted : fit_capsules(std::move(shapes), kMostCapsules)) {
      robot.capsules.push_back({link, fitted.from, fitted.to, fitted.radius});
      most = std::max(most, fitted.excess);
    }
    (most > 0 ? wider : without) += (most > 0 ? wider : without).empty() ? "" : ", ";
    if (most > 0)
      wider += link + " " + millimeters(most);
    else
      without += link;
  }
  std::string text = "Capsules fitted to the collision geometry of the URDF.";
  if (!wider.empty()) text += " Largest excess beyond it: " + wider + ".";
  if (robot.base_hulls.empty()) {
    text += " The URDF has no collision geometry of link0, the body that carries the arm.";
  } else {
    text += " Around link0, the body that carries the arm: convex hulls (" +
            std::to_string(robot.base_hulls.size()) + "), at most " + millimeters(base_excess) +
            " beyond those of its parts.";
  }
  if (!without.empty()) text += " The URDF has no collision geometry of " + without + ".";
  robot.origin["self_collision"] = text;
}

}  // namespace

// Cached per process, because a scene loads a robot several times, and a fit takes up to seconds.
void fit_collision(const std::string& urdf_text, const UrdfChain& chain, const std::filesystem::path& folder,
                   RobotDescription& robot) {
  static std::mutex mutex;
  static Fitted known;
  const std::lock_guard lock(mutex);
  const std::string key = key_of(urdf_text, chain, folder);
  auto place = known.find(key);
  if (place == known.end()) {
    fit(urdf_text, chain, folder, robot);
    place = known.emplace(key, Fit{robot.capsules, robot.base_hulls, robot.origin["self_collision"]}).first;
  }
  robot.capsules = place->second.capsules;
  robot.base_hulls = place->second.base_hulls;
  robot.origin["self_collision"] = place->second.text + ignore_touching_pairs(robot);
}

std::vector<std::filesystem::path> mesh_files(const std::filesystem::path& urdf) {
  std::ifstream stream(urdf);
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  std::set<std::filesystem::path> files;
  for (const auto& [link, shapes] : parse_urdf(text).collisions) {
    for (const auto& shape : shapes) {
      if (shape.kind != UrdfGeometry::Kind::mesh) continue;
      try {
        files.insert(urdf_file(shape.file, urdf.parent_path()));
      } catch (const std::invalid_argument&) {  // for another part of the robot: not needed
      }
    }
  }
  return {files.begin(), files.end()};
}

}  // namespace multipanda
