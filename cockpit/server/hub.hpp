#pragma once

#include <atomic>
#include <chrono>
#include <list>
#include <optional>
#include <string>
#include <thread>

#include <nlohmann/json.hpp>

#include "cockpit/server/connection.hpp"
#include "cockpit/server/control.hpp"
#include "cockpit/server/page_files.hpp"
#include "cockpit/wire/websocket.hpp"

namespace multipanda::cockpit {

// Bounds of what others can cost (docs/cockpit_wire.md). Durations in [s].
struct HubLimits {
  std::size_t clients = 16, connections = 64;
  std::size_t first_message = 1024, message = 64 * 1024;  // [bytes]
  std::size_t unsent = 16u << 20;  // answers and news that a client does not read [bytes]
  double messages_per_s = 1000, burst = 2000;
  double first_s = 5;   // to the whole head of a request, and to the token
  double ping_s = 2;    // of silence, until it is asked whether anybody is there
  double silent_s = 6;  // until it is closed
};

// Serves the page and its WebSockets on 127.0.0.1, in a thread of its own: reads requests, checks hosts,
// origins and tokens, keeps the limits, and passes messages on. It never waits for a client.
class Hub {
 public:
  // A WebSocket whose token was right. Used on the hub's thread only.
  class Client {
   public:
    virtual ~Client() = default;
    virtual ClientId id() const = 0;
    virtual void send(const nlohmann::json& message) = 0;
    virtual void send_numbers(std::string_view bytes) = 0;  // a binary message
    virtual std::size_t unsent() const = 0;                 // bytes that wait for the client
    virtual void close(CloseCode code, std::string reason) = 0;
  };

  // What the hub serves; called on the hub's thread.
  class Handler {
   public:
    virtual ~Handler() = default;
    virtual void join(Client& client, const nlohmann::json& id) = 0;  // `id`: of its first message
    virtual void take(Client& client, const nlohmann::json& message) = 0;
    virtual void leave(Client& client) = 0;
    // Called after whatever came, and at the latest after the time that it returned last.
    virtual std::chrono::nanoseconds turn(HostTime now) = 0;
  };

  // Begins to listen; port 0: any free one. `handler` must outlive this. Throws std::runtime_error.
  Hub(std::uint16_t port, std::string token, PageFiles files, Handler& handler, HubLimits limits = {});
  ~Hub();  // closes all connections: the end has come
  Hub(const Hub&) = delete;

  std::uint16_t port() const { return port_; }
  std::string address() const;  // "http://127.0.0.1:PORT/#TOKEN"
  // Connections that were closed or refused because of a limit or a wrong token, so far.
  std::uint64_t refused() const { return refused_.load(std::memory_order_relaxed); }

 private:
  struct Peer final : Client {
    Peer(int file, ClientId id, const HubLimits& limits, HostTime now);
    ClientId id() const override { return id_; }
    void send(const nlohmann::json& message) override;
    void send_numbers(std::string_view bytes) override;
    std::size_t unsent() const override { return connection.unsent(); }
    void close(CloseCode code, std::string reason) override;

    enum class State { http, token, client, closing };
    Connection connection;
    ClientId id_;
    State state = State::http;
    HttpReader http;
    WebSocketReader frames;
    HostTime begun, heard, closed;  // since when it is in this state; the newest byte
    HostTime filled;                // when `allowance` was counted
    double allowance;               // of messages
    bool pinged = false, joined = false;
    bool more = false;  // messages that came and are for the next turn
  };

  void run();
  void wait(std::chrono::nanoseconds longest);
  void accept_all();
  void serve(Peer& peer);
  void serve_http(Peer& peer);
  void refuse(Peer& peer, int status, const std::string& reason);
  void answer_http(Peer& peer, const HttpRequest& request);
  void begin_websocket(Peer& peer, const HttpRequest& request);
  void serve_frames(Peer& peer);
  void take_text(Peer& peer, const std::string& text);
  void take_token(Peer& peer, const nlohmann::json& message);
  bool may_send(Peer& peer, HostTime now);
  void watch(Peer& peer, HostTime now);
  std::size_t client_count() const;

  const std::string token_;
  const PageFiles files_;
  const HubLimits limits_;
  Handler& handler_;
  int listening_ = -1, wake_ = -1;
  std::uint16_t port_ = 0;
  ClientId next_id_ = 1;
  std::list<Peer> peers_;  // oldest first
  std::atomic<std::uint64_t> refused_{0};
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace multipanda::cockpit
