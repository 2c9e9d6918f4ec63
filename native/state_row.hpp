#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/cycle/cycle_data.hpp"
#include "core/model/model_terms.hpp"
#include "scene/scene.hpp"

// The state of a world as one row of numbers, which Python sees as arrays.
namespace multipanda {

// Where the numbers of each arm and of each free object lie.
//   arm     q dq tau_J tau_J_d (n each), X_WE (x y z, qw qx qy qz), F_K_W_est, F_K_W_true (6 each),
//           gripper (width, grasped, moving), held
//   object  X_WO (7)
class StateRow {
 public:
  static constexpr std::size_t kPose = 7, kWrench = 6, kGripper = 3;

  struct Arm {
    std::string name;
    std::size_t joints = 0, first = 0;
    std::size_t size() const { return 4 * joints + kPose + 2 * kWrench + kGripper + 1; }
  };
  struct Object {
    std::string name;
    std::size_t first = 0;
  };

  explicit StateRow(const Scene& scene);

  std::size_t size() const { return size_; }
  const std::vector<Arm>& arms() const { return arms_; }
  const std::vector<Object>& objects() const { return objects_; }

  // Writes what an arm measures and what only the simulation knows. `terms` is of the arm's model.
  void write_arm(std::size_t arm, const ArmState& state, ModelTerms& terms, bool held, double* row) const;
  void write_object(std::size_t object, const Pose& X_WO, double* row) const;

 private:
  std::vector<Arm> arms_;
  std::vector<Object> objects_;
  std::size_t size_ = 0;
};

}  // namespace multipanda
