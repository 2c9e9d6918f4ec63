#include "runtime/live_input/client.hpp"

#include <cerrno>
#include <cstring>
#include <poll.h>
#include <stdexcept>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>

#include "core/types/time.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/live_input/socket_path.hpp"

namespace multipanda {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestAnswer = 16 * 1024 * 1024;
constexpr std::size_t kMostOthers = 4096;  // lines kept for next() while ask() waits

struct NobodyListens : std::runtime_error {
  using std::runtime_error::runtime_error;
};

int connected(const std::filesystem::path& path, int type) {
  const int file = connect_to(path, type);
  if (file >= 0) return file;
  const int error = errno;
  const std::string why = "no run listens at '" + path.string() + "' (" + std::strerror(error) +
                          "): start one with `multipanda run SCENE`";
  if (error == ENOENT || error == ECONNREFUSED || error == EACCES) throw NobodyListens(why);
  throw std::runtime_error(why);
}

double now_s() { return host_now().seconds(); }

// False after the deadline.
bool wait_for(int file, short events, double deadline_s) {
  const double left = deadline_s - now_s();
  pollfd entry{file, events, 0};
  return left > 0 && poll(&entry, 1, static_cast<int>(left * 1e3) + 1) > 0;
}

}  // namespace

ReferenceStream::ReferenceStream(const std::filesystem::path& path, std::uint32_t channel)
    : file_(connected(path, SOCK_SEQPACKET)), channel_(channel) {}

ReferenceStream::~ReferenceStream() {
  if (file_ >= 0) close(file_);
}

ReferenceStream::ReferenceStream(ReferenceStream&& other) noexcept
    : file_(std::exchange(other.file_, -1)), channel_(other.channel_), sequence_(other.sequence_) {}

bool ReferenceStream::send(std::span<const double> values, std::int64_t client_time_ns) {
  if (values.empty() || values.size() > kMaxTargetValues) {
    throw std::invalid_argument("a packet has 1 to " + std::to_string(kMaxTargetValues) + " values, not " +
                                std::to_string(values.size()));
  }
  StreamPacket packet{.channel = channel_,
                      .sequence = ++sequence_,
                      .client_time_ns = client_time_ns,
                      .count = static_cast<std::uint16_t>(values.size()),
                      .values = {}};
  std::copy(values.begin(), values.end(), packet.values.begin());
  StreamPacketBytes bytes;
  const std::size_t size = pack(packet, bytes);
  return ::send(file_, bytes.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL) == static_cast<ssize_t>(size);
}

bool ReferenceStream::send(const Chunk& chunk, std::int64_t client_time_ns) {
  if (chunk.size == 0 || chunk.size > kMaxTargetValues || chunk.count == 0 ||
      chunk.count > Chunk::kMostSamples)
    throw std::invalid_argument("a chunk has 1 to 64 samples of 1 to " + std::to_string(kMaxTargetValues) +
                                " values");
  StreamPacket head;
  head.channel = channel_;
  head.sequence = ++sequence_;
  head.client_time_ns = client_time_ns;
  ChunkPacketBytes bytes;
  const std::size_t size = pack(ChunkPacket{.head = head, .chunk = chunk}, bytes);
  return ::send(file_, bytes.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL) == static_cast<ssize_t>(size);
}

LiveClient::LiveClient(const std::filesystem::path& socket)
    : line_(connected(socket, SOCK_STREAM), kLongestAnswer) {}

void LiveClient::send(const json& request) {
  const double deadline = now_s() + 10;
  line_.send(to_line(request));
  for (line_.flush(); line_.unsent() > 0; line_.flush()) {
    while (line_.broken()) others_.push_back(receive(deadline));  // throws after the run's last lines
    if (!wait_for(line_.file(), POLLOUT, deadline))
      throw std::runtime_error("the run does not accept requests");
  }
}

void LiveClient::tell(const json& request) { send(request); }

json LiveClient::receive(double deadline_s) {
  for (;;) {
    if (auto line = line_.next()) {
      if (line->too_long) throw std::runtime_error("the run sent a line that is too long");
      json parsed = json::parse(line->text);
      if (parsed.value("verdict", "") == "too_many_clients") throw std::runtime_error(parsed["reason"]);
      return parsed;
    }
    if (line_.input_ended()) throw std::runtime_error("the run has ended");
    if (!wait_for(line_.file(), POLLIN, deadline_s))
      throw std::runtime_error("no answer from the run in time");
    line_.receive();
  }
}

json LiveClient::ask(json request, double timeout_s) {
  const HostTime asked = host_now();
  if (request.value("do", "") == "stop" || request.contains("asked_ns"))
    return exchange(std::move(request), timeout_s);
  if (!ahead_ns_) (void)exchange({{"do", "channels"}}, timeout_s);
  if (ahead_ns_) request.update({{"asked_ns", asked.ns + *ahead_ns_}, {"patience_s", timeout_s}});
  return exchange(std::move(request), timeout_s - seconds(host_now() - asked));
}

json LiveClient::exchange(json request, double timeout_s) {
  const std::uint64_t id = next_id_++;
  request["id"] = id;
  const HostTime sent = host_now();
  send(request);
  const double deadline = now_s() + timeout_s;
  for (;;) {
    json line = receive(deadline);
    if (line.contains("id") && line["id"] == id) {
      const HostTime received = host_now();
      const HostTime there{line.value("now_ns", std::int64_t{0})};
      // An answer within the request's duration on this clock means the same clock; otherwise the request
      // would seem too old.
      if (there.ns != 0) ahead_ns_ = there >= sent && there <= received ? 0 : (there - received).count();
      return line;
    }
    if (others_.size() == kMostOthers) others_.pop_front();
    others_.push_back(std::move(line));
  }
}

json LiveClient::next(double timeout_s) {
  if (others_.empty()) return receive(now_s() + timeout_s);
  json line = std::move(others_.front());
  others_.pop_front();
  return line;
}

ReferenceStream LiveClient::open_stream(const std::string& controllet, const std::string& input,
                                        const std::string& frame) {
  json request = {{"do", "stream"}, {"controllet", controllet}, {"input", input}};
  if (!frame.empty()) request["frame"] = frame;
  const json answer = ask(std::move(request));
  if (!answer.value("ok", false)) throw std::invalid_argument(answer.value("reason", "refused"));
  return {answer.at("path").get<std::string>(), answer.at("channel").get<std::uint32_t>()};
}

json stop_run(const std::filesystem::path& socket, const std::vector<std::string>& arms, double timeout_s) {
  json request{{"do", "stop"}};
  if (!arms.empty()) request["arms"] = arms;
  const double deadline = now_s() + timeout_s;
  for (;; std::this_thread::sleep_for(std::chrono::milliseconds(1))) {
    try {
      LiveClient client(socket);
      return client.ask(request, deadline - now_s());
    } catch (const NobodyListens&) {
      throw;
    } catch (const std::runtime_error&) {
      // It accepts no connection at the moment, or a full server has ended this one for another.
      if (now_s() >= deadline) throw;
    }
  }
}

std::filesystem::path only_running_socket() {
  const auto sockets = running_sockets();
  if (sockets.size() == 1) return sockets.front();
  if (sockets.empty()) {
    throw std::runtime_error("no scene is running (no socket in " + socket_folder().string() +
                             "): start one with `multipanda run SCENE`, or name its socket with --socket");
  }
  std::string names;
  for (const auto& socket : sockets) names += "\n  --socket " + socket.string();
  throw std::runtime_error("several scenes are running; choose one:" + names);
}

}  // namespace multipanda
