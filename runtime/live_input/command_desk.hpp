#pragma once

#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/cycle/backend.hpp"
#include "core/modes/multimode_controller.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/live_input/state_board.hpp"
#include "runtime/live_input/stream_packet.hpp"

namespace multipanda {

// What a server of live input works on. All of it must live longer than the server.
struct LiveWorld {
  std::string scene;
  MultimodeController* modes = nullptr;
  Backend* backend = nullptr;
  const StateBoard* board = nullptr;
  std::vector<std::shared_ptr<const ArmModel>> models;  // per arm
};

// Where one binary stream leads.
struct StreamChannel {
  InstanceIndex instance = kNoInstance;
  std::uint16_t input = 0;
  std::optional<Pose> X_WB;            // of the base in whose frame the values come; nothing: world
  std::uint64_t last = 0;              // sequence
  std::uint64_t received = 0;          // packets
  std::uint64_t lost = 0;              // gaps in the sequence
  std::uint64_t late = 0;              // out of order: ignored
  std::uint64_t refused = 0;           // not taken
  std::int64_t client_time_ns = 0;     // of the newest
  Verdict verdict = Verdict::pending;  // of the newest
};

// Turns requests (docs/live_input.md) into those of the core and their answers back into words. It never
// waits: what the loop or an arm must answer is begun here and asked for later. One thread.
class CommandDesk {
 public:
  explicit CommandDesk(LiveWorld world);

  // What has been begun and is not answered yet.
  struct Pending {
    HostTime asked;
    std::uint64_t ticket = 0;       // of the mailbox
    Request request;                // what the ticket is for
    std::future<ArmAnswer> answer;  // of the backend
    double patience_s = 0;          // with it, where motions take longer than usual requests
    ArmSet stopping;                // a stop
  };

  // The answer, or nothing and `pending` is begun. Throws RequestRefused.
  std::optional<nlohmann::json> begin(const nlohmann::json& request, Pending& pending);
  // The answer, once it is there or waited for too long.
  std::optional<nlohmann::json> poll(Pending& pending);

  // --- streams ---
  StreamChannel open_channel(const nlohmann::json& request) const;  // throws RequestRefused
  void deliver(const StreamPacket& packet, StreamChannel& channel);
  nlohmann::json describe(const StreamChannel& channel) const;

  // --- what there is ---
  nlohmann::json list() const;
  nlohmann::json state();

 private:
  struct Address {
    InstanceIndex instance;
    std::uint16_t input;
    std::optional<Pose> X_WB;
  };

  std::optional<nlohmann::json> begin_switch(const JsonFields& fields, Pending& pending);
  std::optional<nlohmann::json> begin_feature(const JsonFields& fields, Pending& pending);
  std::optional<nlohmann::json> begin_parameter(const JsonFields& fields, Pending& pending);
  std::optional<nlohmann::json> begin_reference(const JsonFields& fields, Pending& pending);
  std::optional<nlohmann::json> post(const Request& request, Pending& pending);
  void begin_arm_request(const std::string& word, const JsonFields& fields, Pending& pending);

  InstanceIndex instance(const std::string& name) const;
  InstanceIndex instance_in(const JsonFields& fields) const;
  ArmIndex arm(const std::string& name) const;
  ArmSet arms_in(const JsonFields& fields) const;  // "arms": all where absent
  Address address_in(const JsonFields& fields) const;
  const ArmModel& model_of(InstanceIndex i, const InputSpec& input) const;
  nlohmann::json answer_of(const Answer& answer, const Request& request) const;
  nlohmann::json refusal(Verdict verdict, const std::string& reason) const;

  LiveWorld world_;
  StateBoard::Snapshot snapshot_;
  std::vector<ModelTerms> terms_;
};

}  // namespace multipanda
