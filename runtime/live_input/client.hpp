#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "runtime/live_input/line_connection.hpp"
#include "runtime/live_input/stream_packet.hpp"

// Client of a LiveServer, for the command line and for programs that move arms. Blocking; for one thread.
namespace multipanda {

// Publishes set-points for one input at up to 1 kHz. The values are those of a Target, in the frame named in
// the handshake. If nothing is sent for the input's timeout_s, the arms go to hold.
class ReferenceStream {
 public:
  ReferenceStream(const std::filesystem::path& path, std::uint32_t channel);  // throws std::runtime_error
  ~ReferenceStream();
  ReferenceStream(ReferenceStream&& other) noexcept;
  ReferenceStream& operator=(ReferenceStream&&) = delete;

  // Never waits. Returns false if the socket is full (the run counts the packet as lost) or the run is over.
  // Throws std::invalid_argument for no values or more than kMaxTargetValues.
  bool send(std::span<const double> values, std::int64_t client_time_ns = 0);
  // The same for samples that are not due yet; its id is not used.
  bool send(const Chunk& chunk, std::int64_t client_time_ns = 0);
  std::uint32_t channel() const { return channel_; }
  std::uint64_t sent() const { return sequence_; }  // packets, including those that found the socket full

 private:
  int file_ = -1;
  std::uint32_t channel_ = 0;
  std::uint64_t sequence_ = 0;
};

class LiveClient {
 public:
  explicit LiveClient(const std::filesystem::path& socket);  // throws std::runtime_error if no run listens

  // Sends a request (without "id") and waits for its answer. Throws std::runtime_error if none comes; the run
  // then no longer begins it.
  nlohmann::json ask(nlohmann::json request, double timeout_s = 10);
  // Sends without waiting, for requests that are answered only if refused.
  void tell(const nlohmann::json& request);
  // The next line that is not an answer: streamed state, reports on a channel. Throws std::runtime_error
  // on timeout.
  nlohmann::json next(double timeout_s);

  // `frame`: "world" or "<arm>_base"; empty: the input's own. Throws std::invalid_argument with the refusal.
  ReferenceStream open_stream(const std::string& controllet, const std::string& input,
                              const std::string& frame = "");

 private:
  nlohmann::json exchange(nlohmann::json request, double timeout_s);
  nlohmann::json receive(double deadline_s);
  void send(const nlohmann::json& request);

  LineConnection line_;
  std::uint64_t next_id_ = 1;
  std::deque<nlohmann::json> others_;
  // The run's clock minus ours [ns], from its answers: 0 on one computer. None: not known.
  std::optional<std::int64_t> ahead_ns_;
};

// Stops arms of a run over a connection of its own; no names: all. Returns the answer. Throws
// std::runtime_error if none comes: a stalled run stops when it continues.
nlohmann::json stop_run(const std::filesystem::path& socket, const std::vector<std::string>& arms,
                        double timeout_s = 5);

// The socket of the only running scene. Throws std::runtime_error if there is none, or more than one.
std::filesystem::path only_running_socket();

}  // namespace multipanda
