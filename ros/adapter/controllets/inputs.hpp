#pragma once

#include <memory>
#include <vector>

#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/adapter/controllets/input_port.hpp"
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
  template <class M>
  void subscribe(const AdapterContext& run, InputPort& port);

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

}  // namespace multipanda::ros
