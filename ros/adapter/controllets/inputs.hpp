#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/adapter/controllets/input_port.hpp"
#include "ros/adapter/topic.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Subscribes to two topics for each input of each controllet instance, and to two more for each codec beside
// the standard type:
//   ~/<instance>/<input>        a stream; the arm is held when it stops
//   ~/<instance>/<input>/goal   sent once, approached smoothly, stays in force
class Inputs : public AdapterPart {
 public:
  // Throws std::invalid_argument for a codec without valid topic, with a topic already in use, or for an
  // input that does not exist.
  Inputs(const AdapterContext& run, const std::vector<InputCodec>& codecs);
  std::vector<Diagnostic> diagnostics() const override;
  const std::vector<std::unique_ptr<InputPort>>& ports() const { return ports_; }

 private:
  void open(const AdapterContext& run, InputPort& port);
  void open(const AdapterContext& run, InputPort& port, const InputCodec& codec);

  std::vector<std::unique_ptr<InputPort>> ports_;
  std::vector<std::unique_ptr<Incoming>> subscriptions_;  // destroyed before the ports
};

// Throws std::invalid_argument, as Inputs does.
void check_codecs(const std::vector<InputCodec>& codecs, const MultimodeController& modes);

// Returns the codecs of an input that have topics of their own.
std::vector<const InputCodec*> more_codecs_for(const std::vector<InputCodec>& codecs,
                                               const Instance& instance, const InputSpec& input);

// Returns the codec that replaces the standard type of an input, or nullptr.
const InputCodec* codec_for(const std::vector<InputCodec>& codecs, const Instance& instance,
                            const InputSpec& input);

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
