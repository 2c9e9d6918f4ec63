#pragma once

#include <atomic>
#include <chrono>
#include <deque>
#include <filesystem>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include <nlohmann/json.hpp>

#include "cockpit/server/control.hpp"
#include "common/process.hpp"
#include "core/types/time.hpp"

namespace multipanda::cockpit {

// The bytes of one connection. Non-blocking: data that do not fit into the socket wait here.
class Connection {
 public:
  explicit Connection(int file) : file_(file) {}
  ~Connection();
  Connection(const Connection&) = delete;

  int file() const { return file_; }
  // Reads received data, at most `longest` unread bytes in total. Returns whether there were any.
  bool receive(std::size_t longest);
  std::string& received() { return in_; }  // not yet processed
  void send(std::string_view bytes) {
    if (!broken_) out_ += bytes;
  }
  void flush();
  std::size_t unsent() const { return out_.size() - sent_; }
  // By the other side, or broken; everything received before is available.
  bool ended() const { return ended_; }

 private:
  int file_;
  std::string in_, out_;
  std::size_t sent_ = 0;                 // of out_
  bool ended_ = false, broken_ = false;  // nothing more can be received; be sent
};

// Limits on the resources used by others (cockpit/WIRE.md). Durations in [s].
struct HubLimits {
  std::size_t connections = 64;                           // with a token
  std::size_t first_message = 1024, message = 64 * 1024;  // [bytes]
  std::size_t waiting = 256 * 1024;                       // messages that wait for their turn [bytes]
  std::size_t unsent = 16u << 20;  // answers and news that a client does not read [bytes]
  double messages_per_s = 1000, burst = 2000;
  double first_s = 5;   // to the end of the handshake, and to the token
  double ping_s = 2;    // between two pings
  double silent_s = 6;  // without an answer to them before the connection is closed
};

// Why a connection ends (RFC 6455, section 7.4.1).
enum class CloseCode : std::uint16_t { normal = 1000, going_away = 1001, policy = 1008 };

// Connects the clients of a page server (page_server.py), a process of its own that serves the page and its
// WebSockets on 127.0.0.1, to a handler, in a thread of its own. It never waits for a client. The handler
// decides which messages are urgent: they overtake others, and count beyond the limits and after the end.
class Hub {
 public:
  // A WebSocket with a valid token. Used on the hub's thread only.
  class Client {
   public:
    virtual ~Client() = default;
    virtual ClientId id() const = 0;
    virtual void send(const nlohmann::json& message) = 0;
    virtual void send_numbers(std::string_view bytes) = 0;  // a binary message
    virtual std::size_t unsent() const = 0;                 // bytes that wait for the client
    virtual void close(CloseCode code, std::string reason) = 0;
  };

  // Contents of the hub; called on the hub's thread.
  class Handler {
   public:
    virtual ~Handler() = default;
    virtual void join(Client& client, const nlohmann::json& id) = 0;  // `id`: of its first message
    virtual bool is_urgent(const std::string& /*message*/) const { return false; }
    // Whether what waits for its turn counts although its client has gone.
    virtual bool outlasts(const std::string& /*message*/) { return false; }
    // `arrived`: 0 if the page server stalled meanwhile, so that it may be old.
    virtual void take(Client& client, const nlohmann::json& message, HostTime arrived) = 0;
    virtual void leave(Client& client) = 0;
    // Called after every message, and at the latest after the time that it returned last.
    virtual std::chrono::nanoseconds turn(HostTime now) = 0;
  };

  struct Options {
    std::uint16_t port = 0;      // 0: any free one
    bool or_any = false;         // any free one if that is taken
    std::filesystem::path page;  // folder of the page's files; without them there is no page
    HubLimits limits{};
  };
  // Starts the server and waits until it listens. `handler` must outlive this. Throws std::runtime_error.
  Hub(const Options& options, Handler& handler);
  ~Hub();  // closes all connections
  Hub(const Hub&) = delete;

  std::uint16_t port() const { return port_; }
  const std::string& token() const { return token_; }
  std::string address() const;  // "http://127.0.0.1:PORT/#TOKEN"
  bool has_page() const { return has_page_; }
  pid_t server() const { return server_->id(); }

 private:
  struct Frame {
    char kind = 0;
    ClientId client = 0;
    std::int64_t number = 0;
    std::string payload;
  };
  struct Peer final : Client {
    Peer(Hub& hub, ClientId id) : hub_(hub), id_(id) {}
    ClientId id() const override { return id_; }
    void send(const nlohmann::json& message) override;
    void send_numbers(std::string_view bytes) override { send('N', bytes); }
    std::size_t unsent() const override { return sent - written; }
    void close(CloseCode code, std::string reason) override;
    void send(char kind, std::string_view payload);

    struct Waiting {
      std::string text;
      HostTime arrived;
      std::size_t bytes() const { return sizeof(Waiting) + text.size(); }
    };
    Hub& hub_;
    ClientId id_;
    bool closing = false, left = false;
    std::size_t sent = 0, written = 0;  // payloads for it; those that the page server has written [bytes]
    std::deque<Waiting> waiting;        // messages for the next turns
    std::size_t waiting_bytes = 0;
  };

  void put(const Frame& frame);
  std::optional<Frame> next_frame();
  void learn_address();
  void run();
  void wait(std::chrono::nanoseconds longest);
  void take(Frame& frame);
  void take_text(Peer& peer, std::string text, HostTime arrived, bool beyond_limits);
  void take_waiting(Peer& peer);

  const HubLimits limits_;
  Handler& handler_;
  int wake_ = -1;
  std::unique_ptr<Connection> channel_;  // to the page server
  std::unique_ptr<ChildProcess> server_;
  std::uint16_t port_ = 0;
  std::string token_;
  bool has_page_ = false, said_ = false;
  std::list<Peer> peers_;  // oldest first
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace multipanda::cockpit
