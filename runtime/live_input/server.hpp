#pragma once

#include <atomic>
#include <chrono>
#include <deque>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "core/types/gap_watch.hpp"
#include "runtime/live_input/line_connection.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "runtime/live_input/socket_path.hpp"

namespace multipanda {

// Live input of a running scene (docs/live_input.md): a Unix socket for requests as JSON lines, and one
// next to it for references as binary packets. One thread serves all clients and never waits for one; the
// loop never waits for this thread.
//
// Each turn reads all clients, with at most 64 kB of each, and executes their stops; then packets and other
// requests have at most 2 ms each. So a stop does not depend on unread answers or full queues. It waits for
// the previous turn, for earlier bytes of its own client, and for this thread to be scheduled.
class LiveServer {
 public:
  static constexpr std::size_t kLongestLine = 64 * 1024;  // of a request
  static constexpr std::size_t kMaxClients = 64;          // on each of the two sockets
  static constexpr std::size_t kMaxPending = 64;          // requests of one client; more wait
  static constexpr std::size_t kMaxAhead = 64 * 1024;     // bytes of unread answers; then its requests wait
  static constexpr std::size_t kMaxWaiting = 256 * 1024;  // bytes of such requests; more are dropped
  static constexpr std::size_t kMaxUnread =
      1024 * 1024;  // bytes of unread streamed state; then it is dropped
  static constexpr std::size_t kMaxChannels = 256;

  // Starts to listen. The folder of `path` must exist. Throws SocketTaken (a live process has the path),
  // std::invalid_argument (path too long), std::runtime_error (anything else).
  // `realtime`: the clock for the age of packets; tests replace it to imitate an overloaded computer.
  LiveServer(const std::filesystem::path& path, LiveInputContext run, double (*realtime)() = realtime_s);
  ~LiveServer();  // closes all connections
  LiveServer(const LiveServer&) = delete;

  const std::filesystem::path& path() const { return claim_.path(); }
  std::uint64_t clients_dropped() const { return dropped_.load(std::memory_order_relaxed); }
  // Connected clients that have the memory of records.
  std::size_t record_readers() const { return record_readers_.load(std::memory_order_relaxed); }

 private:
  using Clock = std::chrono::steady_clock;
  struct Started {
    nlohmann::json id;
    RequestHandler::Pending pending;
  };
  struct Waiting {
    LineConnection::Line line;
    HostTime arrived;
    std::size_t bytes() const { return sizeof(Waiting) + line.text.size(); }
  };
  struct Client {
    explicit Client(int file) : line(file, kLongestLine) {}
    LineConnection line;
    std::deque<Waiting> waiting;      // not begun
    std::size_t waiting_bytes = 0;    // of those
    std::uint64_t dropped = 0;        // requests that were not even read; not yet reported
    nlohmann::json refused;           // the newest refusal of a request without an id
    std::uint64_t refused_again = 0;  // not yet reported
    Clock::time_point refused_at;
    HostTime heard = host_now();         // when its newest line came
    HostTime leaves;                     // closed to make room: until then it may still stop; 0: stays
    std::list<Started> requests;         // started, not answered
    std::chrono::nanoseconds period{0};  // of its subscription to the state; 0: none
    Clock::time_point next_state;
    nlohmann::json subscription;          // its id
    bool has_records = false;             // it was sent their memory
    InstanceSet leads = 0;                // controllets that end with this client, which ends if it is
    std::chrono::nanoseconds silence{0};  // silent for longer
    bool gone = false;
    bool stays() const { return !gone && leaves.ns == 0; }
  };
  struct Publisher {
    explicit Publisher(int file_) : file(file_) {}
    ~Publisher();
    Publisher(const Publisher&) = delete;
    int file;
    bool gone = false;
  };
  struct Channel {
    Client* owner = nullptr;
    StreamChannel stream;
    const Publisher* sender = nullptr;     // of its newest packet
    Verdict reported = Verdict::accepted;  // to its owner
  };

  void run();
  void wait();
  void accept_clients();
  void make_room(std::ptrdiff_t most_leaving = 256);
  void send_away(Client& client);
  void accept_publishers();
  bool read(Client& client);
  void hang_up(Client& client);
  bool take_stop(Client& client, const std::string& text);
  void take_lines();
  void take_line(Client& client, const Waiting& waiting);
  static void refuse(Client& client, nlohmann::json why, const nlohmann::json& id);
  bool take_connection_request(Client& client, const nlohmann::json& request, const nlohmann::json& id);
  void take_lead(Client& client, const JsonFields& named, const nlohmann::json& id);
  void pass_records(Client& client, const JsonFields& named, const nlohmann::json& id) const;
  void poll_requests(Client& client);
  void send_state(Client& client, Clock::time_point now, std::string& state);
  void take_packets(Publisher& publisher);
  template <typename Packet>
  void take_packet(const Packet& packet, std::uint32_t number, const Publisher& sender, double age_s);
  bool may_take(const Client& client) const;
  static void answer(Client& client, nlohmann::json answer, const nlohmann::json& id);

  SocketClaim claim_;
  RequestHandler handler_;
  double (*realtime_)();
  GapWatch gaps_;
  int lines_ = -1, packets_ = -1, wake_ = -1;
  std::list<Client> clients_;
  std::list<Publisher> publishers_;
  std::map<std::uint32_t, Channel> channels_;
  std::uint32_t next_channel_ = 1;
  std::uint64_t unreadable_ = 0;  // invalid packets, or packets of channels that are not open
  std::atomic<std::uint64_t> dropped_{0};
  std::atomic<std::size_t> record_readers_{0};
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace multipanda
