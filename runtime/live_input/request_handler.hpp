#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/cycle/backend.hpp"
#include "core/modes/multimode_controller.hpp"
#include "logs/log_choice.hpp"
#include "runtime/followed.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/live_input/latest_state.hpp"
#include "runtime/live_input/stream_packet.hpp"
#include "runtime/object_poses.hpp"
#include "runtime/shared_records/shared_records.hpp"
#include "scene/build.hpp"

namespace multipanda {

// Number of the newest episode, shared by all interfaces of a run.
struct EpisodeCount {
  std::mutex mutex;
  std::uint64_t episode = 0;  // 0: none
  bool open = false;
};

// A log that is being written; empty: none is, and the answer says why. The answer comes when it is whole.
using KeptLog = std::pair<std::filesystem::path, std::future<RequestAnswer>>;

// The parts of a run that live input uses. They must outlive the server. Copies share the count of episodes
// and what grippers follow.
struct LiveInputContext {
  std::string scene;
  MultimodeController* modes = nullptr;
  Backend* backend = nullptr;
  const LatestState* latest = nullptr;
  std::vector<std::shared_ptr<const ArmModel>> models;  // per arm
  std::vector<std::optional<BaseMount>> mounts = {};    // per arm: carried by another one; empty: none
  std::map<std::string, Matrix3> rotations;             // of the scene's objects: default of placements
  std::vector<FlangeLoad> flanges;                      // per arm: what it may carry; empty: not known
  const ObjectPoses* objects = nullptr;                 // of the simulated world; none: there are none
  const SharedRecords* records = nullptr;               // none: not on this computer
  std::function<void(const EpisodeMark&)> mark;         // into log and events
  std::function<KeptLog()> keep;                        // writes what has just happened
  std::shared_ptr<EpisodeCount> episodes = std::make_shared<EpisodeCount>();
  std::shared_ptr<Followed> followed = std::make_shared<Followed>();
  bool stops_only = false;  // the program commands its arms by itself: clients may only read and stop
};

// Destination and counts of one binary stream.
struct StreamChannel {
  InstanceIndex instance = kNoInstance;
  std::uint16_t input = 0;
  std::optional<Pose> X_WB;            // pose of the base in whose frame the values are; none: world
  std::uint64_t last = 0;              // sequence
  std::uint64_t received = 0;          // packets
  std::uint64_t lost = 0;              // gaps in the sequence
  std::uint64_t late = 0;              // out of order: ignored
  std::uint64_t refused = 0;           // not taken
  std::uint64_t expired = 0;           // waited in the socket for longer than the input's timeout: not taken
  std::int64_t client_time_ns = 0;     // of the newest
  std::uint64_t late_before = 0;       // of the input, when the channel was opened
  std::uint64_t chunk = 0;             // the newest one taken, by its number in the input; 0: none
  Verdict verdict = Verdict::pending;  // of the newest
  std::string reason;                  // of the newest that was refused
};

// Ends these controllets, whether they are active or not yet, so that hold takes their arms; without a free
// place for that, the arms stop. It never expires.
void end_or_stop(MultimodeController& modes, InstanceSet instances);

// Translates JSON requests (docs/live_input.md) to requests of the core and their answers back to JSON. It
// never waits: a request to the loop or an arm is started by begin() and answered by poll(). For one thread.
class RequestHandler {
 public:
  explicit RequestHandler(LiveInputContext run);

  // A request that was started and is not answered yet.
  struct Pending {
    HostTime received, asked;
    std::uint64_t ticket = 0;              // of the mailbox
    Request request;                       // the request with this ticket
    std::future<RequestAnswer> answer;     // of the backend
    double patience_s = 0;                 // for the backend's answer, if it takes longer than usual
    nlohmann::json done;                   // added to the backend's answer if it succeeds
    ArmSet stopping;                       // arms of a stop request
    std::optional<GripperRequest> moving;  // a motion that a stop or the end of its client ends
    ArmIndex arm = 0;                      // of that gripper
    const void* client = nullptr;          // the sender
    std::string wrong;                     // in that request; empty: nothing
    std::shared_ptr<std::atomic<std::int64_t>> begin_by =  // host time [ns]
        std::make_shared<std::atomic<std::int64_t>>(std::numeric_limits<std::int64_t>::max());
  };

