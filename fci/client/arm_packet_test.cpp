// The wrench of a packet as the loop sees it: about K, in world axes.
#include "fci/client/arm_packet.hpp"

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "core/state/external_force.hpp"
#include "core/testing/test_arm.hpp"
#include "fci/wire/state_layout.hpp"
#include "scene/build.hpp"

namespace multipanda::fci::arm_packet_test {
namespace {

void put(const Pose& X, std::array<double, 16>& to) {
  Eigen::Map<Eigen::Matrix4d> T(to.data());
  T << X.rotation, X.position, 0, 0, 0, 1;
}

Wrench seen(ArmPacket& arm, const RobotState& packet) {
  ArmState state;
  arm.fill(packet, true, state);
  EXPECT_TRUE(state.has_wrench_estimate);
  return state.F_K_W_est;
}

// A force through a known point and a couple, for any base, end effector and stiffness frame. Both frames
// change with every packet and apply to its own wrench.
TEST(ArmPacket, AForceAtAPointHasItsMomentAboutK) {
  test::Draw draw(40);
  for (const Dialect& dialect : kDialects) {
    const Pose X_WB = draw.pose(2);
    ArmPacket arm(X_WB, {});
    for (int k = 0; k < 20; ++k) {
      const Pose X_BE = draw.pose(0.8), X_EK = draw.pose(0.2);
      const Pose X_WK = X_WB * X_BE * X_EK;
      const Vector3 f = draw.vector3(50), couple = draw.vector3(5), p_W = X_WK.position + draw.vector3(0.3);
      RobotState sent, packet;
      put(X_BE, sent.O_T_EE);
      put(X_EK, sent.EE_T_K);
      put({}, sent.F_T_EE);
      const auto by_arm = [&](const Pose& X_WA, std::array<double, 6>& to) {  // about A's origin, in A's axes
        const Vector3 moment = (p_W - X_WA.position).cross(f) + couple;
        Eigen::Map<Vector6>(to.data()) << X_WA.rotation.transpose() * f, X_WA.rotation.transpose() * moment;
      };
      by_arm(X_WB, sent.O_F_ext_hat_K);
      by_arm(X_WK, sent.K_F_ext_hat_K);
      std::array<std::byte, kMaxStateSize> bytes;
      ASSERT_EQ(decode(dialect, std::span(bytes).first(encode(dialect, sent, bytes)), packet),
                WireResult::ok);
      const Wrench F = seen(arm, packet);
      EXPECT_LT((F.force() - f).norm(), 1e-4) << "version " << dialect.version;
      EXPECT_LT((F.torque() - (p_W - X_WK.position).cross(f) - couple).norm(), 1e-4)
          << "version " << dialect.version;
    }
  }
}

// A real Panda that a person pushes; its stiffness frame is the end effector of the hand.
TEST(ArmPacket, TheWrenchesOfARealArmAgree) {
  const auto path = std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "../shared/data/panda_state_give.csv";
  std::ifstream file(path);
  if (!file) GTEST_SKIP() << "no data in " << path;
  const auto cells = [&file] {
    std::vector<std::string> all;
    std::string line, cell;
    std::getline(file, line);
    for (std::istringstream text(line); std::getline(text, cell, ',');) all.push_back(cell);
    return all;
  };
  const Pose X_WB = test::Draw(41).pose(2);
  SceneArm arm;
  arm.model = "fer";
  arm.X_WB = X_WB;
  ModelTerms terms(build_arm_model(arm));
  terms.set_config(arm_config(arm).frames, {}, {});
  ArmPacket arm_packet(X_WB, {});
  const std::vector<std::string> names = cells();
  int rows = 0;
  double lever_nm = 0;
  for (auto row = cells(); !row.empty(); row = cells(), ++rows) {
    std::map<std::string, double> at;
    for (std::size_t i = 0; i < names.size(); ++i) at[names[i]] = std::stod(row[i]);
    const auto get = [&at](const std::string& name, auto& to) {
      for (std::size_t i = 0; i < to.size(); ++i) to[i] = at.at(name + "_" + std::to_string(i + 1));
    };
    RobotState packet;
    get("O_T_EE", packet.O_T_EE);
    get("K_F_ext_hat_K", packet.K_F_ext_hat_K);
    get("q", packet.q);
    get("tau_ext_hat_filtered", packet.tau_ext_hat_filtered);
    put({}, packet.F_T_EE);
    put({}, packet.EE_T_K);
    const Wrench F = seen(arm_packet, packet);

    // The arm's other field: in the base's axes, about its origin.
    std::array<double, 6> other{};
    get("O_F_ext_hat_K", other);
    const Eigen::Map<const Vector6> F_O(other.data());
    const Vector3 lever = pose_of(packet.O_T_EE).position.cross(F_O.head<3>());
    EXPECT_LT((F.force() - X_WB.rotation * F_O.head<3>()).norm(), 1e-4) << "row " << rows;
    EXPECT_LT((F.torque() - X_WB.rotation * (F_O.tail<3>() - lever)).norm(), 3e-4) << "row " << rows;
    lever_nm = std::max(lever_nm, lever.norm());

    // And what our model makes of its joint torques.
    const Eigen::Map<const Eigen::Matrix<double, 7, 1>> q(packet.q.data()),
        tau(packet.tau_ext_hat_filtered.data());
    terms.update(q, JointVector::Zero(7));
    const Wrench ours = wrench_of(terms.J_V_WK(), tau);
    EXPECT_LT((F.force() - ours.force()).norm(), 0.05) << "row " << rows;
    EXPECT_LT((F.torque() - ours.torque()).norm(), 0.02) << "row " << rows;
  }
  EXPECT_EQ(rows, 313);
  EXPECT_GT(lever_nm, 15);
}

}  // namespace
}  // namespace multipanda::fci::arm_packet_test
