#include "motion_generators/yaml_pose.hpp"

namespace multipanda {
namespace {

void visit_whole_pose(Archive& archive, Pose& X) {
  Vector3 rpy = Vector3::Zero();
  archive(Key("position_m").required(), X.position);
  archive(Key("rpy_rad").required(), rpy);
  X.rotation = rotation_from_rpy(rpy);
}

}  // namespace

void visit_pose_part(Archive& archive, Key key, std::optional<Pose>& X) {
  Pose read;
  archive.part(key, [&](Archive& inner) { visit_whole_pose(inner, read); });
  if (archive.has(key.name)) X = read;
}

void visit_poses(Archive& archive, Key key, std::vector<Pose>& poses) {
  archive.items(std::move(key), [&](Archive& inner) {
    Pose X;
    visit_whole_pose(inner, X);
    if (inner.reading()) poses.push_back(X);
  });
}

}  // namespace multipanda
