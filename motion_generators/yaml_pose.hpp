#pragma once

#include "config_file/archive.hpp"
#include "core/types/spatial.hpp"
#include "motion_generators/circular_field/course.hpp"

// What the files of generators have in common.
namespace multipanda {

// A pose {position_m, rpy_rad}, both required.
void visit_pose_part(Archive& archive, Key key, std::optional<Pose>& X);
// A list of them.
void visit_poses(Archive& archive, Key key, std::vector<Pose>& poses);

namespace circular_field {
void visit(Archive& archive, Destination& to);
}

}  // namespace multipanda
