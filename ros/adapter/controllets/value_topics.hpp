#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/adapter/rate_divider.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Publishes references and outputs of the active controllets:
//   ~/<instance>/<input>/reference  the set-point that is followed now
//   ~/<instance>/<output>           Float64, or Float64MultiArray for more than one number
// Only for active instances and features that are on, and only with a subscriber. Publisher's thread.
class ValueTopics : public AdapterPart {
 public:
  ValueTopics(const AdapterContext& run, const std::vector<InputCodec>& codecs);
  void take(const CycleRecord& record) override;

 private:
  using ShowReference = std::function<void(const ReferenceSample&, std::int64_t stamp_ns)>;
  struct Output {
    std::size_t offset, size;
    std::function<bool()> runs;  // for a feature's output: whether the feature is on
    std::function<void(const double* values)> show;
  };
  ShowReference reference_publisher(const AdapterContext& run, const Instance& instance,
                                    const Reference& input);
  void add_outputs(const AdapterContext& run, const Instance& instance, const RecordLayout::Instance& layout);

  const Stamps stamps_;
  RateDivider references_due_, outputs_due_;
  std::vector<std::vector<ShowReference>> references_;  // by instance and input; empty: no topic
  std::vector<Output> outputs_;
};

}  // namespace multipanda::ros
