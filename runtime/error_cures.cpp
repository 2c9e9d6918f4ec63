#include <array>

#include "runtime/error_report.hpp"

namespace multipanda {
namespace {

constexpr std::array<const char*, kArmErrorCount> kCures{{
    /* 0 */
    "move the arm back by hand (guiding) and recover; keep set-points away from the joint limits: feature "
    "joint_limits",
    /* 1 */ "move the end effector back by hand and recover; check the workspace in the arm's own settings",
    /* 2 */
    "move the parts of the arm away from each other by hand and recover; add the feature collision_avoidance",
    /* 3 */
    "slow down the motion: lower stiffness or slower set-points; if a joint oscillated, lower its damping: "
    "damping x 1 ms must stay below half of the joint's inertia; the feature joint_limits damps near the "
    "limits",
    /* 4 */ "slow down the set-point of the hand, or lower the stiffness",
    /* 5 */ "end the other program's force controller, then recover",
    /* 6 */
    "free the arm, recover; if nothing was touched: declare tool and payload ('tool', 'load_declared'), or "
    "raise 'collision:' in the scene",
    /* 7 */
    "free the arm, recover; if nothing was touched: declare tool and payload ('tool', 'load_declared'), or "
    "raise 'collision:' in the scene",
    /* 8 */
    "plan the motion of Desk or of the other program again, then recover",
    /* 9 */
    "remove the obstacle from the motion of Desk or of the other program, then recover",
    /* 10 */ "plan a slower Cartesian motion in the other program, then recover",
    /* 11 */ "begin the motion at q_d of the last state",
    /* 12 */ "keep commanded joint positions within the limits",
    /* 13 */
    "keep commanded joint velocities within the limits; for an FR3 they shrink near the joint limits",
    /* 14 */
    "let the commanded velocity change by at most the acceleration limit times 1 ms per period; switch rate "
    "limiting on",
    /* 15 */
    "let the commanded acceleration change by at most the jerk limit times 1 ms per period; smooth the path",
    /* 16 */ "begin the motion at O_T_EE_c of the last state",
    /* 17 */ "command a reachable elbow position, and change it more slowly",
    /* 18 */ "slow down the commanded Cartesian motion",
    /* 19 */
    "let the commanded Cartesian velocity change by at most the acceleration limit times 1 ms per period",
    /* 20 */
    "let the commanded Cartesian acceleration change by at most the jerk limit times 1 ms per period",
    /* 21 */ "command the elbow on the arm's side of joint 4",
    /* 22 */ "begin the motion at elbow_c of the last state",
    /* 23 */ "check contact and desired force of the other program's force controller",
    /* 24 */ "start the program of Desk with the elbow on the correct side",
    /* 25 */
    "run './multipanda doctor ADDRESS', then './multipanda communication-test ADDRESS'; fix what they "
    "report, recover",
    /* 26 */ "move more slowly or with less force, then recover",
    /* 27 */ "choose a Cartesian path or an elbow that keeps the joints within their limits",
    /* 28 */ "slow down the Cartesian motion near stretched and folded poses",
    /* 29 */ "slow down the Cartesian motion near stretched and folded poses; smooth the path",
    /* 30 */ "smooth the Cartesian path, especially near stretched and folded poses",
    /* 31 */ "send a rotation matrix with orthonormal columns and the last row 0 0 0 1, column by column",
    /* 32 */
    "if packets were lost: './multipanda doctor ADDRESS'; otherwise add a 'low_pass_hz' for the arm in the "
    "scene, or a smoother law",
    /* 33 */ "reduce payload or speed in the program of Desk",
    /* 34 */ "reduce stiffness or load; unload the joint by hand, then recover",
    /* 35 */ "lower the stiffness of the other program's controller; check tool and payload",
    /* 36 */ "move the joint back by hand (guiding), then recover",
    /* 37 */ "plan the path again in the program of Desk",
    /* 38 */ "keep the path of the program of Desk away from the joint limits",
    /* 39 */ "do not move the arm while it starts; check that its base is firm; start it again",
    /* 40 */ "check that the arm's base is firm and its mounting angle is set; start it again",
}};

}  // namespace

std::string_view cure(ArmError error) {
  return error < ArmError::count_ ? kCures[static_cast<std::size_t>(error)] : "see the arm's own log";
}

}  // namespace multipanda
