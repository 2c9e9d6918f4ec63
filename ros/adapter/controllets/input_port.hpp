#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/input_reader.hpp"

namespace multipanda::ros {

// Receives the messages for one input, streams and goals: reads, posts and counts them. A refused message
// does not reach the loop, so a controllet whose stream consists of such messages is held by its timeout.
class InputPort {
 public:
  InputPort(const AdapterContext& run, InstanceIndex instance, std::size_t input);

  struct Counts {
    std::uint64_t received = 0, refused = 0;
    std::string last_reason;       // of the newest refusal; empty: none so far
    bool last_accepted = true;     // of the newest message
    bool last_not_active = false;  // refused only because the controllet is not active
  };

  // Runs in the executor's thread. `waited_s`: the message, before this thread took it. `from`: the topic.
  // While one topic streams, streams of another are refused: an operator who lets go must find the arm held.
  // Returns whether the message was accepted.
  template <class M>
  bool receive(const M& message, Delivery delivery, double waited_s = 0, const void* from = nullptr) {
    Target target;
    target.delivery = delivery;
    InputReader::Refusal refusal = reader_.read(message, target);
    return conclude(std::move(refusal), target, waited_s, from);
  }
  bool receive(const std::vector<double>& values, const std::string& frame, Delivery delivery,
               double waited_s = 0, const void* from = nullptr);
  // Why values would be refused whichever controllet is active; empty: they would not. For messages with
  // values for several inputs.
  std::string problem(const std::vector<double>& values, const std::string& frame) const;
  void refuse(const std::string& why);  // for a message that cannot be read at all

  const std::string& name() const { return name_; }  // "pose0/pose"
  const InputSpec& spec() const { return reference_->spec(); }
  const InputReader& reader() const { return reader_; }
  Counts counts() const;  // any thread
  Diagnostic diagnostic() const;

 private:
  bool conclude(InputReader::Refusal refusal, const Target& target, double waited_s, const void* from);
  void note(std::string reason, bool not_active);

  const AdapterContext& run_;
  InstanceIndex instance_;
  std::uint16_t input_;
  Reference* reference_;
  InputReader reader_;
  std::string name_;
  const void* streams_ = nullptr;  // the topic that streams, until then
  HostTime streams_until_{};
  mutable std::mutex mutex_;
  Counts counts_;
};

}  // namespace multipanda::ros
