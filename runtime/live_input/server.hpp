#pragma once

#include <atomic>
#include <chrono>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "runtime/live_input/command_desk.hpp"
#include "runtime/live_input/line_connection.hpp"
#include "runtime/live_input/socket_path.hpp"

namespace multipanda {

// Live input of a running scene (docs/live_input.md): a Unix socket that takes requests as JSON lines, and
// one beside it that takes references as binary packets. One thread serves all clients; it waits for none of
// them and the loop waits for nobody.
class LiveServer {
 public:
  static constexpr std::size_t kLongestLine = 64 * 1024;  // of a request
  static constexpr std::size_t kMaxClients = 64;          // on each of the two sockets
  static constexpr std::size_t kMaxPending = 64;          // requests of one client; more wait in its socket
  static constexpr std::size_t kMaxAhead = 64 * 1024;     // bytes of answers not read: its requests wait
  static constexpr std::size_t kMaxUnread = 1024 * 1024;  // bytes of streamed state not read: dropped
  static constexpr std::size_t kMaxChannels = 256;

  // Listens from now on. The folder of `path` must exist. Throws SocketTaken (a live process has the path),
  // std::invalid_argument (path too long), std::runtime_error (anything else).
  LiveServer(const std::filesystem::path& path, LiveWorld world);
  ~LiveServer();  // answers nothing more
  LiveServer(const LiveServer&) = delete;

  const std::filesystem::path& path() const { return claim_.path(); }
  std::uint64_t clients_dropped() const { return dropped_.load(std::memory_order_relaxed); }

 private:
  using Clock = std::chrono::steady_clock;
  struct Begun {
    nlohmann::json id;
    CommandDesk::Pending pending;
  };
  struct Client {
    explicit Client(int file) : line(file, kLongestLine) {}
    LineConnection line;
    std::list<Begun> requests;           // begun, not answered
    std::chrono::nanoseconds period{0};  // of the state it subscribed to; 0: none
    Clock::time_point next_state;
    nlohmann::json subscription;  // its id
    bool gone = false;
  };
  struct Channel {
    Client* owner = nullptr;
    StreamChannel stream;
    Verdict told = Verdict::accepted;  // to its owner
  };
  struct Publisher {
    explicit Publisher(int file_) : file(file_) {}
    ~Publisher();
    Publisher(const Publisher&) = delete;
    int file;
    bool gone = false;
  };

  void run();
  void wait();
  void accept_clients();
  void accept_publishers();
  void serve(Client& client, bool all);
  void take_line(Client& client, const LineConnection::Line& line);
  bool take_connection_word(Client& client, const nlohmann::json& request, const nlohmann::json& id);
  void poll_requests(Client& client);
  void send_state(Client& client, Clock::time_point now);
  void take_packets(Publisher& publisher);
  void take_packet(const StreamPacket& packet);
  bool may_take(const Client& client) const;
  static void answer(Client& client, nlohmann::json answer, const nlohmann::json& id);

  SocketClaim claim_;
  CommandDesk desk_;
  int lines_ = -1, packets_ = -1, wake_ = -1;
  std::list<Client> clients_;
  std::list<Publisher> publishers_;
  std::map<std::uint32_t, Channel> channels_;
  std::uint32_t next_channel_ = 1;
  std::uint64_t unreadable_ = 0;  // packets that are none, or of a channel that is not open
  std::atomic<std::uint64_t> dropped_{0};
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace multipanda
