#pragma once

#include <memory>
#include <vector>

#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/adapter/controllets/input_port.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Every input of every controllet instance as two subscriptions:
//   ~/<instance>/<input>        a stream: one of a series, silence is a lost publisher
//   ~/<instance>/<input>/goal   sent once, approached smoothly, stays in force
class Inputs : public Part {
 public:
  // Throws std::invalid_argument for a codec whose input does not exist.
  Inputs(const AdapterWorld& world, const std::vector<InputCodec>& codecs);
  std::vector<Diagnostic> diagnostics() const override;
  const std::vector<std::unique_ptr<InputPort>>& ports() const { return ports_; }

 private:
  void open(const AdapterWorld& world, InputPort& port, const InputCodec* codec);
  template <class M>
  void subscribe(const AdapterWorld& world, InputPort& port);

  std::vector<std::unique_ptr<InputPort>> ports_;
  std::vector<std::unique_ptr<Incoming>> subscriptions_;  // end before the ports
};

// The codec for an input, or nullptr.
const InputCodec* codec_for(const std::vector<InputCodec>& codecs, const Instance& instance,
                            const InputSpec& input);

}  // namespace multipanda::ros
