#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "ros/adapter/controllets/input_reader.hpp"
#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// Where messages for one input arrive, as streams and as goals: reads, posts, counts. A message that is
// refused leaves no trace in the loop: a controllet whose stream consists of nothing else is held by its own
// rule for silence.
class InputPort {
 public:
  InputPort(const AdapterWorld& world, InstanceIndex instance, std::size_t input);

  struct Counts {
    std::uint64_t received = 0, refused = 0;
    std::string last_reason;       // of the newest refusal; empty: none so far
    bool last_accepted = true;     // the newest message
    bool last_not_active = false;  // it was only that the controllet does not run
  };

  // Executor's thread.
  template <class M>
  void receive(const M& message, Delivery delivery) {
    Target target;
    target.delivery = delivery;
    InputReader::Refusal refusal = reader_.read(message, target);
    conclude(std::move(refusal), target);
  }
  void receive(const std::vector<double>& values, const std::string& frame, Delivery delivery);
  void refuse(const std::string& why);  // a message that could not be read at all

  const std::string& name() const { return name_; }  // "pose0/pose"
  const InputSpec& spec() const { return reference_->spec(); }
  const InputReader& reader() const { return reader_; }
  Counts counts() const;  // any thread
  Diagnostic diagnostic() const;

 private:
  void conclude(InputReader::Refusal refusal, const Target& target);
  void note(std::string reason, bool not_active);

  const AdapterWorld& world_;
  InstanceIndex instance_;
  std::uint16_t input_;
  Reference* reference_;
  InputReader reader_;
  std::string name_;
  mutable std::mutex mutex_;
  Counts counts_;
};

}  // namespace multipanda::ros
