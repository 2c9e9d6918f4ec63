#pragma once

#include <map>
#include <string>
#include <vector>

#include "fci/simulated_time/simulated_run.hpp"

// What the tests of this folder share: two different arms and their laws.
namespace multipanda::fci::test {

// fer with hand ("left") and fr3 ("right"); bases off the origin and rotated, too far apart to touch. A table
// 2 cm below the left hand. Laws: left_joints, left_pose (soft), right_joints, both
// (dual_cartesian_impedance) and left_slew, right_slew: torques of joints 1 to 4 that change at their
// greatest rate all the time.
Scene two_arms(const PlantFidelity& plant = PlantFidelity::ideal());
Registry laws();

// Fixed times without any spread, loss or drift; answers arrive 300 us after their state was sent.
SimulatedTimeOptions plain_times(std::size_t arms, std::uint64_t seed = 1);

Request switch_to(const MultimodeController& modes, const std::vector<std::string>& names);
Request joint_goal(const MultimodeController& modes, const std::string& name, const JointVector& q,
                   double duration_s);
// The pose of an arm's end effector moved by `by_W`.
Request pose_goal(const SimulatedRun& run, MultimodeController& modes, const std::string& name,
                  const std::string& input, ArmIndex arm, const Vector3& by_W, double duration_s);

}  // namespace multipanda::fci::test
