#pragma once

#include <vector>

#include "models/robot_description.hpp"

namespace multipanda {

// Shapes to draw: those of the robot, or its capsules if it has none.
std::vector<Shape> link_visuals(const RobotDescription& robot);

// The hand with closed fingers, all in the hand's frame.
std::vector<Shape> closed_hand_visuals(const HandDescription& hand);

// A shape given in frame B, in frame A.
Shape moved(const Shape& shape, const Pose& X_AB, const std::string& link);

// Pose of a shape's own axes: a capsule or cylinder lies along z, in the middle of its axis.
Pose shape_pose(const Shape& shape);

// Roll, pitch, yaw of a rotation [rad]; pitch within +-pi/2.
Vector3 rpy_of(const Matrix3& rotation);

}  // namespace multipanda
