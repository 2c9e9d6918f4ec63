#include <array>

#include "runtime/error_report.hpp"

namespace multipanda {
namespace {

constexpr std::array<const char*, kArmErrorCount> kCures{{
    /* 0 */
    "lead the arm back by hand (guiding), recover; keep set-points away from the joint limits: feature "
    "joint_limits",
    /* 1 */ "lead the end effector back by hand, recover; check the workspace set in the arm's own settings",
    /* 2 */ "lead the arm apart by hand, recover; add the feature collision_avoidance",
    /* 3 */
    "slow the motion down: lower stiffness or slower set-points; feature joint_limits damps near the limits",
    /* 4 */ "slow the set-point of the hand down, or lower the stiffness",
    /* 5 */ "another program's force controller: let it end, recover",
    /* 6 */
    "free the arm, recover; if nothing was touched: declare tool and payload ('tool', 'load_declared'), or "
    "raise "
    "'collision:' in the scene",
    /* 7 */
    "free the arm, recover; if nothing was touched: declare tool and payload ('tool', 'load_declared'), or "
    "raise "
    "'collision:' in the scene",
    /* 8 */ "a motion of the arm's own settings page or another program: plan it again, recover",
    /* 9 */ "a motion of the arm's own settings page or another program: remove what is in the way, recover",
    /* 10 */ "another program's Cartesian motion: plan it slower, recover",
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
    /* 17 */ "command an elbow that the arm can take, and more slowly",
    /* 18 */ "slow the commanded Cartesian motion down",
    /* 19 */
    "let the commanded Cartesian velocity change by at most the acceleration limit times 1 ms per period",
    /* 20 */
    "let the commanded Cartesian acceleration change by at most the jerk limit times 1 ms per period",
    /* 21 */ "command the elbow on the side where joint 4 is",
    /* 22 */ "begin the motion at elbow_c of the last state",
    /* 23 */ "another program's force controller: check its contact and desired force",
    /* 24 */ "a program of the arm's own settings page: begin it with the elbow on its side",
    /* 25 */
    "run './multipanda doctor ADDRESS', then './multipanda communication-test ADDRESS'; cure what they name, "
    "recover",
    /* 26 */ "move more slowly or with less force, recover",
    /* 27 */ "choose a Cartesian path or an elbow that keeps the joints within their limits",
    /* 28 */ "slow the Cartesian motion down near stretched and folded poses",
    /* 29 */ "slow the Cartesian motion down near stretched and folded poses; smooth the path",
    /* 30 */ "smooth the Cartesian path, most of all near stretched and folded poses",
    /* 31 */ "send a rotation matrix with orthonormal columns and the last row 0 0 0 1, column by column",
    /* 32 */
    "if packets were lost: './multipanda doctor ADDRESS'; else a 'low_pass_hz' for the arm in the scene, or "
    "a "
    "smoother law",
    /* 33 */ "a program of the arm's own settings page: reduce payload or speed",
    /* 34 */ "less stiffness or load; unload the joint by hand, recover",
    /* 35 */ "another program's controller: lower its stiffness; check tool and payload",
    /* 36 */ "lead the joint back by hand (guiding), recover",
    /* 37 */ "a program of the arm's own settings page: plan its path again",
    /* 38 */ "a program of the arm's own settings page: keep its path away from the joint limits",
    /* 39 */ "let the arm stand still while it starts; check that its base is firm; start it again",
    /* 40 */ "check that the arm's base is firm and its mounting angle is set; start it again",
}};

}  // namespace

std::string_view cure(ArmError error) {
  return error < ArmError::count_ ? kCures[static_cast<std::size_t>(error)] : "look into the arm's own log";
}

}  // namespace multipanda
