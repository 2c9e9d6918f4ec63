#pragma once

#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "cockpit/view/scene_bodies.hpp"
#include "core/modes/multimode_controller.hpp"
#include "runtime/shared_records/shared_records.hpp"
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

// Inputs and controllets that a hold has moved, activated or changed, and how they come to rest when it ends.
class MovedInputs {
 public:
  explicit MovedInputs(MultimodeController& modes) : modes_(modes) {}

  void add(InstanceIndex instance, std::size_t input) { inputs_[{instance, input}] = 0; }
  // `record`: number of the newest record at the time of the request.
  void add_change(InstanceIndex instance, std::uint64_t record) { changed_[instance] = record; }
  // A request that the loop has not taken yet.
  void add_ticket(std::uint64_t ticket) { tickets_.push_back(ticket); }

  // Set-points stop: poses and joints brake from the newest two records, twists and wrenches go to zero,
  // scalars stay and count as changes. How far a change still moves an arm is unknown, so controllets with a
  // change end and their arms are held, unless the arms have rested for kStill since, or a person guides
  // them. `deactivate`: all of these controllets end. Pending requests are withdrawn first. If something
  // fails, the arms are stopped. Returns the controllets that ended although not all had to.
  static constexpr double kStill = 0.3;      // longer than any ramp takes to begin a motion [s]
  static constexpr double kStillest = 0.01;  // of each joint [rad/s]
  InstanceSet come_to_rest(const RecordReader& records, bool deactivate);

  // The rest position of a set-point (in Target's order), from two values and the time between them.
  static std::vector<double> resting_place(Quantity quantity, const std::vector<double>& before,
                                           const std::vector<double>& now, double dt);

 private:
  bool bring_to_rest(Instance& instance, std::size_t input, const RecordReader& records);
  bool stands_still(const Instance& instance, std::uint64_t since, const RecordReader& records) const;

  MultimodeController& modes_;
  std::map<std::pair<InstanceIndex, std::size_t>, int> inputs_;
  std::map<InstanceIndex, std::uint64_t> changed_;
  std::vector<std::uint64_t> tickets_;
};

}  // namespace multipanda::cockpit