  // The answer, or nothing if the request is pending. Throws RequestRefused. A stop is never refused:
  // whatever is wrong with it, it stops all arms, and its answer says why. Any other request that acts is
  // refused, at the last moment before it does, if it has waited for longer than its sender waits, since it
  // was sent or has `arrived`, or if it was sent before `not_before`, the end of the program's last stall.
  std::optional<nlohmann::json> begin(const nlohmann::json& request, Pending& pending,
                                      HostTime arrived = host_now(), HostTime not_before = {});
  // Its sender has disconnected: pending requests do not begin, unless they are switches to hold, and a
  // gripper that has not finished its motion stops. Returns the answer to that stop; invalid: there is none.
  std::future<RequestAnswer> abandon(Pending& pending);
  // Grippers that follow widths stay where they are: those of arms that were stopped, also by their button or
  // a reflex, or those of a gone `client`.
  void end_following(const void* client = nullptr);
  // Whether it is a switch that activates holds alone, which is safer than earlier requests.
  bool only_holds(const Request& request) const;
  bool only_holds(const nlohmann::json& request) const;
  MultimodeController& modes() { return *run_.modes; }
  // Converts the JSON of a switch, feature, parameter, reference or resume to a request to the loop; nothing:
  // `word` is another one. A sample of a stream has this delivery. Throws RequestRefused.
  std::optional<Request> read(const std::string& word, const JsonFields& fields) const;
  ArmSet arms_in(const JsonFields& fields) const;  // "arms": all where absent
  ArmIndex arm(const std::string& name) const;
  // Controllets that end with their client. Ignores unknown names; throws RequestRefused for the rest.
  InstanceSet read_lead(const JsonFields& fields) const;
  // The answer, once it is available or too late. A gripper's motion ends with a stop of its arm.
  std::optional<nlohmann::json> poll(Pending& pending);

  // --- streams ---
  StreamChannel open_channel(const nlohmann::json& request) const;  // throws RequestRefused
  // `age_s`: since the packet was sent. Its sender may be silent by now, so packets older than the input's
  // timeout are not taken.
  void deliver(const StreamPacket& packet, StreamChannel& channel, double age_s = 0);
  // All samples are taken, or none. A refused chunk ends the previous one.
  void deliver(const ChunkPacket& packet, StreamChannel& channel, double age_s = 0);
  // Drops this channel's samples that are not due yet.
  void discard(StreamChannel& channel);
  nlohmann::json describe(const StreamChannel& channel) const;

  // --- contents and state of the run ---
  nlohmann::json list() const;
  nlohmann::json state();
  const SharedRecords* records() const { return run_.records; }

 private:
  bool begin_packet(const StreamPacket& packet, StreamChannel& channel, double age_s);
  Request sample_of(const StreamChannel& channel, Target target) const;
  void conclude(Verdict verdict, const Request& sample, StreamChannel& channel);
  struct Address {
    InstanceIndex instance;
    std::uint16_t input;
    std::optional<Pose> X_WB;
  };

  void begin_stop(const nlohmann::json& request, Pending& pending);
  void take_gripper(ArmIndex arm, const GripperRequest& request, Pending& pending);
  void take_width(ArmIndex arm, const GripperFollow& follow, Followed::Gripper& gripper, Pending& pending);
  std::string halted(ArmIndex arm) const;  // by its button or a reflex, in the newest state; empty: it is not
  void check_whose_arms(const JsonFields& fields) const;
  static void keep_patience(const JsonFields& fields, HostTime not_before, Pending& pending);
  Request read_switch(const JsonFields& fields) const;
  Request read_feature(const JsonFields& fields) const;
  Request read_parameter(const JsonFields& fields) const;
  Request read_reference(const JsonFields& fields) const;
  GoalEnd read_until(const JsonFields& fields, const Request& request) const;
  std::optional<nlohmann::json> post(const Request& request, Pending& pending);
  nlohmann::json mark_episode(const JsonFields& fields);
  void begin_backend_request(const std::string& name, const JsonFields& fields, HostTime not_before,
                             Pending& pending);

  InstanceIndex instance(const std::string& name) const;
  InstanceIndex instance_in(const JsonFields& fields) const;
  Address address_in(const JsonFields& fields) const;
  nlohmann::json answer_of(const Answer& answer, const Request& request) const;
  nlohmann::json load_done(ArmIndex arm, double payload) const;
  nlohmann::json refusal(Verdict verdict, const std::string& reason) const;

  LiveInputContext run_;
  LatestState::Snapshot snapshot_;
  std::vector<ModelTerms> terms_;
  ArmSet held_;  // stopped arms whose grippers have been told to stay
};

}  // namespace multipanda
