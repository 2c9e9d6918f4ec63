#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cockpit/view/near_pairs.hpp"
#include "cockpit/view/scene_bodies.hpp"
#include "runtime/shared_records/record_reader.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// The numbers of a state (cockpit/WIRE.md): those of a record, and values derived by the models.
class StateView {
 public:
  // `fields`: of the records. `models`: per arm. Throws std::invalid_argument.
  StateView(const Scene& scene, std::vector<std::shared_ptr<const ArmModel>> models,
            const std::vector<RecordReader::Field>& fields);

  // [name, count] of the numbers, in order.
  const nlohmann::json& fields() const { return described_; }
  // Initial poses of arms and objects.
  nlohmann::json bodies();

  struct More {  // per arm, in addition to the record
    ArmFrames frames;
    double tracking_error = 0, torque_use = 0;
  };
  // `since_s`: age of the record.
  std::span<const double> compute(const RecordReader::Record& record, double since_s,
                                  std::span<const More> more, std::span<const std::optional<Pose>> objects);

 private:
  struct Copy {  // of a record's field
    RecordReader::Field field;
    std::size_t at = 0;
  };
  struct Arm {
    JointVector q_start;
    RecordReader::Field q, gripper;
    std::size_t stiffness_frame = 0, manipulability = 0, tracking_error = 0, torque_use = 0, joint_limit = 0;
  };

  std::size_t add(const std::string& name, std::size_t count);

  std::vector<std::shared_ptr<const ArmModel>> models_;
  SceneBodies bodies_;
  NearPairs near_;
  std::vector<Copy> copies_;
  std::vector<Arm> arms_;
  std::vector<ModelTerms> terms_;
  RecordReader::Field t_ns_, total_ns_;
  std::size_t t_at_ = 0, total_at_ = 0, sent_at_ = 0, since_at_ = 0, bodies_at_ = 0, near_at_ = 0;
  nlohmann::json described_ = nlohmann::json::array();
  std::vector<double> values_;
};

}  // namespace multipanda::cockpit
