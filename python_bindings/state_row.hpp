#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/record_fields.hpp"
#include "scene/scene.hpp"

// The state of a world as one row of numbers, which Python sees as arrays.
namespace multipanda {

// Where the numbers of each arm and of each free object lie. An arm has the quantities of
// core/record/arm_sample.hpp by name, then X_WE, `gripper` (width, grasped, moving) and `held`; an object has
// X_WO. Poses are x y z, qw qx qy qz.
class StateRow {
 public:
  static constexpr std::size_t kPose = 7;

  struct Arm {
    std::string name;
    std::size_t joints = 0, first = 0;
    std::vector<RecordField> fields;  // offsets in bytes of the row
  };
  struct Object {
    std::string name;
    std::size_t first = 0;
  };

  explicit StateRow(const Scene& scene);

  std::size_t size() const { return size_; }
  const std::vector<Arm>& arms() const { return arms_; }
  const std::vector<Object>& objects() const { return objects_; }

  void write_arm(std::size_t arm, const ArmSample& sample, const Pose& X_WE, bool held, double* row) const;
  void write_object(std::size_t object, const Pose& X_WO, double* row) const;

 private:
  std::vector<Arm> arms_;
  std::vector<Object> objects_;
  std::size_t size_ = 0;
};

}  // namespace multipanda
