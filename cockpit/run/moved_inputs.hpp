#pragma once

#include <map>
#include <utility>
#include <vector>

#include "core/modes/multimode_controller.hpp"
#include "runtime/shared_records/record_reader.hpp"

namespace multipanda::cockpit {

// The inputs of controllets that a hold has moved, and how they come to rest when it ends.
class MovedInputs {
 public:
  explicit MovedInputs(MultimodeController& modes) : modes_(modes) {}

  void add(InstanceIndex instance, std::size_t input) { inputs_[{instance, input}] = 0; }
  // A goal that the loop has not taken yet.
  void add_ticket(std::uint64_t ticket) { tickets_.push_back(ticket); }
  bool empty() const { return inputs_.empty(); }

  // Set-points stop: poses and joints brake from the newest two records, twists and wrenches go to zero,
  // scalars stay. `deactivate`: their controllets end, too, so that their arms are held. Goals that wait are
  // taken back first. Whatever cannot be done stops the arms.
  void come_to_rest(const RecordReader& records, bool deactivate);

  // The place where a set-point comes to rest (in Target's order), from two of its values and the time
  // between them.
  static std::vector<double> resting_place(Quantity quantity, const std::vector<double>& before,
                                           const std::vector<double>& now, double dt);

 private:
  bool bring_to_rest(Instance& instance, std::size_t input, const RecordReader& records);

  MultimodeController& modes_;
  std::map<std::pair<InstanceIndex, std::size_t>, int> inputs_;
  std::vector<std::uint64_t> tickets_;
};

}  // namespace multipanda::cockpit
