#pragma once

#include <map>
#include <utility>
#include <vector>

#include "core/modes/multimode_controller.hpp"
#include "runtime/shared_records/record_reader.hpp"

namespace multipanda::cockpit {

// Inputs and controllets that a hold has moved, activated or changed, and how they come to rest when it ends.
class MovedInputs {
 public:
  explicit MovedInputs(MultimodeController& modes) : modes_(modes) {}

  void add(InstanceIndex instance, std::size_t input) { inputs_[{instance, input}] = 0; }
  // `record`: the number of the newest one when it was asked for.
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
