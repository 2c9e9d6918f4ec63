#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/adapter/every.hpp"
#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// What the running controllets show:
//   ~/<instance>/<input>/reference  the set-point that is followed now
//   ~/<instance>/<output>           Float64, or Float64MultiArray where it is more than one number
// Only of instances that run and features that are on, and only where somebody listens. Publisher's thread.
class ShownValues : public Part {
 public:
  ShownValues(const AdapterWorld& world, const std::vector<InputCodec>& codecs);
  void take(const CycleRecord& record) override;

 private:
  using ShowReference = std::function<void(const ReferenceSample&, std::int64_t stamp_ns)>;
  struct Output {
    std::size_t offset, size;
    std::function<bool()> runs;  // beside its instance: is its feature on?
    std::function<void(const double* values)> show;
  };
  ShowReference reference_publisher(const AdapterWorld& world, const Instance& instance,
                                    const Reference& input);
  void add_outputs(const AdapterWorld& world, const Instance& instance, const RecordLayout::Instance& layout);

  const Stamps stamps_;
  Every references_due_, outputs_due_;
  std::vector<std::vector<ShowReference>> references_;  // by instance and input; empty: has no topic
  std::vector<Output> outputs_;
};

}  // namespace multipanda::ros
