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
  // What receive() finds of a stream's values before it posts them.
  struct Admission {
    Target target;
    std::string why;          // it refuses them; empty: it does not
    bool not_active = false;  // only because the controllet is not active
  };
  // All checks of receive() at a time, and nothing else: for messages with values for several inputs, which
  // all of them take or none.
  Admission admits(const std::vector<double>& values, const std::string& frame, double waited_s,
                   const void* from, HostTime now) const;
  // Posts what admits() let pass. Until `until`, streams of other topics are refused; inputs of one message
  // have one `until`, so that no other topic gets one of them alone. Returns whether it was accepted.
  bool post(const Target& sample, const void* from, HostTime until);
  // For a message that cannot be read, or that is not for this controllet (`not_active`: warned of once).
  void refuse(const std::string& why, bool not_active = false);

  const std::string& name() const { return name_; }  // "pose0/pose"
  const InputSpec& spec() const { return reference_->spec(); }
  const InputReader& reader() const { return reader_; }
  Counts counts() const;  // any thread
  Diagnostic diagnostic() const;

 private:
  bool conclude(InputReader::Refusal refusal, const Target& target, double waited_s, const void* from);
  // Why it cannot be posted; empty: it can. Adds to the readers' checks those of this moment.
  std::string obstacle(const Target& target, double waited_s, const void* from, HostTime now,
                       bool& not_active) const;
  Request request_for(const Target& target) const;
  bool settle(Verdict verdict, const Request& request);
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
